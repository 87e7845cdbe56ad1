//! Files that gzip packed. SUMO reads them, too, and many real networks are packed.

use std::io::{Error, ErrorKind, Read, Result};

use flate2::read::MultiGzDecoder;

/// Beginning of a packed file.
const GZIP: &[u8] = &[0x1f, 0x8b];

/// Returns the content of a packed file, and any other bytes as they are.
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
        let told = format!("it is packed with gzip, and unpacked it has more than {at_most} bytes, the limit");
        return Err(Error::new(ErrorKind::FileTooLarge, told));
    }
    Ok(content)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;

    fn packed(content: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn a_packed_file_is_unpacked_and_another_one_stays() {
        assert_eq!(unpacked(b"<net/>".to_vec(), 6).unwrap(), b"<net/>");
        assert_eq!(unpacked(packed(b"<net/>"), 6).unwrap(), b"<net/>");
        // Programs that pack in parallel write several pieces, one after another.
        assert_eq!(unpacked([packed(b"<net"), packed(b"/>")].concat(), 6).unwrap(), b"<net/>");
        assert_eq!(unpacked(Vec::new(), 6).unwrap(), b"");
    }

    #[test]
    fn a_file_that_unpacks_to_more_than_the_limit_is_refused() {
        let bomb = packed(&vec![b' '; 10_000_000]);
        assert!(bomb.len() < 20_000, "{}", bomb.len());
        let error = unpacked(bomb, 9_999_999).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        let told = "it is packed with gzip, and unpacked it has more than 9999999 bytes, the limit";
        assert_eq!(error.to_string(), told);
    }

    #[test]
    fn a_damaged_packed_file_is_told() {
        let whole = packed(b"<net/>");
        let mut wrong = whole.clone();
        // The checksum stands before the last four bytes.
        let place = wrong.len() - 5;
        wrong[place] ^= 1;
        for damaged in [&whole[..10], &whole[..whole.len() - 1], &wrong, &[&whole[..], b"more"].concat()] {
            let error = unpacked(damaged.to_vec(), 100).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidData, "{error}");
            assert!(error.to_string().starts_with("it is packed with gzip, but damaged ("), "{error}");
        }
    }
}
