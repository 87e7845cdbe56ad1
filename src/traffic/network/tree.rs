//! XML files read as a tree of elements that can be kept, compared and built by hand.
//!
//! SUMO's files keep everything in attributes, so text between elements is skipped, as are comments. Attributes with a
//! namespace are skipped too: they name the place of a schema.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, anyhow};
use roxmltree::{Document, Node};

/// One element and everything inside it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Element {
    pub name: String,
    /// Attributes in the order of the file.
    pub attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
}

impl Element {
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// Returns the children of one kind.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |child| child.name == name)
    }
}

/// Returns the root element of a file. An error says where the file is not XML.
pub fn read(path: &Path) -> Result<Element> {
    let text = fs::read_to_string(path).with_context(|| format!("{}: could not be read", path.display()))?;
    parse(&text).map_err(|error| anyhow!("{}: is not XML: {error}", path.display()))
}

/// Returns the root element of a text.
pub fn parse(text: &str) -> Result<Element, roxmltree::Error> {
    Ok(element(Document::parse(text)?.root_element()))
}

fn element(node: Node<'_, '_>) -> Element {
    let plain = node.attributes().filter(|attribute| attribute.namespace().is_none());
    Element {
        name: node.tag_name().name().to_owned(),
        attributes: plain.map(|attribute| (attribute.name().to_owned(), attribute.value().to_owned())).collect(),
        children: node.children().filter(Node::is_element).map(element).collect(),
    }
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
        // The end tag begins at line 2, column 3 and names another element than the open one.
        assert_eq!(error_of("<net>\n  </nets>"), "x.xml: is not XML: expected 'net' tag, not 'nets' at 2:3");
        assert!(
            error_of("<net a=1/>").starts_with("x.xml: is not XML: ") && error_of("<net a=1/>").ends_with(" at 1:8")
        );
        assert!(error_of("no net").ends_with(" at 1:1"));
        assert!(error_of("<net/><net/>").ends_with(" at 1:7"));
        assert_eq!(error_of("<net>\n<edge id=\"a\">"), "x.xml: is not XML: the root node was opened but never closed");
        assert_eq!(error_of(""), "x.xml: is not XML: the document does not have a root node");
    }

    #[test]
    fn elements_keep_their_attributes_and_their_children_in_order() {
        let root = parse("<a><b x=\"1\" y=\"&lt;\"/><!-- --><c/><b/></a>").expect("well-formed XML");
        assert_eq!(root.all("b").count(), 2);
        assert_eq!(root.children[0].attribute("y"), Some("<"));
        assert_eq!(root.children[1].name, "c");
    }

    #[test]
    fn where_the_schema_lies_is_not_kept() {
        let root = parse("<net xmlns:xsi=\"http://a\" xsi:noNamespaceSchemaLocation=\"b\" version=\"1.9\"/>").unwrap();
        assert_eq!(root.attributes, [("version".to_owned(), "1.9".to_owned())]);
    }
}
