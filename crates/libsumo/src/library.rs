//! libsumo itself: loaded when it is first needed, and its functions found by name.
//!
//! # Why not otherwise
//!
//! **Why is libsumo not simply linked?** It brings 220 shared libraries (GDAL, FOX, OpenGL, X11 and what these need). A
//! program that links it loads and relocates all of them at every start, even for `--help`, or in a process that never
//! simulates. Where one of them is missing, the system's loader ends the program before `main`, with a line that names a
//! file and no cure. Loaded late, the same mistake is an [`Error::Library`] that a program can handle or explain.
//!
//! **Why by name, and why a jump?** The usual way is a table of function pointers, filled by `dlsym` and called through
//! pointer types. That works for C. libsumo's interface is C++: static functions of classes, whose names are mangled, that
//! take `const std::string &`, have default arguments, return strings and vectors through hidden pointers, and throw.
//! Pointer types for them would repeat SUMO's headers by hand, and nobody would check that they still agree.
//!
//! So the shim is compiled against SUMO's own headers, as if libsumo were linked, and the compiler checks every call. The
//! object file then has undefined symbols, one per function that it calls. build.rs lists them with `nm`, so the list is
//! never out of date, and looks each of them up in the library, so a SUMO that lacks one fails the build and not a run.
//! `shim/late.S` defines each as a single jump to an address that [`load`] has found by that name. A jump touches no
//! register and makes no frame on the stack. So it fits every signature, and an exception of SUMO unwinds from libsumo
//! right into the shim, which catches it.
//!
//! **What else was considered.** *Weak symbols* stay null for ever once the program runs. GNU's linker has no *delayed
//! loading*, as Windows' has. The shim as a *shared library of its own*, opened late, would need no assembler. But it would be
//! a second file beside every program, which must be found, and must be of the same build.
//!
//! **Why `RTLD_LAZY | RTLD_LOCAL`?** Lazily, because libsumo's own 220 libraries are bound as in any program that links
//! them: at the first call of a function. Most are never called. Locally, so that no symbol of theirs replaces one of the
//! program's.
//!
//! **Why is it never unloaded?** Libraries below it register destructors and thread-local data, which would be called
//! after their code is gone.

use std::ffi::CStr;
use std::sync::OnceLock;

use super::error::{Error, Result};
use super::{call, ffi};

/// Path of the library, or its name if it is where the system looks; ends in zero.
const LIBRARY: &str = concat!(env!("LIBSUMO_LIBRARY"), "\0");

/// Loads libsumo, if this process has not done so yet. Every other function of this crate that needs it does so by itself:
/// call this to learn early whether SUMO is there, or to take the time of loading out of a measurement.
///
/// # Errors
/// [`Error::Library`] if it cannot be loaded. The outcome is remembered: later calls return the same.
pub fn load() -> Result<()> {
    static LOADED: OnceLock<std::result::Result<(), String>> = OnceLock::new();
    let loaded = LOADED.get_or_init(|| {
        let library = CStr::from_bytes_with_nul(LIBRARY.as_bytes()).expect("build.rs writes no zero");
        // SAFETY: the pointer is a string that ends in zero. Nobody is inside libsumo, because nobody has loaded it.
        call::ask(unsafe { ffi::ds_open(library.as_ptr()) })
    });
    loaded.clone().map_err(|text| Error::Library { way_out: way_out(&text), text })
}

fn way_out(text: &str) -> &'static str {
    match text.contains("failed to map segment") {
        true => "allow this process more memory (ulimit -v)",
        false => "install SUMO 1.15 (on Debian 12: apt install sumo), and build this program again if it moved",
    }
}
