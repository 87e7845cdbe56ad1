//! Ctrl-C, SIGTERM and SIGHUP: the first one asks the work to stop, a later one ends the process at once.
//!
//! A separate thread waits for them, so that neither has to wait for the work.
//!
//! # Why a second signal within two seconds does not count
//!
//! GNU `timeout` sends its signal to the process and then to its process group, so twice within milliseconds. It does not
//! mean "at once".

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::low_level::{exit, pipe};

/// Exit code of an interrupted process, the same as a shell uses.
const INTERRUPTED: i32 = 130;
/// Longest time to wait for the last line to be printed. A stopped terminal or a full pipe may block for ever.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// Time after the first signal in which others are taken for the same.
const ONE_SIGNAL: Duration = Duration::from_secs(2);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// The first signal: stop where nothing is lost.
    Stop,
    /// A later signal: stop now. The process ends as soon as the last line is printed.
    StopNow,
}

/// Handles the signals and returns the flag that the first one sets. `announce` has its own thread and may block.
pub fn stop_on_signals(announce: impl Fn(Wish) + Send + Sync + 'static) -> Result<Arc<AtomicBool>> {
    let failed = "cannot handle signals";
    let stop = Arc::new(AtomicBool::new(false));
    let (mut signals, theirs) = UnixStream::pair().context(failed)?;
    // `nohup` lets SIGHUP be ignored. That stays so.
    let hangs_up = (!is_ignored(SIGHUP)).then_some(SIGHUP);
    for signal in [SIGINT, SIGTERM].into_iter().chain(hangs_up) {
        pipe::register(signal, theirs.try_clone().context(failed)?).context(failed)?;
    }
    let (flag, announce) = (stop.clone(), Arc::new(announce));
    let listen = move || {
        let (mut byte, mut first) = ([0], None);
        while signals.read_exact(&mut byte).is_ok() {
            let wish = match first {
                None => Wish::Stop,
                Some(first) if Instant::now() - first < ONE_SIGNAL => continue,
                Some(_) => Wish::StopNow,
            };
            first.get_or_insert_with(Instant::now);
            flag.store(true, Ordering::Relaxed);
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

/// Returns whether this process was started with a signal ignored.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask & 1 << (signal - 1) != 0)
}

/// Returns an error if the flag of [`stop_on_signals`] is set.
pub fn check_stop(stop: &AtomicBool) -> Result<()> {
    ensure!(!stop.load(Ordering::Relaxed), "stopped");
    Ok(())
}
