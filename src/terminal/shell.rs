//! Commands to copy: finds programs as the shell does, and quotes paths.

use std::path::{Path, PathBuf};

const PROGRAM: &str = "dials-traffic";

/// Returns the name of this program for a command to copy. If the shell would not find it, this is its path.
pub fn program() -> String {
    match std::env::current_exe() {
        Ok(path) if on_the_path(PROGRAM).is_none() => quoted(&path),
        _ => PROGRAM.to_owned(),
    }
}

/// Finds a program on the PATH.
pub fn on_the_path(program: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(program)).find(|path| path.is_file())
}

/// Quotes a path as one word of a POSIX shell.
pub fn quoted(path: &Path) -> String {
    let text = path.to_string_lossy();
    let plain = |c: char| c.is_alphanumeric() || "_-./+:=@%,".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return text.into_owned();
    }
    // Between single quotes only the single quote is special, so it is escaped outside of them.
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
        assert_eq!(quoted(Path::new("runs/a-1.b")), "runs/a-1.b", "a plain path gets no quotes");
    }
}
