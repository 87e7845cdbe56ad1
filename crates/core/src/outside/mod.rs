//! What comes from outside this program: files that others may have written, and names that others chose.
//!
//! - `file`: reads regular files only, up to a size. A pipe, a device or a file without end is an error, not a hang.
//!   Temporary files, with an error that names the place.
//! - `directory`: a directory that this program writes, its lock and its files.
//! - `staged`: files and directories that appear whole or not at all, and the sweeping of what kills left behind.
//! - [`tree`]: XML read into a tree, with limits.
//! - `printable`: names as they may reach a terminal, a picture, a report or a CSV file.
//! - `quoted`: words of a command to copy. They come back from a shell as they were.
//! - `name`: names that may become files and directories.
//! - `alike`: names that a mistyped name may have meant. `plain_words`: errors of their readers in plain words.

mod alike;
mod directory;
mod file;
mod name;
mod plain_words;
mod printable;
mod quoted;
mod staged;
pub mod tree;

pub use alike::did_you_mean;
pub use directory::{Busy, Directory, Whereabouts};
pub use file::{LARGEST_NETWORK, cannot_write_temporary, packed, read_bytes, read_text, temporary_dir, temporary_file};
pub use name::FileName;
pub use plain_words::in_plain_words;
pub use printable::{Printable, beginning, csv_name, excerpt, is_printable};
pub use quoted::{path_as_text, quoted, quoted_word};
pub use staged::{StagedDirectory, folder_of, rename_to_free, sweep, write_together};
