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
//! names, and more where a version takes a text by value. Written down, they would be some eighty long names. The compiler
//! knows them: `shim/late.h` takes a function's type as the compiler names it, and makes the symbol's name of it.
//!
//! **Why is the shim compiled twice?** A std::string made with one of the two types cannot be read as the other.
//! `shim/open.cpp` takes the build of the shim that finds its functions. The streams (std::cerr) and exceptions are the same for
//! both, because both use this process's libstdc++. So it is linked dynamically.
//!
//! **What else was considered.** *Assembler*: one jump per function, in place of the function itself, fits every signature. So it
//! was here once, with SUMO's headers; but only on x86-64, and for one type of string. *The shim as a shared library of its own*
//! would be a second file beside every program, which must be found, and must be of the same build.
//!
//! **Why `RTLD_LAZY | RTLD_LOCAL`?** Lazily, because libsumo's own libraries are bound as in any program that links them: at the
//! first call of a function. Most are never called. Locally, so that no symbol of theirs replaces one of the program's.
//!
//! **Why is it never unloaded?** Libraries below it register destructors and thread-local data, which would be called
//! after their code is gone.

use std::ffi::{CStr, CString, OsStr};
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::OnceLock;

use super::call;
use super::error::{Error, Result};
use super::faults::{self, AGAIN, INSTALL};
use super::ffi;
use super::guard;
use super::places::{LIBRARY, PACKAGE, Place, VARIABLE, places, taken};
use super::shortcuts;
use super::stand_ins;
use super::version::{OLDEST, Version};

/// Code of [`ffi::ds_open`] for a library that lacks functions.
const LACKS: i32 = 2;

/// The library of SUMO that this process has loaded.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Library {
    /// SUMO's own words, such as `SUMO 1.15.0`.
    pub name: String,
    /// The number in them.
    pub version: Version,
    /// Its file.
    pub file: PathBuf,
    /// Who named it: [`Place::source`].
    pub source: &'static str,
    pub(crate) shim: &'static ffi::ds_shim,
}

impl Library {
    /// Returns who built it: `wheel` for Python's package `eclipse-sumo`; the name of the system, such as `debian 12`, for a library
    /// in its folders; else `another`.
    ///
    /// Debian's has its assertions on, for example, and the wheel's has them off.
    pub fn builder(&self) -> String {
        let is_systems = ["/usr/lib", "/lib"].iter().any(|folder| self.file.starts_with(folder));
        if is_systems {
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

static LOADED: OnceLock<Result<Library>> = OnceLock::new();

/// Returns a variable of the environment that lets a child of this process load the same library. `None`: none is loaded.
pub fn variable_for_children() -> Option<(&'static str, &'static Path)> {
    let library = LOADED.get()?.as_ref().ok()?;
    Some((VARIABLE, &library.file))
}

/// Loads libsumo, if this process has not done so yet, from the first of the [`places`] that has it. Every other function of this
/// crate that needs it does so by itself: call this to learn early whether SUMO is there, or to take the time of loading out of a
/// measurement.
///
/// # Errors
/// [`Error::Library`] if there is none, or one that cannot be used. The outcome is remembered: later calls return the same.
pub fn load() -> Result<&'static Library> {
    LOADED.get_or_init(|| open(&places())).as_ref().map_err(Error::clone)
}

/// Opens the library in the first place that has it.
fn open(places: &[Place]) -> Result<Library> {
    let place = taken(places).or(places.last()).expect("there is always a place");
    let file = &place.library;
    let fail = |text: String, way_out: &str| {
        let text = format!("{} ({}): {text}", file.display(), place.source);
        Err(Error::Library { text, way_out: way_out.to_owned() })
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
    if place.is_there == Some(true) && !faults::is_whole(file).unwrap_or(true) {
        return fail("is damaged: its end is missing".into(), AGAIN);
    }
    let name = CString::new(file.as_os_str().as_bytes()).expect("a path that was looked at has no zero");
    let (mut shim, mut version, mut whole) = (ptr::null(), ptr::null(), ptr::null());
    let mut open_it = || {
        // SAFETY: the name is a string that ends in zero; the others are only written to. Nobody is inside libsumo, because nobody
        // has loaded it.
        let code = unsafe { ffi::ds_open(name.as_ptr(), &mut shim, &mut version, &mut whole) };
        call::ask(code).map_err(|text| (code, text))
    };
    let mut opened = open_it();
    for _ in 0..stand_ins::COUNT {
        match &opened {
            Err((_, text)) if faults::missing_dependency(text, file).is_some_and(stand_ins::load) => opened = open_it(),
            _ => break,
        }
    }
    match opened {
        Ok(()) => {}
        Err((LACKS, lacks)) => {
            let (text, way_out) = faults::lacking(&lacks);
            return fail(text, way_out);
        }
        Err((_, text)) => {
            let (text, way_out) = faults::not_loaded(&text, file);
            return fail(text, &way_out);
        }
    }
    // SAFETY: the call succeeded, so all are written, and hold as long as the process.
    let (shim, name, whole) = unsafe { (&*shim, CStr::from_ptr(version), CStr::from_ptr(whole)) };
    let (name, loaded) = (name.to_string_lossy().into_owned(), OsStr::from_bytes(whole.to_bytes()).into());
    match Version::parse(&name) {
        Some(version) if version >= OLDEST => {
            shortcuts::take(version);
            guard::begin();
            Ok(Library { name, version, file: loaded, source: place.source, shim })
        }
        _ => fail(format!("is {name}, but {OLDEST} or a newer one is needed"), INSTALL),
    }
}
