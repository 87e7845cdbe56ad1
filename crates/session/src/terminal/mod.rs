//! The terminal: printed lines, progress bars, commands to copy, and Ctrl-C.
//!
//! - `say`: messages on standard error, results on standard output. Names in them cannot act on the terminal.
//! - `shell`: finds programs on the PATH.
//! - `stop`: Ctrl-C and SIGTERM.
//! - [`training`], [`measuring`], [`experiment`]: the progress of `train`, `bench` and `experiment`. They show bars on
//!   a terminal and plain lines elsewhere.
//! - [`counting`]: the progress of episodes and other things that are counted, in the same way.
//! - `activity`, `duration`: activities and durations as text.
//!
//! This room only shows what other rooms hand to it. It starts no work and reads no file.

mod activity;
pub mod counting;
mod duration;
pub mod experiment;
pub mod measuring;
mod say;
mod shell;
mod stop;
pub mod training;

pub use say::{Talk, answer, json, note, shows_bars, talk, talks, warn};
pub use shell::{on_the_path, program};
pub use stop::{Wish, check_stop, stop_on_signals};
