//! What is on the roads, for functions of the user in the Python process.
//!
//! Its size changes with the number of vehicles, so it lies behind all other sections of the shared memory, which grows
//! with it. Every answer to a reset or a step says how many bytes there are.

use std::cell::RefCell;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::rc::Rc;
use std::time::Duration;

use anyhow::{Context, Result};
use dials_core::domain::own::OwnRows;
use dials_core::domain::roads::RoadsNow;

/// The end of the shared memory.
pub(crate) struct RoadMemory {
    file: File,
    begin: u64,
    bytes: Vec<u8>,
}

impl RoadMemory {
    pub(crate) fn new(file: File, begin: u64) -> RoadMemory {
        RoadMemory { file, begin, bytes: Vec::new() }
    }

    /// Shows the roads to the Python process. `begun`: those after the beginning of further episodes in the same step.
    /// Returns the payload of the answer: the number of bytes of both, four bytes each. 0: there is none.
    pub(crate) fn show(&mut self, now: &RoadsNow, begun: Option<&RoadsNow>) -> Result<Vec<u8>> {
        self.bytes.clear();
        now.put(&mut self.bytes);
        let first = self.bytes.len();
        begun.into_iter().for_each(|begun| begun.put(&mut self.bytes));
        self.file.write_all_at(&self.bytes, self.begin).context("cannot write the shared memory")?;
        let second = self.bytes.len() - first;
        Ok([first, second].map(|length| (length as u32).to_le_bytes()).concat())
    }
}

/// The roads of local simulators after their last step, and after the beginnings of episodes since.
#[derive(Default)]
pub(crate) struct Tapped {
    pub(crate) now: RoadsNow,
    pub(crate) begun: Option<RoadsNow>,
}

/// Keeps the roads for the Python process, which computes rewards and observations.
pub(crate) struct Tap(pub(crate) Rc<RefCell<Tapped>>);

impl OwnRows for Tap {
    fn begin(&mut self, now: &RoadsNow, _rows: &[usize], _obs: &mut [f32]) -> Result<()> {
        self.0.borrow_mut().begun = Some(now.clone());
        Ok(())
    }

    fn step(&mut self, now: &RoadsNow, _stepped: Duration, _rewards: &mut [f32], _obs: &mut [f32]) -> Result<()> {
        let mut tapped = self.0.borrow_mut();
        tapped.now.clone_from(now);
        tapped.begun = None;
        Ok(())
    }
}
