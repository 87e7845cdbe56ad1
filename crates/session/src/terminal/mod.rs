//! The terminal: printed lines, progress bars, commands to copy, and Ctrl-C.
//!
//! - `say`: messages on standard error, results on standard output. Names in them cannot act on the terminal. And
//!   programs on the PATH.
//! - `stop`: Ctrl-C, SIGTERM and SIGHUP.
//! - [`training`], [`experiment`]: the progress of `train` and `bench`, and of `experiment`.
//!   [`counting`]: that of episodes and other things that are counted. All show bars on a terminal and plain lines
//!   elsewhere.
//!
//! This room only shows what other rooms hand to it. It starts no work and reads no file.

pub mod counting;
pub mod experiment;
mod say;
mod stop;
pub mod training;

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use dials_core::base::Activity;

pub use say::{Talk, answer, json, note, on_the_path, program, shows_bars, talk, talks, warn};
pub use stop::{Wish, check_stop, stop_on_signals};

/// Makes a bar, hidden where no bars are shown. A hidden one keeps its numbers and message. `None`: unknown length.
fn bar(length: Option<u64>, template: &str) -> ProgressBar {
    let target = if shows_bars() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    ProgressBar::with_draw_target(length, target).with_style(style(template))
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the template is well-formed")
}

fn doing(activity: Activity) -> &'static str {
    match activity {
        Activity::Training => "training policies",
        Activity::Collection => "collecting datasets",
        Activity::AipTraining => "training AIPs",
        Activity::Evaluation => "evaluating",
    }
}

/// Returns a duration as text: `42 s`, `3 min 20 s` or `2 h 5 min`.
fn duration(duration: Duration) -> String {
    let seconds = duration.as_secs();
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}
