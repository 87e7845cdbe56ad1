//! Ways past SUMO's interface, where that saves time.
//!
//! libsumo's interface looks everything up by name, and passes texts. Four shortcuts go past it:
//!
//! - **Devices.** For each car SUMO looks up the options of some fifteen kinds of devices. With
//!   [`few_devices`](crate::Simulation::few_devices) it looks up two.
//! - **Generators.** The random generators of lanes are seeded in memory, and not through the text of a saved state.
//! - **Lanes.** The cars on a lane are read from the lane, and their names only once.
//! - **Texts.** SUMO translates a text of an error for each car in each step. It is left as it is.
//!
//! They change no number. Each uses functions and data that SUMO's library exports and its interface does not name. A shortcut whose
//! symbols are absent is not taken. Only versions that were tried have any (1.15 to 1.28). And nothing is taken on trust:
//!
//! - The first generator is seeded both ways. The bytes in memory must be the same.
//! - Where a lane has a car that was not seen before, the lane is read both ways. All positions and speeds must be the same.
//! - The functions that make devices and translate are replaced only where SUMO's library calls them, in its own table.
//!
//! If bytes, positions or speeds differ, that shortcut ends. With [`VARIABLE`] `off` there are none. `src/shim/inside.h` and `src/shim/detours.cpp` are
//! the other side.

use std::env;

use super::ffi;
use super::version::Version;

/// Variable of the environment that switches the shortcuts off: `off`.
pub const VARIABLE: &str = "DIALS_SUMO_SHORTCUTS";

const ALL: [(ffi::ds_shortcut, &str); 4] = [
    (ffi::DS_DEVICES, "devices"),
    (ffi::DS_GENERATORS, "generators"),
    (ffi::DS_LANES, "lanes"),
    (ffi::DS_TEXTS, "texts"),
];

/// Takes the shortcuts that there are. The library was opened just now.
pub(crate) fn take(version: Version) {
    if version.is_tried() && env::var_os(VARIABLE).is_none_or(|value| value != "off") {
        // SAFETY: the library is open, and nobody is inside, because nobody has it yet.
        unsafe { ffi::ds_take_shortcuts() };
    }
}

/// Returns the names of the shortcuts among these bits.
pub(crate) fn names(taken: i32) -> Vec<&'static str> {
    ALL.into_iter().filter(|(bit, _)| taken as ffi::ds_shortcut & bit != 0).map(|(_, name)| name).collect()
}
