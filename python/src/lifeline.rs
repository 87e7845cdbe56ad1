//! Ends this process together with the Python process that started it.
//!
//! The system could kill a child with its parent, but it counts the thread that started the child as the parent. An
//! environment may outlive a thread, so this process watches for itself.

use std::os::fd::OwnedFd;
use std::thread;

use anyhow::{Context, Result};
use dials_traffic::machine::end_now;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::getppid;

/// Time between two looks at the parent. The end of the channel is seen at once; this is for a channel that a copy of
/// the parent, made by `fork`, holds open.
const LOOK_EVERY: Timespec = Timespec { tv_sec: 1, tv_nsec: 0 };

/// Watches the control channel from a thread of its own, also while a simulator is busy or hangs.
pub fn watch(control: OwnedFd) -> Result<()> {
    let parent = getppid();
    let watch = move || {
        loop {
            let mut ends = [PollFd::new(&control, PollFlags::RDHUP)];
            let heard = poll(&mut ends, Some(&LOOK_EVERY));
            let hung_up = heard.is_ok_and(|count| count > 0);
            if hung_up || getppid() != parent {
                end_now(0);
            }
        }
    };
    thread::Builder::new().name("lifeline".to_owned()).spawn(watch).context("no thread for the lifeline")?;
    Ok(())
}
