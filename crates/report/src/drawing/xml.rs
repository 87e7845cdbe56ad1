//! Names in an SVG file.

use dials_core::outside::Printable;

/// Begins a text, whose attributes end with the next [`CONTENT`].
const TEXT: &str = "<text ";
const CONTENT: &str = ">\n";
const END: &str = "\n</text>";

/// Returns a picture of the drawing crate with every text in it printable.
///
/// The crate escapes markup, but XML forbids most control characters even then, and the others act on a terminal.
pub(super) fn with_printable_names(svg: &str) -> String {
    let mut clean = String::with_capacity(svg.len());
    let mut rest = svg;
    while let Some((before, content, after)) = next_text(rest) {
        clean += before;
        clean += &Printable(content).to_string();
        rest = after;
    }
    clean + rest
}

/// Splits at the next text: what is before its content, the content, and what is after it. In a content and in
/// attributes all markup is escaped.
fn next_text(svg: &str) -> Option<(&str, &str, &str)> {
    let begin = svg.find(TEXT)?;
    let content = begin + svg[begin..].find(CONTENT)? + CONTENT.len();
    let end = content + svg[content..].find(END)?;
    Some((&svg[..content], &svg[content..end], &svg[end..]))
}
