//! XML files read as a tree of elements, with errors that say where in the file.
//!
//! SUMO's files keep everything in attributes, so text between elements is skipped, as are comments.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, anyhow};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// One element and everything inside it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Element {
    pub name: String,
    /// In the order of the file.
    pub attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
}

impl Element {
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// The children of one kind.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |child| child.name == name)
    }
}

/// The root element of a file.
pub fn read(path: &Path) -> Result<Element> {
    let text = fs::read_to_string(path).with_context(|| format!("{}: could not be read", path.display()))?;
    parse(&text).map_err(|fault| {
        let (line, column) = line_and_column(&text, fault.offset);
        anyhow!("{}: is not XML (line {line}, column {column}): {}", path.display(), fault.what)
    })
}

/// What is wrong with a text, and at which of its bytes.
#[derive(Debug)]
pub struct Fault {
    offset: u64,
    what: String,
}

/// The root element of a text.
pub fn parse(text: &str) -> Result<Element, Fault> {
    let mut reader = Reader::from_str(text);
    let mut open: Vec<Element> = Vec::new();
    let mut root = None;
    loop {
        let event =
            reader.read_event().map_err(|error| Fault { offset: reader.error_position(), what: error.to_string() })?;
        let here = |what: String| Fault { offset: reader.buffer_position(), what };
        let closed = match event {
            Event::Start(tag) => {
                open.push(element(&tag, &reader).map_err(|error| here(error.to_string()))?);
                None
            }
            Event::Empty(tag) => Some(element(&tag, &reader).map_err(|error| here(error.to_string()))?),
            Event::End(_) => open.pop(),
            Event::Text(text) if open.is_empty() && !text.iter().all(u8::is_ascii_whitespace) => {
                return Err(here("text outside of any element".into()));
            }
            Event::Eof => {
                // The reader itself accepts a file that was cut off.
                return match open.last() {
                    Some(element) => Err(here(format!("the file ends inside of <{}>", element.name))),
                    None => root.ok_or_else(|| here("the file has no element".into())),
                };
            }
            _ => None,
        };
        let Some(closed) = closed else { continue };
        match open.last_mut() {
            Some(parent) => parent.children.push(closed),
            None if root.is_none() => root = Some(closed),
            None => return Err(here("a second root element".into())),
        }
    }
}

fn element(tag: &BytesStart, reader: &Reader<&[u8]>) -> Result<Element, quick_xml::Error> {
    let text = |bytes| reader.decoder().decode(bytes).map(|text| text.into_owned());
    let mut attributes = Vec::new();
    for attribute in tag.attributes() {
        let attribute = attribute?;
        let value = attribute.decode_and_unescape_value(reader.decoder())?.into_owned();
        attributes.push((text(attribute.key.into_inner())?, value));
    }
    Ok(Element { name: text(tag.name().into_inner())?, attributes, children: Vec::new() })
}

/// Both count from 1, as editors do.
fn line_and_column(text: &str, offset: u64) -> (usize, usize) {
    let before = &text.as_bytes()[..text.len().min(offset as usize)];
    let line_begin = before.iter().rposition(|&byte| byte == b'\n').map_or(0, |newline| newline + 1);
    let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
    (line, 1 + before.len() - line_begin)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(text: &str) -> String {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("x.xml");
        fs::write(&path, text).expect("a writable temporary directory");
        let message = format!("{:#}", read(&path).expect_err("the text is not XML"));
        message.replace(&format!("{}/", dir.path().display()), "")
    }

    #[test]
    fn an_error_says_where() {
        // The end tag begins at line 2, column 3 and names another element than the one that is open.
        let mismatch = error_of("<net>\n  </nets>");
        assert!(mismatch.starts_with("x.xml: is not XML (line 2, column 3): "), "{mismatch}");
        let cut = error_of("<net>\n<edge id=\"a\">");
        assert_eq!(cut, "x.xml: is not XML (line 2, column 14): the file ends inside of <edge>");
        assert!(error_of("no net").ends_with("text outside of any element"));
        assert!(error_of("").ends_with("the file has no element"));
        assert!(error_of("<net/><net/>").ends_with("a second root element"));
        assert!(error_of("<net a=1/>").starts_with("x.xml: is not XML (line 1, column "));
    }

    #[test]
    fn elements_keep_their_attributes_and_their_children_in_order() {
        let Ok(root) = parse("<a><b x=\"1\" y=\"&lt;\"/><!-- --><c/><b/></a>") else { panic!("it is well-formed") };
        assert_eq!(root.all("b").count(), 2);
        assert_eq!(root.children[0].attribute("y"), Some("<"));
        assert_eq!(root.children[1].name, "c");
    }
}
