//! Ends of the process that the system would choose, and the end that the program chooses.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, Result};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};

/// Makes a write beyond the limit of a file's size an error. Otherwise the system kills the process.
pub fn survive_full_files() -> Result<()> {
    survive(&[SIGXFSZ])
}

/// Makes SIGINT, SIGTERM and SIGHUP mean nothing: another process gets them too, and ends this one when it is ready.
pub fn leave_signals_to_another() -> Result<()> {
    survive(&[SIGINT, SIGTERM, SIGHUP])
}

fn survive(signals: &[i32]) -> Result<()> {
    for &signal in signals {
        // Nobody reads the flag: a signal that is handled does not kill.
        signal_hook::flag::register(signal, Arc::new(AtomicBool::new(false))).context("cannot handle signals")?;
    }
    Ok(())
}

/// Ends the process at once. Skips the destructors of C and C++ libraries: they may hang where memory is short.
pub fn end_now(code: u8) -> ! {
    signal_hook::low_level::exit(code.into())
}
