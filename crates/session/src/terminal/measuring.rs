//! The progress of `bench`.

use std::cell::RefCell;
use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressStyle};

use super::activity::doing;
use super::{Talk, Wish, note, shows_bars, stop_on_signals, talks, warn};
use dials_core::base::Activity;
use dials_core::base::counted;
use dials_learn::training::observer::Observer;

/// The progress of `bench`: a status line on a terminal, elsewhere one line per fleet.
///
/// The first Ctrl-C stops at once, because nothing can be lost.
pub struct BenchProgress {
    line: ProgressBar,
    fleet: RefCell<String>,
    stop: Arc<AtomicBool>,
}

impl BenchProgress {
    /// Starts the display, and listens for Ctrl-C from here on.
    pub fn new() -> anyhow::Result<Self> {
        let style =
            ProgressStyle::with_template("{spinner} {elapsed}  {wide_msg}").expect("the template is well-formed");
        let line = if talks(Talk::Normal) { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        let line = line.with_style(style);
        line.set_message("peak speed of matrix products");
        let place = line.clone();
        let stop = stop_on_signals(move |wish| match wish {
            Wish::Stop => (), // `bench` stops at once
            Wish::StopNow => place.suspend(|| warn("stopped")),
        })?;
        Ok(BenchProgress { line, fleet: RefCell::default(), stop })
    }

    /// Shows that the fleet with this number of workers is measured. `most`: the largest number that will be.
    pub fn begin(&self, workers: usize, most: usize) {
        let fleet = format!("{workers} of {}", counted(most, "worker"));
        if !shows_bars() {
            note(format_args!("measuring with {fleet}"));
        }
        self.line.set_message(fleet.clone());
        self.fleet.replace(fleet);
    }

    pub fn finish(&self) {
        self.line.finish_and_clear();
    }

    fn show(&self, doing: impl Display) {
        self.line.set_message(format!("{}: {doing}", self.fleet.borrow()));
        self.line.tick();
    }
}

impl Observer for BenchProgress {
    fn trained(&self, steps: u64) {
        self.show(format_args!("{}, step {steps}", doing(Activity::Training)));
    }

    fn busy(&self, activity: Activity, share: f64) {
        self.show(format_args!("{} {:.0} %", doing(activity), 100.0 * share));
    }

    fn worker_lost(&self, message: &str) {
        self.line.suspend(|| warn(format_args!("warning: {message}")));
    }

    fn stop_requested(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn keeps_results(&self) -> bool {
        false
    }
}
