//! Words of a command to copy, quoted for a shell.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use super::is_printable;

/// Quotes a path as one word of a shell, so that a copied command names the same bytes.
///
/// A path with control characters or bytes that are not UTF-8 is written as `$'...'`, which bash, zsh and ksh know.
pub fn quoted(path: &Path) -> String {
    quoted_word(path.as_os_str())
}

/// Quotes a word of a command line, like [`quoted`].
pub fn quoted_word(word: &OsStr) -> String {
    match word.to_str() {
        Some(text) if text.chars().all(is_printable) => quoted_text(text),
        _ => escaped(word.as_bytes()),
    }
}

/// Returns a path for JSON: as it is if it is UTF-8, otherwise as bash reads it, in `$'...'`.
pub fn path_as_text(path: &Path) -> String {
    path.to_str().map_or_else(|| quoted(path), str::to_owned)
}

fn quoted_text(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "_-./+:=@%,".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return text.to_owned();
    }
    // Between single quotes only the single quote is special, so it is escaped outside of them.
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// Writes every byte that is not a printable ASCII letter in octal. Three digits end by themselves, unlike `\xNN`.
fn escaped(bytes: &[u8]) -> String {
    let letter = |&byte: &u8| match byte {
        b'\'' | b'\\' => format!("\\{}", char::from(byte)),
        b' '..=b'~' => char::from(byte).to_string(),
        _ => format!("\\{byte:03o}"),
    };
    format!("$'{}'", bytes.iter().map(letter).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_come_back_from_a_shell_as_they_were() {
        for path in ["runs/a-1.b", "/with blank/x", "it's", "$HOME/*", "a;b&c|d", "ü", "", "\"\\"] {
            let command = format!("printf %s {}", quoted(Path::new(path)));
            let output = std::process::Command::new("sh").args(["-c", &command]).output().unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), path, "{command}");
        }
        assert_eq!(quoted(Path::new("runs/a-1.b")), "runs/a-1.b", "a plain path gets no quotes");
    }
}
