//! Commands to copy: how the shell finds programs, and paths as its words.

use std::path::{Path, PathBuf};

const PROGRAM: &str = "dials-traffic";

/// How a command to copy names this program: as the shell finds it, or by its path where the shell does not.
pub fn program() -> String {
    match std::env::current_exe() {
        Ok(path) if on_the_path(PROGRAM).is_none() => quoted(&path),
        _ => PROGRAM.to_owned(),
    }
}

/// Where the shell finds a program.
pub fn on_the_path(program: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(program)).find(|path| path.is_file())
}

/// A path as one word of a POSIX shell.
pub fn quoted(path: &Path) -> String {
    let text = path.to_string_lossy();
    let plain = |c: char| c.is_alphanumeric() || "_-./+:=@%,".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return text.into_owned();
    }
    // Nothing is special between single quotes but the single quote, which is put between two such strings.
    format!("'{}'", text.replace('\'', r"'\''"))
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
        assert_eq!(quoted(Path::new("runs/a-1.b")), "runs/a-1.b", "what needs no quotes has none");
    }
}
