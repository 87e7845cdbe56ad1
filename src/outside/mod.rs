//! What comes from outside this program: files that others may have written, and names that others chose.
//!
//! - `file`: reads regular files only, up to a size. A pipe, a device or a file without end is an error, not a hang.
//! - `printable`: names as they may reach a terminal, a picture or a report.
//! - `name`: names that may become files and directories.
//! - `cell`: names as fields of a CSV file.

mod cell;
mod file;
mod name;
mod printable;

pub use cell::csv_name;
pub use file::{read_bytes, read_text};
pub use name::FileName;
pub use printable::{Printable, excerpt, is_printable};
