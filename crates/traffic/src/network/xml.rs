//! XML files in the form that SUMO reads, written element by element.

use std::io;

use quick_xml::events::{BytesDecl, Event};
use quick_xml::writer::{ElementWriter, Writer};

use super::tree::Element;

pub(crate) type Xml = Writer<Vec<u8>>;

pub(crate) fn document(root: &str, fill: impl FnOnce(&mut Xml) -> io::Result<()>) -> String {
    document_with(root, [("", ""); 0], fill)
}

pub(crate) fn document_with<K: AsRef<str>, V: AsRef<str>>(
    root: &str,
    attributes: impl IntoIterator<Item = (K, V)>,
    fill: impl FnOnce(&mut Xml) -> io::Result<()>,
) -> String {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 4);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))
        .and_then(|()| nest(&mut xml, root, attributes, fill))
        .expect("memory takes what is written to it");
    xml.get_mut().push(b'\n');
    String::from_utf8(xml.into_inner()).expect("only strings were written")
}

pub(crate) fn text(root: &Element) -> String {
    document_with(&root.name, pairs(root), |xml| root.children.iter().try_for_each(|child| element(xml, child)))
}

pub(crate) fn element(xml: &mut Xml, from: &Element) -> io::Result<()> {
    if from.children.is_empty() {
        return leaf(xml, &from.name, pairs(from));
    }
    nest(xml, &from.name, pairs(from), |xml| from.children.iter().try_for_each(|child| element(xml, child)))
}

fn pairs(element: &Element) -> impl Iterator<Item = (&String, &String)> {
    element.attributes.iter().map(|(key, value)| (key, value))
}

pub(crate) fn nest<K: AsRef<str>, V: AsRef<str>>(
    xml: &mut Xml,
    name: &str,
    attributes: impl IntoIterator<Item = (K, V)>,
    fill: impl FnOnce(&mut Xml) -> io::Result<()>,
) -> io::Result<()> {
    begun(xml, name, attributes).write_inner_content(fill).map(drop)
}

pub(crate) fn leaf<K: AsRef<str>, V: AsRef<str>>(
    xml: &mut Xml,
    name: &str,
    attributes: impl IntoIterator<Item = (K, V)>,
) -> io::Result<()> {
    begun(xml, name, attributes).write_empty().map(drop)
}

fn begun<'a, K: AsRef<str>, V: AsRef<str>>(
    xml: &'a mut Xml,
    name: &'a str,
    attributes: impl IntoIterator<Item = (K, V)>,
) -> ElementWriter<'a, Vec<u8>> {
    let element = xml.create_element(name);
    attributes.into_iter().fold(element, |element, (key, value)| element.with_attribute((key.as_ref(), value.as_ref())))
}

pub(crate) fn section(xml: &mut Xml, name: &str, options: &[(&str, &str)]) -> io::Result<()> {
    nest(xml, name, [("", ""); 0], |xml| {
        options.iter().try_for_each(|(option, value)| leaf(xml, option, [("value", value)]))
    })
}
