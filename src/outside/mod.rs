//! What comes from outside this program: files that others may have written, and names that others chose.
//!
//! - `file`: reads regular files only, up to a size. A pipe, a device or a file without end is an error, not a hang.
//! - `temporary`: temporary files, with an error that names the place.
//! - `printable`: names as they may reach a terminal, a picture or a report.

mod file;
mod printable;
mod temporary;

pub use file::{read_bytes, read_text};
pub use printable::{Printable, is_printable};
pub use temporary::{cannot_write_temporary, temporary_dir, temporary_file};
