//! The folder in which a child works, and a folder beside it that must stay as it is.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const WORK: &str = "work";
const OUTSIDE: &str = "outside";
const CANARY: (&str, &str) = ("canary", "this file belongs to somebody else\n");

/// Makes both folders in `root` and returns the one to work in.
pub fn make(root: &Path) -> PathBuf {
    fs::create_dir(root.join(WORK)).expect("a new folder");
    fs::create_dir(root.join(OUTSIDE)).expect("a new folder");
    fs::write(root.join(OUTSIDE).join(CANARY.0), CANARY.1).expect("a new file");
    root.join(WORK)
}

/// Returns the folder that this process works in.
pub fn work() -> PathBuf {
    std::env::current_dir().expect("the driver made the folder")
}

/// Panics if a file outside was changed, added or removed; repairs it first.
pub fn check_outside() {
    let outside = work().with_file_name(OUTSIDE);
    let found = contents(&outside);
    if found.len() == 1 && found.get(CANARY.0).is_some_and(|text| text == CANARY.1.as_bytes()) {
        return;
    }
    fs::remove_dir_all(&outside).expect("a folder of this process");
    fs::create_dir(&outside).expect("its place is free");
    fs::write(outside.join(CANARY.0), CANARY.1).expect("a new file");
    panic!("a file outside was touched; there are: {:?}", found.keys().collect::<Vec<_>>());
}

fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let named = entries.map(|entry| (entry.file_name().to_string_lossy().into_owned(), entry.path()));
    named.map(|(name, path)| (name, fs::read(path).unwrap_or_default())).collect()
}

/// Makes an empty folder of this name to work in.
pub fn empty(name: &str) -> PathBuf {
    let folder = work().join(name);
    match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => panic!("{}: {error}", folder.display()),
        _ => fs::create_dir_all(&folder).expect("a folder to work in"),
    }
    folder
}

/// Copies a folder with what is in it.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder to work in");
    for entry in fs::read_dir(from).unwrap_or_else(|error| panic!("{}: {error}", from.display())).flatten() {
        let (path, copied) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &copied);
        } else {
            fs::copy(&path, &copied).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        }
    }
}
