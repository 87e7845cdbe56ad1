//! Ends this process together with the Python process that started it.
//!
//! The system could kill a child with its parent, but it counts the thread that started the child as the parent. An
//! environment may outlive a thread. The end of the control channel is no sign either: a copy of the parent, made by
//! `fork`, may hold it open, and a busy simulator does not read it. So this process looks who its parent is.

use std::os::unix::process::parent_id;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};
use dials_session::machine::end_now;

/// Time between two looks at the parent.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// Watches the parent from a thread of its own.
pub(crate) fn watch() -> Result<()> {
    let parent = parent_id();
    let watch = move || {
        while parent_id() == parent {
            thread::sleep(LOOK_EVERY);
        }
        end_now(0);
    };
    thread::Builder::new().name("lifeline".to_owned()).spawn(watch).context("no thread for the lifeline")?;
    Ok(())
}
