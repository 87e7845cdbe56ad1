//! Names that others chose, as they may be shown.

use std::fmt::{self, Display, Formatter, Write};

/// Returns whether a character may be shown: it moves no cursor, rings no bell and turns no direction of reading.
pub fn is_printable(letter: char) -> bool {
    let turns =
        matches!(letter, '\u{200E}' | '\u{200F}' | '\u{061C}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}');
    // The line and paragraph separators end a line like a control character, and no XML holds the last two.
    let ends = matches!(letter, '\u{2028}' | '\u{2029}' | '\u{FFFE}' | '\u{FFFF}');
    !letter.is_control() && !turns && !ends
}

/// Longest part of a text that an error quotes, in characters.
const EXCERPT: usize = 80;

/// Returns the beginning of a text for an error: printable, and short however long the text is.
pub fn excerpt(text: &str) -> String {
    beginning(text, EXCERPT)
}

/// Returns the beginning of a text, printable and of at most `most` characters before they are escaped.
pub fn beginning(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", Printable(&text[..end])),
        None => Printable(text).to_string(),
    }
}

/// A text shown with every character that is not printable replaced by its escape, such as `\u{1b}`.
#[derive(Clone, Copy, Debug)]
pub struct Printable<T>(pub T);

impl<T: Display> Display for Printable<T> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(Filter(f), "{}", self.0)
    }
}

struct Filter<'a, 'b>(&'a mut Formatter<'b>);

impl Write for Filter<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for part in text.split_inclusive(|letter| !is_printable(letter)) {
            let letter = part.chars().next_back().filter(|&letter| !is_printable(letter));
            let whole = &part[..part.len() - letter.map_or(0, char::len_utf8)];
            self.0.write_str(whole)?;
            letter.map_or(Ok(()), |letter| write!(self.0, "{}", letter.escape_default()))?;
        }
        Ok(())
    }
}

/// Returns a name as the field of a CSV file: printable, and never a formula.
///
/// A spreadsheet takes a field for a formula if it begins with one of these characters. With a `'` before it, it is text.
/// Numbers are not names: they are written as they are.
pub fn csv_name(name: &str) -> String {
    let name = Printable(name).to_string();
    if name.starts_with(['=', '+', '-', '@']) { format!("'{name}") } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_quotes_the_beginning_of_a_long_text() {
        assert_eq!(excerpt("a\u{1b}b"), "a\\u{1b}b");
        assert_eq!(excerpt(&"ü".repeat(80)), "ü".repeat(80));
        assert_eq!(excerpt(&"ü".repeat(1 << 20)), format!("{}...", "ü".repeat(80)));
    }

    #[test]
    fn a_name_that_looks_like_a_formula_is_marked_as_text() {
        for name in ["=cmd()", "+1", "-1", "@SUM(A1)"] {
            assert_eq!(csv_name(name), format!("'{name}"));
        }
        for (name, field) in [("\t=1", "\\t=1"), ("fixed-time:green=10", "fixed-time:green=10"), ("", "")] {
            assert_eq!(csv_name(name), field);
        }
    }
}
