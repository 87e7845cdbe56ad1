//! A word of a command line, as `run.json` keeps it.

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt, OsStringExt};

use serde::{Deserialize, Serialize};

/// A word of a command line. JSON is UTF-8, so a word of other bytes is an object: one character per byte, of the same
/// number (Latin-1). So it cannot be mistaken for a word of these characters.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Word {
    Text(String),
    Bytes { latin1: String },
}

impl Word {
    /// Returns the word itself. Characters that are no bytes, which only others write, become `?`.
    pub fn as_it_was(&self) -> OsString {
        match self {
            Word::Text(text) => text.into(),
            Word::Bytes { latin1 } => {
                OsString::from_vec(latin1.chars().map(|letter| u8::try_from(letter).unwrap_or(b'?')).collect())
            }
        }
    }
}

impl From<&OsStr> for Word {
    fn from(word: &OsStr) -> Word {
        match word.to_str() {
            Some(text) => Word::Text(text.to_owned()),
            None => Word::Bytes { latin1: word.as_bytes().iter().map(|&byte| char::from(byte)).collect() },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_comes_back_from_json_as_it_was() {
        let words: [(&[u8], &str); 5] = [
            (b"a b", r#""a b""#),
            (b"a\nb\x1b", r#""a\nb\u001b""#),
            (r"$'a\377'".as_bytes(), r#""$'a\\377'""#),
            (b"a\xff", r#"{"latin1":"aÿ"}"#),
            (b"", r#""""#),
        ];
        for (bytes, json) in words {
            let word = Word::from(OsStr::from_bytes(bytes));
            assert_eq!(serde_json::to_string(&word).unwrap(), json);
            assert_eq!(serde_json::from_str::<Word>(json).unwrap().as_it_was().as_bytes(), bytes);
        }
        let strange: Word = serde_json::from_str(r#"{"latin1":"a交"}"#).unwrap();
        assert_eq!(strange.as_it_was(), "a?");
    }
}
