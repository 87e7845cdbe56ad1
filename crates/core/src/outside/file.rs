//! Files that others may have written, read whole: plain ones, and those that gzip packed. And temporary files, with an
//! error that names the place and the way out.

use std::env;
use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind, Read, Result, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use flate2::Compression;
use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;
use rustix::fs::OFlags;
use tempfile::TempDir;

use super::Printable;

/// Largest file of a network in bytes. That of a grid of 10 000 intersections has 55 MB.
pub const LARGEST_NETWORK: u64 = 256 << 20;

/// Beginning of a file that gzip packed.
const GZIP: &[u8] = &[0x1f, 0x8b];

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

/// Returns the content of a packed file, and any other bytes as they are. SUMO reads packed networks, too.
///
/// More than `at_most` bytes are an error of kind `FileTooLarge`. What is no whole gzip file is one of kind `InvalidData`.
pub(super) fn unpacked(bytes: Vec<u8>, at_most: u64) -> Result<Vec<u8>> {
    if !bytes.starts_with(GZIP) {
        return Ok(bytes);
    }
    let mut content = Vec::new();
    // A small file may unpack to a thousand times its size.
    MultiGzDecoder::new(&bytes[..]).take(at_most.saturating_add(1)).read_to_end(&mut content).map_err(|error| {
        Error::new(ErrorKind::InvalidData, format!("it is packed with gzip, but damaged ({error}); pack it again"))
    })?;
    if content.len() as u64 > at_most {
        let message = format!("it is packed with gzip, and unpacked it has more than {at_most} bytes, the limit");
        return Err(Error::new(ErrorKind::FileTooLarge, message));
    }
    Ok(content)
}

/// Returns the content packed with gzip. The same content always gives the same bytes.
pub fn packed(content: &[u8]) -> Result<Vec<u8>> {
    let mut packer = GzEncoder::new(Vec::new(), Compression::default());
    packer.write_all(content)?;
    packer.finish()
}

/// Makes a temporary directory that is removed when it is dropped.
pub fn temporary_dir() -> Result<TempDir> {
    tempfile::tempdir().map_err(|error| cannot_write_temporary(&error))
}

/// Makes a temporary file without a name, so a killed process leaves none behind.
pub fn temporary_file() -> Result<File> {
    tempfile::tempfile().map_err(|error| cannot_write_temporary(&error))
}

/// Returns the error about a temporary file that could not be written, such as one on a full disk.
pub fn cannot_write_temporary(error: &Error) -> Error {
    let message = format!(
        "{}: temporary files cannot be written there ({}); set TMPDIR to a directory that can be written to",
        Printable(env::temp_dir().display()),
        error.kind()
    );
    Error::new(error.kind(), message)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_is_read_up_to_its_limit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        fs::write(&path, "four").unwrap();
        assert_eq!(read_text(&path, 4).unwrap(), "four");
        let error = read_bytes(&path, 3).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        assert_eq!(error.to_string(), "it has more than 3 bytes, the limit");
    }

    #[test]
    fn a_packed_file_is_unpacked_up_to_the_limit_and_another_one_stays() {
        assert_eq!(unpacked(b"<net/>".to_vec(), 6).unwrap(), b"<net/>");
        // Programs that pack in parallel write several pieces, one after another.
        assert_eq!(unpacked([packed(b"<net").unwrap(), packed(b"/>").unwrap()].concat(), 6).unwrap(), b"<net/>");
        let bomb = packed(&vec![b' '; 10_000_000]).unwrap();
        assert!(bomb.len() < 20_000, "{}", bomb.len());
        let error = unpacked(bomb, 9_999_999).unwrap_err();
        let message = "it is packed with gzip, and unpacked it has more than 9999999 bytes, the limit".to_owned();
        assert_eq!((error.kind(), error.to_string()), (ErrorKind::FileTooLarge, message));
    }
}
