//! Paths in lines of Python to copy.

use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use dials_core::outside::is_printable;

/// Returns a path as an argument of `torch.jit.load`. One that is not UTF-8 is opened by its bytes.
pub(super) fn to_load(path: &Path) -> String {
    let escaped = |letter: char| match letter {
        '"' | '\\' => format!("\\{letter}"),
        _ if is_printable(letter) => letter.to_string(),
        _ => format!("\\U{:08x}", u32::from(letter)),
    };
    let escaped_byte = |&byte: &u8| match byte {
        b'"' | b'\\' => format!("\\{}", char::from(byte)),
        b' '..=b'~' => char::from(byte).to_string(),
        _ => format!("\\x{byte:02x}"),
    };
    match path.to_str() {
        Some(text) => format!("\"{}\"", text.chars().map(escaped).collect::<String>()),
        None => {
            let bytes: String = path.as_os_str().as_bytes().iter().map(escaped_byte).collect();
            format!("open(b\"{bytes}\", \"rb\")")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;

    #[test]
    fn a_path_is_written_as_python_writes_it() {
        let cases: [(&[u8], &str); 5] = [
            (b"a b/it's.pt", r#""a b/it's.pt""#),
            ("Süd/\"\\x41".as_bytes(), r#""Süd/\"\\x41""#),
            (b"\x1b[31m\n", r#""\U0000001b[31m\U0000000a""#),
            (b"a\xff7\"\\", r#"open(b"a\xff7\"\\", "rb")"#),
            (b"\xff\n \x1b", r#"open(b"\xff\x0a \x1b", "rb")"#),
        ];
        for (path, written) in cases {
            assert_eq!(to_load(Path::new(OsStr::from_bytes(path))), written);
        }
    }
}
