//! Versions of SUMO.

use std::fmt;

/// The oldest version that this crate takes.
pub(crate) const OLDEST: Version = Version { major: 1, minor: 15, patch: 0 };
/// The newest version that was tried.
const NEWEST_TRIED: Version = Version { major: 1, minor: 28, patch: 0 };

/// A version of SUMO, such as 1.15.0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[allow(missing_docs, reason = "they say themselves what they are")]
pub struct Version {
    pub major: u32,
    pub minor: u32,
    pub patch: u32,
}

impl Version {
    /// Reads a version from SUMO's own words, such as `SUMO 1.15.0` or `SUMO v1_28_0+0123-abcdef`. `None` if there is none.
    pub fn parse(text: &str) -> Option<Version> {
        let begin = text.find(|letter: char| letter.is_ascii_digit())?;
        let mut parts = text[begin..].split(|letter: char| !letter.is_ascii_digit()).map(|part| part.parse().ok());
        Some(Version { major: parts.next()??, minor: parts.next()??, patch: parts.next().flatten().unwrap_or(0) })
    }

    /// Returns whether this is the version with which the numbers in this repository were measured: 1.15.
    pub fn is_reference(self) -> bool {
        (self.major, self.minor) == (OLDEST.major, OLDEST.minor)
    }

    /// Returns whether this version lies in the range that was tried: 1.15 to 1.28.
    pub fn is_tried(self) -> bool {
        self >= OLDEST && (self.major, self.minor) <= (NEWEST_TRIED.major, NEWEST_TRIED.minor)
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}.{}", self.major, self.minor, self.patch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_is_read_from_the_words_of_releases_and_of_others() {
        let version = |major, minor, patch| Some(Version { major, minor, patch });
        assert_eq!(Version::parse("SUMO 1.15.0"), version(1, 15, 0));
        assert_eq!(Version::parse("SUMO v1_28_0+0123-abcdef"), version(1, 28, 0));
        assert_eq!(Version::parse("SUMO 1.9"), version(1, 9, 0));
        assert_eq!(Version::parse("SUMO"), None);
        assert!(!version(1, 14, 9).unwrap().is_tried() && !version(1, 29, 0).unwrap().is_tried());
        assert!(version(1, 15, 0).unwrap().is_tried() && version(1, 28, 3).unwrap().is_tried());
    }
}
