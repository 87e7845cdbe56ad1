//! libsumo itself: found and opened when it is first needed, and its functions found by name.
//!
//! # Why not otherwise
//!
//! **Why is libsumo not simply linked?** It brings up to 220 shared libraries (GDAL, FOX, OpenGL, X11 and what these need). A
//! program that links it loads and relocates all of them at every start, even for `--help`. Where one is missing, the system's
//! loader ends the program before `main`, with a line that names a file and no cure. And such a program runs with the one
//! libsumo that it was built for. Loaded late, the same mistake is an [`Error::Library`] that a program can handle or
//! explain, and one program takes every SUMO from 1.15 on: that of a distribution, and those of Python's wheels.
//!
//! **Why does no header of SUMO take part in the build?** The shim needs 39 functions, which are the same since 1.15.
//! `shim/sumo.inc` declares them, and a build needs a C++ compiler and no SUMO. Where SUMO's headers are installed, a test
//! compares.
//!
//! **Why are names made at run time?** libsumo's interface is C++, so a symbol's name holds the types of the parameters. There are
//! two types of std::string: that of C++11, and an older one, which the wheels of SUMO up to 1.25 have. So each function has two
//! names, and a third where a version takes a text by value. Written down, they would be 100 names of 150 letters. The compiler
//! knows them: `shim/late.h` takes a function's type as the compiler names it, and makes the symbol's name of it.
//!
//! **Why is the shim compiled twice?** A std::string made with one of the two types cannot be read as the other.
//! `shim/open.cpp` takes the build of the shim that finds its functions. The streams (std::cerr) and exceptions are the same for
//! both, because both use this process's libstdc++. So it is linked dynamically.
//!
//! **What else was considered.** *Assembler*: one jump per function, in place of the function itself, fits every signature. So it
//! was here once, with SUMO's headers; but only on x86-64, and for one type of string. *The shim as a shared library of its own*
//! would be a second file beside every program, which must be found, and must be of the same build. *TraCI*, over a
//! socket, takes ten times as long per step.
//!
//! **Why `RTLD_LAZY | RTLD_LOCAL`?** Lazily, because libsumo's own libraries are bound as in any program that links them: at the
//! first call of a function. Most are never called. Locally, so that no symbol of theirs replaces one of the program's.
//!
//! **Why is it never unloaded?** Libraries below it register destructors and thread-local data, which would be called
//! after their code is gone.

use std::ffi::{CStr, CString};
use std::fs;
use std::io::{Read, Seek, SeekFrom};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::OnceLock;

use super::call;
use super::error::{Error, Result};
use super::ffi;
use super::places::{LIBRARY, PACKAGE, Place, SYSTEM, VARIABLE, places, taken};
use super::stand_ins;
use super::version::{OLDEST, Version};

/// Code of [`ffi::ds_open`] for a library that lacks functions.
const LACKS: i32 = 2;
/// Number of functions that the shim looks for.
const FUNCTIONS: usize = 38;

const INSTALL: &str = "install a SUMO that has: pip install eclipse-sumo, or on Debian apt install sumo";
const AGAIN: &str = "install SUMO again; DIALS_SUMO_LIBRARY can name another libsumocpp.so";

/// Libraries of the system that SUMO's wheels need, and Debian's packages of them.
const PACKAGES: [(&str, &str); 14] = [
    ("libGL.so.1", "libgl1"),
    ("libGLU.so.1", "libglu1-mesa"),
    ("libX11.so.6", "libx11-6"),
    ("libXcursor.so.1", "libxcursor1"),
    ("libXext.so.6", "libxext6"),
    ("libXfixes.so.3", "libxfixes3"),
    ("libXft.so.2", "libxft2"),
    ("libXi.so.6", "libxi6"),
    ("libXrandr.so.2", "libxrandr2"),
    ("libXrender.so.1", "libxrender1"),
    ("libatomic.so.1", "libatomic1"),
    ("libexpat.so.1", "libexpat1"),
    ("libfontconfig.so.1", "libfontconfig1"),
    ("libz.so.1", "zlib1g"),
];

/// The library of SUMO that this process has loaded.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Library {
    /// SUMO's own words, such as `SUMO 1.15.0`.
    pub name: String,
    /// The number in them.
    pub version: Version,
    /// Its file. Of the system only the name, because the system's loader found it.
    pub file: PathBuf,
    /// Who named the file: [`Place::source`].
    pub source: &'static str,
    pub(crate) shim: &'static ffi::ds_shim,
}

impl Library {
    /// Returns who built it: `wheel` for Python's package `eclipse-sumo`; the name of the system, such as `debian 12`, for a library
    /// of the system; else `another`.
    ///
    /// Debian's has its assertions on, for example, and the wheel's has them off.
    pub fn builder(&self) -> String {
        if self.source == SYSTEM {
            let text = fs::read_to_string("/etc/os-release").unwrap_or_default();
            let value = |key: &str| {
                let value = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('='));
                value.unwrap_or_default().trim_matches('"').to_owned()
            };
            return format!("{} {}", value("ID"), value("VERSION_ID")).trim().to_owned();
        }
        let is_wheel = self.file.ancestors().nth(2).is_some_and(|package| package.join(PACKAGE).is_file());
        if is_wheel { "wheel" } else { "another" }.to_owned()
    }

    /// Returns whether its std::string is that of C++11 and later, and not the older one.
    pub fn has_strings_of_cpp11(&self) -> bool {
        self.shim.strings_of_cpp11 != 0
    }
}

/// Loads libsumo, if this process has not done so yet, from the first of the [`places`] that has it. Every other function of this
/// crate that needs it does so by itself: call this to learn early whether SUMO is there, or to take the time of loading out of a
/// measurement.
///
/// # Errors
/// [`Error::Library`] if there is none, or one that cannot be used. The outcome is remembered: later calls return the same.
pub fn load() -> Result<&'static Library> {
    static LOADED: OnceLock<std::result::Result<Library, (String, String)>> = OnceLock::new();
    let loaded = LOADED.get_or_init(|| open(&places()));
    loaded.as_ref().map_err(|(text, way_out)| Error::Library { text: text.clone(), way_out: way_out.clone() })
}

/// Opens the library in the first place that has it. An error is what is wrong, and the way out.
fn open(places: &[Place]) -> std::result::Result<Library, (String, String)> {
    let place = taken(places).or(places.last()).expect("there is always a place");
    let file = &place.library;
    let fail = |text: String, way_out: &str| {
        Err((format!("{} ({}): {text}", file.display(), place.source), way_out.to_owned()))
    };
    if place.is_there == Some(false) {
        return fail(
            "no such file".into(),
            &format!("let {VARIABLE} name a file, or unset it to look in the usual places"),
        );
    }
    if file.is_dir() {
        return fail("is a folder".into(), &format!("let {VARIABLE} name the file {LIBRARY} in it"));
    }
    if place.is_there == Some(true) && !is_whole(file).unwrap_or(true) {
        return fail("is damaged: its end is missing".into(), AGAIN);
    }
    let name = CString::new(file.as_os_str().as_bytes()).expect("a path that was looked at has no zero");
    let (mut shim, mut version) = (ptr::null(), ptr::null());
    let mut open_it = || {
        // SAFETY: the name is a string that ends in zero; the others are only written to. Nobody is inside libsumo, because nobody
        // has loaded it.
        let code = unsafe { ffi::ds_open(name.as_ptr(), &mut shim, &mut version) };
        call::ask(code).map_err(|text| (code, text))
    };
    let mut opened = open_it();
    for _ in 0..stand_ins::COUNT {
        match &opened {
            Err((_, text)) if missing_dependency(text, file).is_some_and(stand_ins::load) => opened = open_it(),
            _ => break,
        }
    }
    match opened {
        Ok(()) => {}
        Err((LACKS, lacks)) => {
            let (text, way_out) = without(&lacks);
            return fail(text, way_out);
        }
        Err((_, text)) => {
            let (text, way_out) = not_loaded(&text, file);
            return fail(text, &way_out);
        }
    }
    // SAFETY: the call succeeded, so both are written, and hold as long as the process.
    let (shim, name) = unsafe { (&*shim, CStr::from_ptr(version).to_string_lossy().into_owned()) };
    match Version::parse(&name) {
        Some(version) if version >= OLDEST => {
            Ok(Library { name, version, file: file.clone(), source: place.source, shim })
        }
        _ => fail(format!("is {name}, but {OLDEST} or a newer one is needed"), INSTALL),
    }
}

/// Returns whether an ELF file of 64 bits has all bytes that its head promises. The loader maps a file without looking, and the
/// process dies at the first missing byte. `None`: it is no such file, and the loader says so.
///
/// Source: System V ABI, "Program Header".
fn is_whole(file: &Path) -> Option<bool> {
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
    open.seek(SeekFrom::Start(begin)).ok()?;
    let mut segments = vec![0; (size * count) as usize];
    if size < 56 || open.read_exact(&mut segments).is_err() {
        return Some(false);
    }
    let ends =
        segments.chunks(size as usize).map(|segment| number(segment, 8, 8).saturating_add(number(segment, 32, 8)));
    Some(ends.max().is_none_or(|end| end <= length))
}

/// Returns what is wrong with a library that lacks these functions, and the way out.
fn without(lacks: &str) -> (String, &'static str) {
    let names: Vec<&str> = lacks.split(' ').map(str::trim).collect();
    match names.len() {
        FUNCTIONS.. => ("is no libsumo: it has none of SUMO's functions".into(), INSTALL),
        count => (
            format!("lacks {count} of SUMO's functions: {}; {OLDEST} and newer ones have them", names.join(", ")),
            INSTALL,
        ),
    }
}

/// Returns what the loader's words about a library mean, and the way out.
fn not_loaded(text: &str, file: &Path) -> (String, String) {
    let has = |words: &str| text.contains(words);
    let way_out = if has("failed to map segment") || has("Cannot allocate memory") {
        "allow this process more memory (ulimit -v)".to_owned()
    } else if has("version `GLIBC") {
        "this SUMO needs a newer system: pip install 'eclipse-sumo<1.26' has one for older systems".to_owned()
    } else if let Some(missing) = missing_dependency(text, file) {
        let package = PACKAGES
            .iter()
            .find(|(library, _)| *library == missing)
            .map(|(_, package)| format!("apt install {package}"));
        format!(
            "SUMO needs {missing} of the system: on Debian, {}",
            package.unwrap_or("install its package".into())
        )
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
fn missing_dependency<'a>(text: &'a str, file: &Path) -> Option<&'a str> {
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
        assert!(without("Vehicle::add Lane::getLength").0.starts_with("lacks 2 of SUMO's functions: Vehicle::add, "));
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
