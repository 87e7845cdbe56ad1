//! Files that others may have written, read whole.

use std::fs::OpenOptions;
use std::io::{Error, ErrorKind, Read, Result};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use rustix::fs::OFlags;

/// Largest file of a network in bytes. That of a grid of 10 000 intersections has 55 MB.
pub const LARGEST_NETWORK: u64 = 256 << 20;

/// Reads a regular file of at most `at_most` bytes.
///
/// Anything else at this path is an error of kind `InvalidInput`, and a longer file one of kind `FileTooLarge`. The
/// caller adds the path.
pub fn read_bytes(path: &Path, at_most: u64) -> Result<Vec<u8>> {
    // Without this flag, opening a pipe waits for somebody who writes to it.
    let flags = OFlags::NONBLOCK.bits().cast_signed();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
    if !file.metadata()?.is_file() {
        return Err(Error::new(ErrorKind::InvalidInput, "it is not a regular file"));
    }
    let too_large = || Error::new(ErrorKind::FileTooLarge, format!("it has more than {at_most} bytes, the limit"));
    let length = file.metadata()?.len();
    if length > at_most {
        return Err(too_large());
    }
    let mut bytes = Vec::with_capacity(length as usize);
    // The file may grow while it is read.
    file.take(at_most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > at_most { Err(too_large()) } else { Ok(bytes) }
}

/// Reads a regular file of UTF-8 text, like [`read_bytes`]. Other bytes are an error of kind `InvalidData`.
pub fn read_text(path: &Path, at_most: u64) -> Result<String> {
    let bytes = read_bytes(path, at_most)?;
    String::from_utf8(bytes).map_err(|error| {
        let place = error.utf8_error().valid_up_to();
        Error::new(ErrorKind::InvalidData, format!("it is not UTF-8 text from byte {place} on"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_file_is_read_up_to_its_limit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        fs::write(&path, "four").unwrap();
        assert_eq!(read_text(&path, 4).unwrap(), "four");
        let error = read_bytes(&path, 3).unwrap_err();
        assert_eq!(
            (error.kind(), error.to_string().as_str()),
            (ErrorKind::FileTooLarge, "it has more than 3 bytes, the limit")
        );
        fs::write(&path, b"ab\xffc").unwrap();
        assert_eq!(read_text(&path, 4).unwrap_err().to_string(), "it is not UTF-8 text from byte 2 on");
        assert_eq!(read_bytes(&dir.path().join("none"), 4).unwrap_err().kind(), ErrorKind::NotFound);
    }

    #[test]
    fn what_has_no_end_is_refused_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let pipe = dir.path().join("pipe");
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        for path in [&pipe, Path::new("/dev/zero"), dir.path()] {
            assert_eq!(read_bytes(path, 4).unwrap_err().to_string(), "it is not a regular file", "{}", path.display());
        }
    }
}
