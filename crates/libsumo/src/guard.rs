//! What happens when SUMO dies inside a call, or never comes back from one.
//!
//! SUMO has assertions that abort. With some numbers it computes without an end or takes all memory. It is in this process, so the
//! process ends with it. Before that, one message says what was simulated, at which second of an episode, and
//! what to do. It is the same in every program that uses this crate, and in Python.
//!
//! - **Death**: a handler of SIGABRT, SIGSEGV, SIGBUS, SIGFPE and SIGILL writes the message. Then the process ends by the same
//!   signal, as it would have without the handler. SUMO's own last words came before.
//! - **No end**: a thread looks once a second whether SUMO is still in the same call. If that has used more CPU time or taken more
//!   memory than [`Limits`] allow, it writes the message and ends the process with exit code 1.
//!
//! # Why not otherwise
//!
//! **Is a signal handler sound here?** A handler may not allocate, lock or format, because the thread may be in the middle of that.
//! This one does not: it copies texts that lie ready in static memory into a line on its stack, and calls `write`. It does not
//! try to go on.
//!
//! **Why does it speak only of a thread inside SUMO?** A fault elsewhere has another cause and its own handlers: Rust's for a
//! used-up stack, and Python's. They were there before and get the signal next.
//!
//! **Why a thread, and not a timer (`setitimer`, `timer_settime`)?** A timer would be set and stopped in every step, two calls of the
//! system each, and its signal might interrupt the program elsewhere. The thread costs a call a few stores.
//!
//! **Why the CPU time of the one thread?** The clock on the wall goes on while other programs have the cores. The time of the
//! process grows with its other threads. So a busy machine changes nothing.
//!
//! **Why not `RLIMIT_CPU` and `RLIMIT_AS`?** They count over the whole life of a process, which may be a training of days.

use std::ffi::CString;

use super::ffi;

/// Limits of one call of SUMO.
///
/// The defaults are far above what was measured: the largest network, of 10 000 lights, loads in 30 s.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Seconds of CPU time to load.
    pub load_s: u64,
    /// Seconds of CPU time for any other call, such as a second of a simulation.
    pub step_s: u64,
    /// Memory that a call may take, in MiB.
    pub memory_mib: u64,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits { load_s: 600, step_s: 120, memory_mib: 8192 }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Call {
    Load,
    Step,
    Other,
}

/// A thread that is inside SUMO while this lives.
pub(crate) struct Inside;

impl Inside {
    /// `second`: that of the episode.
    pub(crate) fn enter(call: Call, second: u64) -> Inside {
        let call = match call {
            Call::Load => ffi::DS_LOADING,
            Call::Step => ffi::DS_STEPPING,
            Call::Other => ffi::DS_OTHER,
        };
        // SAFETY: it only stores numbers. One thread is inside at a time, because it has the turn.
        unsafe { ffi::ds_enter(call, second) };
        Inside
    }
}

impl Drop for Inside {
    fn drop(&mut self) {
        // SAFETY: as in `enter`.
        unsafe { ffi::ds_leave() }
    }
}

/// Begins to watch. Called once, when the library was opened.
pub(crate) fn begin() {
    // SAFETY: the library opens once, so this is called once.
    unsafe { ffi::ds_guard() }
}

/// Says what is simulated, and what to do if that ends the process. The caller has the turn.
pub(crate) fn name(what: &str, way_out: &str) {
    let [what, way_out] =
        [what, way_out].map(|text| CString::new(text.replace('\0', "?")).expect("it has no zero byte"));
    // SAFETY: both end in zero, and are copied.
    unsafe { ffi::ds_name(what.as_ptr(), way_out.as_ptr()) }
}

pub(crate) fn limit(Limits { load_s, step_s, memory_mib }: Limits) {
    // SAFETY: it only stores numbers.
    unsafe { ffi::ds_limit(load_s, step_s, memory_mib) }
}
