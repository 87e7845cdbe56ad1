//! libsumo itself: loaded when it is first needed.
//!
//! It brings 220 shared libraries, and most commands need none of them. `shim/late.S` says how it comes after the start.

use std::ffi::CStr;
use std::sync::OnceLock;

use super::error::{Error, Result};
use super::{call, ffi};

/// Path of the library, or its name if it is where the system looks; ends in zero.
const LIBRARY: &str = concat!(env!("DIALS_SUMO_LIBRARY"), "\0");

/// Loads libsumo, if this process has not done so yet. Every other call of this room does so by itself.
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
        false => "install SUMO 1.15 (./setup.sh does so on Debian 12), and build this program again if it moved",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_out_of_too_little_memory_is_not_to_install() {
        assert!(way_out("libgdal.so.32: failed to map segment from shared object").contains("ulimit"));
        assert!(way_out("libsumocpp.so: cannot open shared object file: No such file").contains("./setup.sh"));
    }
}
