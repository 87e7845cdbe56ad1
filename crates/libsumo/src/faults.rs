//! What can be wrong with a library of SUMO, and the way out.

use std::fs;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::places::{LIBRARY, VARIABLE};
use super::version::OLDEST;

pub(crate) const INSTALL: &str = "install another SUMO (pip install eclipse-sumo, or on Debian apt install sumo), and let no variable \
                                  name this one: DIALS_SUMO_LIBRARY, SUMO_HOME";
pub(crate) const AGAIN: &str = "install SUMO again; DIALS_SUMO_LIBRARY can name another libsumocpp.so";

/// The functions that the shim looks for.
const FUNCTIONS: &str = include_str!("shim/sumo.inc");

/// Libraries of the system that SUMO's wheels need, and Debian's packages of them.
const PACKAGES: [(&str, &str); 7] = [
    ("libGL.so.1", "libgl1"),
    ("libX11.so.6", "libx11-6"),
    ("libXext.so.6", "libxext6"),
    ("libXrender.so.1", "libxrender1"),
    ("libatomic.so.1", "libatomic1"),
    ("libexpat.so.1", "libexpat1"),
    ("libz.so.1", "zlib1g"),
];

/// Returns whether an ELF file of 64 bits has all bytes that its head promises. The loader maps a file without looking, and the
/// process dies at the first missing byte. `None`: it is no such file, and the loader says so.
///
/// Source: System V ABI, "Program Header".
pub(crate) fn is_whole(file: &Path) -> Option<bool> {
    let mut open = fs::File::open(file).ok()?;
    let length = open.metadata().ok()?.len();
    let mut head = [0; 64];
    open.read_exact(&mut head).ok()?;
    if head[..6] != *b"\x7fELF\x02\x01" {
        return None;
    }
    let number = |bytes: &[u8], at: usize, size: usize| {
        bytes[at..at + size].iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
    };
    let (begin, size, count) = (number(&head, 32, 8), number(&head, 54, 2), number(&head, 56, 2));
    if size != 56 {
        return Some(false);
    }
    open.seek(SeekFrom::Start(begin)).ok()?;
    let mut segments = vec![0; (size * count) as usize];
    if open.read_exact(&mut segments).is_err() {
        return Some(false);
    }
    let ends =
        segments.chunks(size as usize).map(|segment| number(segment, 8, 8).saturating_add(number(segment, 32, 8)));
    Some(ends.max().is_none_or(|end| end <= length))
}

/// Returns what is wrong with a library that lacks these functions, and the way out.
pub(crate) fn lacking(lacks: &str) -> (String, &'static str) {
    let names: Vec<&str> = lacks.split(' ').map(str::trim).collect();
    let wanted = FUNCTIONS.matches("\nSUMO(").count();
    match names.len() {
        count if count >= wanted => ("is no libsumo: it has none of SUMO's functions".into(), INSTALL),
        count => (
            format!("lacks {count} of SUMO's functions: {}; {OLDEST} and newer ones have them", names.join(", ")),
            INSTALL,
        ),
    }
}

/// Returns what the loader's words about a library mean, and the way out.
pub(crate) fn not_loaded(text: &str, file: &Path) -> (String, String) {
    let has = |words: &str| text.contains(words);
    let way_out = if has("Operation not permitted") {
        "the system runs no code in its folder (mount option noexec): install SUMO in another one".to_owned()
    } else if has("failed to map segment") || has("Cannot allocate memory") {
        "allow this process more memory (ulimit -v)".to_owned()
    } else if has("version `GLIBC") {
        "this SUMO needs a newer system: pip install 'eclipse-sumo<1.26' has one for older systems".to_owned()
    } else if let Some(missing) = missing_dependency(text, file) {
        let package = PACKAGES
            .iter()
            .find(|(library, _)| *library == missing)
            .map(|(_, package)| format!("apt install {package}"));
        format!("SUMO needs {missing} of the system: on Debian, {}", package.unwrap_or("install its package".into()))
    } else if file.components().count() == 1 {
        format!(
            "install SUMO (pip install eclipse-sumo, or on Debian apt install sumo), or let {VARIABLE} name its {LIBRARY}"
        )
    } else {
        AGAIN.to_owned()
    };
    let itself = format!("{}: ", file.display());
    (text.strip_prefix(&itself).unwrap_or(text).to_owned(), way_out)
}

/// Returns the library that the loader did not find, if it is not the one that was asked for.
pub(crate) fn missing_dependency<'a>(text: &'a str, file: &Path) -> Option<&'a str> {
    let (library, _) = text.split_once(": cannot open shared object file")?;
    (Path::new(library) != file).then_some(library)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fault_of_a_library_has_its_own_way_out() {
        let file = Path::new("/opt/sumo/lib64/libsumocpp.so");
        for (text, way_out) in [
            ("libX11.so.6: cannot open shared object file: No such file or directory", "apt install libx11-6"),
            ("libnew.so.1: cannot open shared object file: No such file or directory", "install its package"),
            ("/opt/sumo/lib64/libsumocpp.so: failed to map segment from shared object", "ulimit -v"),
            ("/lib/libc.so.6: version `GLIBC_2.38' not found (required by ...)", "'eclipse-sumo<1.26'"),
            ("/opt/sumo/lib64/libsumocpp.so: file too short", "install SUMO again"),
        ] {
            let (said, found) = not_loaded(text, file);
            assert!(text.ends_with(&said) && found.contains(way_out), "{text}: {said}; {found}");
        }
        let nothing = "libsumocpp.so: cannot open shared object file: No such file or directory";
        assert!(not_loaded(nothing, Path::new(LIBRARY)).1.starts_with("install SUMO (pip"));
        assert!(lacking("Vehicle::add Lane::getLength").0.starts_with("lacks 2 of SUMO's functions: Vehicle::add, "));
    }

    #[test]
    fn a_library_without_its_end_is_found_before_the_loader_dies_of_it() {
        let whole = fs::read("/proc/self/exe").unwrap();
        let file = std::env::temp_dir().join(format!("libsumo-damaged-{}.so", std::process::id()));
        for (length, found) in [(whole.len(), Some(true)), (4096, Some(false)), (70, Some(false)), (10, None)] {
            fs::write(&file, &whole[..length]).unwrap();
            assert_eq!(is_whole(&file), found, "{length} bytes");
        }
        fs::remove_file(&file).unwrap();
    }
}
