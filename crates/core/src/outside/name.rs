//! Names of files and directories that others chose.

use std::fmt::{self, Display, Formatter};
use std::ops::Deref;
use std::path::Path;

use anyhow::{Error, bail};
use serde::{Deserialize, Serialize};

use super::{excerpt, is_printable};

/// Longest name in bytes. File systems take 255; the rest is for the endings that this program adds.
const LONGEST: usize = 200;

/// A name that is one component of a path, on this file system and on others.
///
/// It is printable, has no `/`, does not begin with `.` or `-`, and has from 1 to 200 bytes. So no path that it is part
/// of leaves its folder, and no command takes it for an option.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String")]
pub struct FileName(String);

impl FileName {
    pub fn new(name: impl Into<String>) -> Result<FileName, Error> {
        let name = name.into();
        let wrong = match name.chars().next() {
            None => "it is empty".to_owned(),
            Some(first @ ('.' | '-')) => format!("it begins with `{first}`"),
            _ if name.len() > LONGEST => format!("it has {} bytes, and at most {LONGEST} are allowed", name.len()),
            _ if name.contains('/') => "it contains `/`".to_owned(),
            _ if !name.chars().all(is_printable) => "it contains a character that cannot be shown".to_owned(),
            _ => return Ok(FileName(name)),
        };
        bail!("`{}` cannot be the name of a file or a directory: {wrong}; choose another name", excerpt(&name))
    }
}

impl TryFrom<String> for FileName {
    type Error = Error;

    fn try_from(name: String) -> Result<FileName, Error> {
        FileName::new(name)
    }
}

impl Deref for FileName {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

impl AsRef<Path> for FileName {
    fn as_ref(&self) -> &Path {
        self.0.as_ref()
    }
}

impl Display for FileName {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_leave_its_folder_or_be_an_option_is_no_name() {
        let long = "x".repeat(201);
        for (name, wrong) in [
            ("", "it is empty"),
            ("..", "it begins with `.`"),
            ("-rf", "it begins with `-`"),
            ("a/b", "it contains `/`"),
            ("a\0", "a character that cannot be shown"),
            ("\u{202E}gpj.exe", "a character that cannot be shown"),
            (&long, "it has 201 bytes, and at most 200 are allowed"),
        ] {
            let error = FileName::new(name).unwrap_err().to_string();
            assert!(error.contains(wrong) && error.len() < 250, "{error}");
            assert!(error.chars().all(is_printable), "{error}");
        }
        for name in ["small-fixed-time:file=a_b.toml", "Süd 交差点", "a..b", &long[1..]] {
            let written = serde_json::to_string(name).unwrap();
            assert_eq!(serde_json::from_str::<FileName>(&written).unwrap().to_string(), name);
        }
    }
}
