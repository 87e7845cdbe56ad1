//! Names of everything in a net, with a prefix before each. So several nets can stand in one file. Also names that are
//! still free.

use std::borrow::Cow;
use std::io;

use crate::network::tree::Element;
use crate::network::xml::{Xml, leaf, nest};

pub(crate) fn prefixed(prefix: &str, id: &str) -> String {
    match id.strip_prefix(':') {
        // SUMO knows internal edges and lanes by the colon, and finds their junction by the name after it.
        Some(internal) => format!(":{prefix}{internal}"),
        None => format!("{prefix}{id}"),
    }
}

/// Returns a name that is not taken: this one, or the first free of it with `_2`, `_3` and so on.
pub(crate) fn free_name(name: &str, is_taken: impl Fn(&str) -> bool) -> String {
    let numbered = (2..).map(|number| format!("{name}_{number}"));
    let mut names = [name.to_owned()].into_iter().chain(numbered);
    names.find(|name| !is_taken(name)).expect("numbers go on")
}

fn all_prefixed(prefix: &str, ids: &str) -> String {
    ids.split_whitespace().map(|id| prefixed(prefix, id)).collect::<Vec<_>>().join(" ")
}

/// Returns the attributes that hold names of things in a net: one name, or several with blanks between.
///
/// Seen in the files of netconvert 1.15. The `index` and the bits of a `<request>` and the `linkIndex` of a
/// `<connection>` count within their junction, so they stay.
fn names_in(element: &str) -> &'static [&'static str] {
    match element {
        "edge" => &["id", "from", "to", "bidi", "crossingEdges"],
        "lane" | "tlLogic" => &["id"],
        // The lane of the opposite direction, as a child of a lane.
        "neigh" => &["lane"],
        "junction" => &["id", "incLanes", "intLanes"],
        "connection" => &["from", "to", "via", "tl"],
        "roundabout" => &["nodes", "edges"],
        "route" => &["id", "edges"],
        _ => &[],
    }
}

/// Writes an element with everything inside it, and with a prefix before every name.
pub(crate) fn write(xml: &mut Xml, element: &Element, prefix: &str) -> io::Result<()> {
    let names = names_in(&element.name);
    let attributes = element.attributes.iter().map(|(key, value)| {
        let renamed = names.contains(&key.as_str()).then(|| all_prefixed(prefix, value));
        (key, renamed.map_or(Cow::Borrowed(value.as_str()), Cow::Owned))
    });
    if element.children.is_empty() {
        return leaf(xml, &element.name, attributes);
    }
    nest(xml, &element.name, attributes, |xml| element.children.iter().try_for_each(|child| write(xml, child, prefix)))
}
