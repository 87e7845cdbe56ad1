//! XML files read as a tree of elements that can be kept, compared, built by hand and written again.
//!
//! SUMO's files keep everything in attributes, so text between elements is skipped, as are comments. Attributes with a
//! namespace are skipped too: they name the place of a schema.
//!
//! The files may come from a stranger. Whatever another reader of XML might understand differently is refused: a
//! document type, unknown encodings, names with a prefix. So is everything that has no end.

use std::borrow::Cow;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE};
use roxmltree::{Document, Node, ParsingOptions};
use serde::{Deserialize, Serialize};

use super::file::unpacked;
use super::{LARGEST_NETWORK, read_bytes};

/// Largest number of elements, comments and texts between them. A grid of 10 000 intersections has 800 000.
const MOST_NODES: u32 = 8_000_000;
/// Deepest element. SUMO's own files have at most six levels.
const DEEPEST: usize = 32;
/// Largest number of attributes of an element. Finding doubles among them takes quadratic time.
const MOST_ATTRIBUTES: usize = 256;
/// Longest declaration of a version and an encoding that is looked at, in bytes.
const LONGEST_DECLARATION: usize = 256;
/// Largest number of declared namespaces in a file. Each is copied into every element inside.
const MOST_NAMESPACES: usize = 16;

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Element {
    pub name: String,
    pub attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
}

impl Element {
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// Returns the attribute `id`; empty if it has none.
    pub fn id(&self) -> &str {
        self.attribute("id").unwrap_or_default()
    }

    /// Returns the words of an attribute that is a list; none if it has no such attribute.
    pub fn words(&self, name: &str) -> impl Iterator<Item = &str> {
        self.attribute(name).unwrap_or_default().split_ascii_whitespace()
    }

    /// Returns the children of one kind.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |child| child.name == name)
    }
}

/// Returns the bytes of a file up to the limit. A file that gzip packed is unpacked; the limit holds for that, too.
pub fn read_whole(path: &Path) -> Result<Vec<u8>> {
    let bytes = read_bytes(path, LARGEST_NETWORK).and_then(|bytes| unpacked(bytes, LARGEST_NETWORK));
    bytes.with_context(|| format!("{}: could not be read", path.display()))
}

/// Returns the root element of a file with these bytes. An error says where the file is not XML.
pub fn parse_file(path: &Path, bytes: &[u8]) -> Result<Element> {
    decoded(bytes).and_then(|text| parse(&text)).map_err(|error| anyhow!("{}: {error:#}", path.display()))
}

/// Returns whether a file is UTF-8 and says nothing else.
pub fn is_utf8(bytes: &[u8]) -> bool {
    encoding_of(bytes).is_ok_and(|encoding| encoding == UTF_8)
}

/// Returns the text of a file.
fn decoded(bytes: &[u8]) -> Result<Cow<'_, str>> {
    let encoding = encoding_of(bytes)?;
    let (text, _, is_wrong) = encoding.decode(bytes);
    if is_wrong && encoding == UTF_8 {
        let error = std::str::from_utf8(bytes).err().context("is not UTF-8 text")?;
        bail!("is not UTF-8 text from byte {} on; save it as UTF-8", error.valid_up_to());
    }
    ensure!(!is_wrong, "is no text in {}, which it declares; save it as UTF-8", encoding.name());
    Ok(text)
}

/// Returns the encoding of a file: that of its byte order mark, or the one that it declares, or UTF-8. If it has two: an error.
fn encoding_of(bytes: &[u8]) -> Result<&'static Encoding> {
    let Some((marked, length)) = Encoding::for_bom(bytes) else {
        return Ok(declared_encoding(bytes)?.unwrap_or(UTF_8));
    };
    let (text, _) = marked.decode_without_bom_handling(&bytes[length..bytes.len().min(4 * LONGEST_DECLARATION)]);
    let declared = declared_encoding(text.as_bytes())?;
    // `UTF-16` alone stands for both orders of bytes.
    let is_same = |declared: &'static Encoding| declared == marked || (declared == UTF_16LE && marked == UTF_16BE);
    ensure!(
        declared.is_none_or(is_same),
        "has a byte order mark that is not of the encoding that it declares; save it as UTF-8"
    );
    Ok(marked)
}

/// Returns the encoding that the first line of a file declares. Its letters are ASCII in all of them.
fn declared_encoding(bytes: &[u8]) -> Result<Option<&'static Encoding>> {
    let line = String::from_utf8_lossy(&bytes[..bytes.len().min(LONGEST_DECLARATION)]);
    ensure!(
        !line.starts_with("<?xml") || line.contains("?>"),
        "has a declaration of more than {LONGEST_DECLARATION} bytes; save it as UTF-8"
    );
    let Some(named) = declaration(&line).find_map(|word| word.strip_prefix("encoding=")) else { return Ok(None) };
    let name = named.trim_matches(['"', '\'']);
    let encoding = Encoding::for_label(name.as_bytes());
    encoding
        .map(Some)
        .with_context(|| format!("declares encoding=\"{name}\", which this program does not know; save it as UTF-8"))
}

/// Returns the words of the declaration `<?xml ...?>` at the beginning of a text.
fn declaration(text: &str) -> impl Iterator<Item = &str> {
    let declared =
        text.strip_prefix("<?xml").and_then(|rest| rest.split_once("?>")).map_or("", |(declared, _)| declared);
    declared.split_ascii_whitespace()
}

pub fn parse(text: &str) -> Result<Element> {
    check_declaration(text)?;
    check_effort(text)?;
    let options = ParsingOptions { nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|error| match error {
        roxmltree::Error::NodesLimitReached => anyhow!("has more than {MOST_NODES} elements, the limit"),
        roxmltree::Error::DtdDetected => {
            anyhow!("has a document type (<!DOCTYPE ...>), which SUMO's files do not need")
        }
        error => anyhow!("is not XML: {error}"),
    })?;
    element(document.root_element(), text, 1)
}

/// Returns an error if the text declares what another reader might understand differently.
fn check_declaration(text: &str) -> Result<()> {
    for word in declaration(text.strip_prefix('\u{FEFF}').unwrap_or(text)) {
        let plain = word.replace('\'', "\"");
        let is_encoding = plain.strip_prefix("encoding=\"").is_some_and(|name| name.len() > 1 && name.ends_with('"'));
        ensure!(
            plain == "version=\"1.0\"" || is_encoding || plain.starts_with("standalone="),
            "declares {word}, and this program reads version=\"1.0\" and an encoding only; save it as UTF-8"
        );
    }
    Ok(())
}

/// Returns an error if reading the text could take quadratic time.
fn check_effort(text: &str) -> Result<()> {
    // No tag holds a `<`, so the text from one to the next is at least one tag.
    let tag = text.split('<').find(|tag| tag.len() > 4 * MOST_ATTRIBUTES && attributes(tag) > MOST_ATTRIBUTES);
    if let Some(tag) = tag {
        let name: String = tag.chars().take_while(|letter| letter.is_alphanumeric()).take(40).collect();
        bail!("has the element <{name}> with more than {MOST_ATTRIBUTES} attributes, the limit");
    }
    ensure!(
        text.matches("xmlns").nth(MOST_NAMESPACES).is_none(),
        "has more than {MOST_NAMESPACES} namespaces, the limit"
    );
    Ok(())
}

/// Returns at least the number of attributes in a tag.
fn attributes(tag: &str) -> usize {
    let begins = |rest: &str| rest.trim_ascii_start().starts_with(['"', '\'']);
    tag.split('=').skip(1).filter(|rest| begins(rest)).count()
}

fn element(node: Node<'_, '_>, text: &str, depth: usize) -> Result<Element> {
    let name = node.tag_name().name();
    ensure!(depth <= DEEPEST, "has elements inside of elements, {DEEPEST} deep and deeper; SUMO's files are flat");
    let tag = text[node.range()].trim_start_matches('<');
    ensure!(
        tag.starts_with(name),
        "has the element <{}>, whose name has a prefix; SUMO skips it",
        tag.split(|letter: char| letter.is_whitespace() || matches!(letter, '>' | '/')).next().unwrap_or(name)
    );
    let plain = node.attributes().filter(|attribute| attribute.namespace().is_none());
    let inside = node.children().filter(Node::is_element);
    Ok(Element {
        name: name.to_owned(),
        attributes: plain.map(|attribute| (attribute.name().to_owned(), attribute.value().to_owned())).collect(),
        children: inside.map(|child| element(child, text, depth + 1)).collect::<Result<_>>()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(text: &str) -> String {
        format!("{:#}", parse_file(Path::new("x.xml"), text.as_bytes()).expect_err("the text is not XML"))
    }

    #[test]
    fn an_error_says_where() {
        // The end tag begins at line 2, column 3 and names another element than the open one.
        assert_eq!(error_of("<net>\n  </nets>"), "x.xml: is not XML: expected 'net' tag, not 'nets' at 2:3");
        assert!(error_of("<net a=1/>").ends_with(" at 1:8") && error_of("<net/><net/>").ends_with(" at 1:7"));
        assert_eq!(error_of(""), "x.xml: is not XML: the document does not have a root node");
    }

    #[test]
    fn elements_keep_their_attributes_and_their_children_in_order_and_no_schema() {
        let root = parse("<a xmlns:x=\"u\" x:s=\"b\" v=\"1\"><b y=\"&lt;\"/><!-- --><c/><b/></a>").unwrap();
        assert_eq!(root.attributes, [("v".to_owned(), "1".to_owned())]);
        assert_eq!((root.all("b").count(), root.children[1].name.as_str()), (2, "c"));
        assert_eq!(root.children[0].attribute("y"), Some("<"));
    }

    #[test]
    fn text_that_another_reader_would_read_otherwise_is_refused() {
        for declared in [r#"version="1.0" encoding="UTF-8""#, "version='1.0'  encoding='utf-8' standalone=\"yes\""] {
            parse(&format!("\u{FEFF}<?xml {declared} ?><a/>")).expect(declared);
        }
        for (declared, word) in [
            (r#"version="encoding='UTF-8'" encoding="UTF-8""#, r#"version="encoding='UTF-8'""#),
            (r#"version="1.1""#, r#"version="1.1""#),
            (r#"version="1.0" encoding = "UTF-8""#, "encoding"),
        ] {
            let error = error_of(&format!("<?xml {declared}?><a/>"));
            assert!(error.starts_with(&format!("x.xml: declares {word}, and this program reads")), "{error}");
        }
        let error = error_of(r#"<?xml version="1.0" encoding="UTF-7"?><a/>"#);
        assert!(error.starts_with("x.xml: declares encoding=\"UTF-7\", which this program does not know"), "{error}");
    }

    #[test]
    fn a_file_is_read_in_the_encoding_that_it_declares() {
        let name = |bytes: &[u8]| parse_file(Path::new("x.xml"), bytes).unwrap().attribute("id").unwrap().to_owned();
        let text = |encoding: &str| format!("<?xml version='1.0' encoding='{encoding}'?><a id='M\u{fc}nz\u{20ac}'/>");
        assert_eq!(name(text("utf-8").as_bytes()), "M\u{fc}nz\u{20ac}");
        let western: Vec<u8> =
            text("windows-1252").chars().map(|letter| if letter == '\u{20ac}' { 0x80 } else { letter as u8 }).collect();
        assert_eq!(name(&western), "M\u{fc}nz\u{20ac}");
        let wide: Vec<u8> = format!("\u{FEFF}{}", text("UTF-16")).encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert_eq!(name(&wide), "M\u{fc}nz\u{20ac}");
        for odd in [
            "<?xml version='1.0' encoding= 'UTF-8'?><a/>".to_owned(),
            "<?xml version='1.0' encoding=\u{fc}?><a/>".to_owned(),
            format!("<?xml version='1.0'{}encoding='UTF-7'?><a/>", " ".repeat(300)),
            "\u{FEFF}<?xml version='1.0' encoding='windows-1252'?><a/>".to_owned(),
        ] {
            assert!(parse_file(Path::new("x.xml"), odd.as_bytes()).is_err(), "{odd}");
        }
        assert!(is_utf8(b"<a/>") && !is_utf8(text("windows-1252").as_bytes()));
        let broken = [text("UTF-8").as_bytes(), &[0xff]].concat();
        let error = parse_file(Path::new("x.xml"), &broken).unwrap_err().to_string();
        assert_eq!(error, "x.xml: is not UTF-8 text from byte 56 on; save it as UTF-8");
    }

    #[test]
    fn what_takes_too_long_is_refused_at_once() {
        let many = format!("<a>{}</a>", "<b/>".repeat(MOST_NODES as usize));
        assert_eq!(error_of(&many), "x.xml: has more than 8000000 elements, the limit");
    }
}
