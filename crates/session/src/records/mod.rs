//! The run directory: the files of a run, written as it proceeds, and read again.
//!
//! CSV files grow by whole blocks of lines, one write per block. All other files are written beside their place and
//! then moved there. So a kill loses at most the current period, and the files can be read at any time. Who writes
//! holds the directory's lock, and reaches the files through the opened directory.
//!
//! docs/files.md lists the files.
//!
//! - [`files`], [`columns`]: the names of the files, and of the columns of each CSV file, for writers and readers.
//! - [`growing`], [`tensorboard`]: files that grow, so that a kill or a full disk loses nothing, and a change by others is
//!   noticed.
//! - `lines`: the lines of the CSV files.
//! - [`checkpoint`]: the state of all agents, from which a run continues. [`resume_point`]: which checkpoint fits the
//!   files. [`networks`]: the files of policies and AIPs. [`mod@prepared`]: what local simulators are made from.
//! - [`run_json`]: how the run was called, what computed it, and the keys and files of its domain, to notice a change.
//! - [`run_log`]: writes all this during training, but no networks that have diverged.
//! - [`run_record`], [`reader`], [`csv_table`]: the contents of a run directory, never of a live one.
//! - [`find`]: runs, baselines and plans under some folders. [`method`]: the part of a config that makes runs comparable.

pub mod checkpoint;
pub(crate) mod columns;
pub(crate) mod csv_table;
pub mod files;
pub mod find;
pub mod growing;
mod lines;
pub mod method;
pub mod networks;
pub mod prepared;
pub(crate) mod reader;
pub mod resume_point;
pub mod run_json;
pub mod run_log;
pub mod run_record;
pub(crate) mod tensorboard;
