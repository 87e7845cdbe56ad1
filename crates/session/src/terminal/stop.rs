//! Ctrl-C and SIGTERM: the first one asks the work to stop, the second one ends the process at once.
//!
//! A separate thread waits for them, so that neither has to wait for the work.

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::low_level::{exit, pipe};

/// Exit code of an interrupted process, the same as a shell uses.
const INTERRUPTED: i32 = 130;
/// Longest time to wait for the last line to be printed. A stopped terminal or a full pipe may block for ever.
const LAST_WORDS: Duration = Duration::from_secs(1);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// The first signal: stop where nothing is lost.
    Stop,
    /// The second signal: stop now. The process ends as soon as the last line is printed.
    StopNow,
}

/// Handles the signals and returns the flag that the first one sets. `announce` has its own thread and may block.
pub fn stop_on_signals(announce: impl Fn(Wish) + Send + Sync + 'static) -> Result<Arc<AtomicBool>> {
    let failed = "cannot handle signals";
    let stop = Arc::new(AtomicBool::new(false));
    let (mut signals, theirs) = UnixStream::pair().context(failed)?;
    for signal in [SIGINT, SIGTERM] {
        // One byte per signal, so that two signals in quick succession count as two.
        pipe::register(signal, theirs.try_clone().context(failed)?).context(failed)?;
    }
    let (flag, announce) = (stop.clone(), Arc::new(announce));
    let listen = move || {
        let mut byte = [0];
        while signals.read_exact(&mut byte).is_ok() {
            let first = !flag.swap(true, Ordering::Relaxed);
            let wish = if first { Wish::Stop } else { Wish::StopNow };
            let (announce, (done, said)) = (announce.clone(), channel());
            // If the thread cannot start, nothing is printed, but the process stops all the same.
            let _ = thread::Builder::new().spawn(move || {
                announce(wish);
                let _ = done.send(());
            });
            if wish == Wish::StopNow {
                let _ = said.recv_timeout(LAST_WORDS);
                // Skips the destructors of libraries at work. Linux kills the workers with their parent.
                exit(INTERRUPTED);
            }
        }
    };
    thread::Builder::new().name("signals".to_owned()).spawn(listen).context(failed)?;
    Ok(stop)
}

/// Returns an error if the flag of [`stop_on_signals`] is set.
pub fn check_stop(stop: &AtomicBool) -> Result<()> {
    ensure!(!stop.load(Ordering::Relaxed), "stopped");
    Ok(())
}
