//! Stand-ins for libraries of the system that are missing and that no simulation needs.
//!
//! SUMO's library holds its window, too. So the wheels of SUMO need X11 and OpenGL from the system, which many machines do not have:
//! containers, servers, clusters without root. Two of the libraries in the wheels from 1.26 on also name libatomic, and call nothing
//! in it. Without these five libraries, the loader refuses SUMO. A simulation never calls them.
//!
//! So, only after the loader has missed one of them, a library with its name and empty functions takes its place in this
//! process. It lies in memory and in no file. One that the loader finds is never shadowed.
//!
//! # Why not otherwise
//!
//! **Why functions, if nobody calls them?** Some libraries of the wheels are bound when they are loaded, function by function.
//! One that is missing is an error then.

use super::ffi;

/// Number of libraries with a stand-in.
pub(crate) const COUNT: usize = 5;

/// The libraries, each with the bytes of its stand-in.
const STAND_INS: [(&str, &[u8]); COUNT] = include!(concat!(env!("OUT_DIR"), "/stand_ins.in"));

/// Loads the stand-in for a library. Returns whether that was possible.
pub(crate) fn load(library: &str) -> bool {
    let Some((_, bytes)) = STAND_INS.iter().find(|(name, _)| *name == library) else { return false };
    // SAFETY: pointer and length are those of one slice. Nobody is inside libsumo, because it could not be loaded.
    unsafe { ffi::ds_open_bytes(bytes.as_ptr().cast(), bytes.len()) == 0 }
}
