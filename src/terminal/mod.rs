//! What a person at the terminal sees and says: lines, bars, commands to copy, and Ctrl-C.
//!
//! - `say`: lines on standard error, answers on standard output.
//! - `shell`: programs on the PATH, and paths as words of a command to copy.
//! - `stop`: Ctrl-C and SIGTERM.
//! - [`training`], [`measuring`], [`experiment`], [`counting`]: the progress of `train`, of `bench`, of `experiment`, and of what
//!   is counted, such as episodes. A bar on a terminal, plain lines elsewhere.
//! - `activity`, `duration`: their words.
//!
//! What it shows it is told; it starts nothing and reads no file.

mod activity;
pub mod counting;
mod duration;
pub mod experiment;
pub mod measuring;
mod say;
mod shell;
mod stop;
pub mod training;

pub use say::{answer, tell};
pub use shell::{on_the_path, program, quoted};
pub use stop::{Wish, check_stop, stop_on_signals};
