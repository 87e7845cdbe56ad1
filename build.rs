//! Records of which commit this build is, and with which libtorch.

use std::env;
use std::path::PathBuf;
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-env=DIALS_GIT_COMMIT={}", commit().unwrap_or("unknown".into()));
    println!("cargo:rustc-env=DIALS_LIBTORCH_VERSION={}", libtorch_version().unwrap_or("none".into()));
}

/// Returns the version of libtorch; `None` in a build without the feature `torch`.
fn libtorch_version() -> Option<String> {
    env::var_os("CARGO_FEATURE_TORCH")?;
    println!("cargo:rerun-if-env-changed=LIBTORCH");
    let header = PathBuf::from(env::var("LIBTORCH").unwrap_or("/usr".into()))
        .join("include/torch/csrc/api/include/torch/version.h");
    let text = std::fs::read_to_string(header).unwrap_or_default();
    let number = |part: &str| {
        let define = format!("#define TORCH_VERSION_{part} ");
        text.lines().find_map(|line| line.strip_prefix(&define)).unwrap_or("?").to_owned()
    };
    Some(["MAJOR", "MINOR", "PATCH"].map(number).join("."))
}

/// Returns the commit of this checkout, with `-dirty` if a source has changed since.
fn commit() -> Option<String> {
    const SOURCES: [&str; 5] = ["src", "crates", "build.rs", "Cargo.toml", "Cargo.lock"];
    SOURCES.iter().for_each(|source| println!("cargo:rerun-if-changed={source}"));
    // The log grows with every commit and checkout. In a worktree it is not under `.git`.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo:rerun-if-changed={log}");
    }
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let changed = git(&[&["status", "--porcelain", "--"], &SOURCES[..]].concat())?;
    Some(if changed.is_empty() { commit } else { format!("{commit}-dirty") })
}

/// Returns git's output; `None` if git fails.
fn git(words: &[&str]) -> Option<String> {
    let output = Command::new("git")
        .arg("--no-optional-locks")
        .args(words)
        .output()
        .ok()
        .filter(|output| output.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
