//! Runs: what the command line and the Python package stand on.
//!
//! - [`config`]: the config of a run; [`domains`]: the domains that it can name.
//! - [`fleet`]: workers and their coordinator.
//! - [`records`]: run directories, written and read.
//! - [`cost`], [`mod@bench`]: how often a run does what, and what that costs.
//! - [`python`]: functions and objects of a Python process that take part in a run.
//! - [`machine`]: limits of the machine; [`terminal`]: printed lines, progress, Ctrl-C.
//!
//! GS: global simulator. LS: local simulator. AIP: approximate influence predictor. F: timesteps between two trainings
//! of the AIPs.

pub mod bench;
pub mod build;
pub mod config;
pub mod cost;
pub mod directory;
pub mod domains;
pub mod error;
pub mod experiment;
pub mod fleet;
pub mod machine;
pub mod outputs;
pub mod parent;
pub mod places;
pub mod python;
pub mod records;
pub mod terminal;
pub mod trial;
