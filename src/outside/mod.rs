//! What comes from outside this program: files that others may have written, and names that others chose.
//!
//! - `file`: reads regular files only, up to a size. A pipe, a device or a file without end is an error, not a hang.
//! - `directory`: a directory that is opened once, may be locked, and whose files are never reached through a link.
//! - `staged`: directories that are filled under a temporary name, and the sweeping of what kills left behind.
//! - `temporary`: temporary files, with an error that names the place.
//! - [`tree`]: XML read into a tree, with limits.
//! - `printable`: names as they may reach a terminal, a picture or a report.
//! - `name`: names that may become files and directories.
//! - `cell`: names as fields of a CSV file.

mod cell;
mod directory;
mod file;
mod name;
mod printable;
mod staged;
mod temporary;
pub mod tree;

pub use cell::csv_name;
pub use directory::{Directory, Whereabouts};
pub use file::{read_bytes, read_text};
pub use name::FileName;
pub use printable::{Printable, excerpt, is_printable};
pub use staged::{StagedDirectory, rename_to_free, sweep_files};
pub use temporary::{cannot_write_temporary, temporary_dir, temporary_file};
