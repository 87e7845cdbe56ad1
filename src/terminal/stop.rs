//! Ctrl-C and SIGTERM: the first one asks the work to stop, the second one ends the process, whatever it is doing.
//!
//! A thread of its own hears them, so that neither has to wait for the work.

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

/// Exit code of an interrupted process, as the shell's own.
const INTERRUPTED: i32 = 130;
/// Longest time that the last words may take. The terminal or a full pipe may not take them at all.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// What a signal asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// The first signal: stop where nothing is lost.
    Stop,
    /// The second signal: stop now. The process ends as soon as the words are said.
    StopNow,
}

/// Hears the signals from here on and returns the flag that the first one sets.
///
/// `announce` says to the person what comes of a wish. It runs in a thread of its own and may block.
pub fn stop_on_signals(announce: impl Fn(Wish) + Send + Sync + 'static) -> Result<Arc<AtomicBool>> {
    let failed = "signals cannot be heard";
    let stop = Arc::new(AtomicBool::new(false));
    let (mut signals, theirs) = UnixStream::pair().context(failed)?;
    for signal in [SIGINT, SIGTERM] {
        // A byte for each, so that two that come quickly one after another are two.
        pipe::register(signal, theirs.try_clone().context(failed)?).context(failed)?;
    }
    let (flag, announce) = (stop.clone(), Arc::new(announce));
    let listen = move || {
        let mut byte = [0];
        while signals.read_exact(&mut byte).is_ok() {
            let first = !flag.swap(true, Ordering::Relaxed);
            let wish = if first { Wish::Stop } else { Wish::StopNow };
            let (announce, (done, said)) = (announce.clone(), channel());
            // Without a thread nothing is said, and the wish is granted all the same.
            let _ = thread::Builder::new().spawn(move || {
                announce(wish);
                let _ = done.send(());
            });
            if wish == Wish::StopNow {
                let _ = said.recv_timeout(LAST_WORDS);
                // Without the destructors of libraries that are at work. Linux kills the workers with their parent.
                exit(INTERRUPTED);
            }
        }
    };
    thread::Builder::new().name("signals".to_owned()).spawn(listen).context(failed)?;
    Ok(stop)
}

/// An error if the flag of [`stop_on_signals`] is set.
pub fn check_stop(stop: &AtomicBool) -> Result<()> {
    ensure!(!stop.load(Ordering::Relaxed), "stopped");
    Ok(())
}
