//! The border of a region: junctions that become dead ends, and copies of edges behind it.

use crate::network::tree::Element;

/// Returns a junction as a dead end at which only some of its lanes end.
pub(super) fn dead_end(junction: &Element, is_left: impl Fn(&str) -> bool) -> Element {
    let lanes = junction.attribute("incLanes").unwrap_or_default().split_whitespace();
    let lanes = lanes.filter(|lane| is_left(lane)).collect::<Vec<_>>().join(" ");
    let mut end = junction.clone();
    end.children.retain(|child| child.name == "param");
    set(&mut end, "type", "dead_end");
    set(&mut end, "incLanes", &lanes);
    set(&mut end, "intLanes", "");
    end
}

/// Returns a dead end at the place of another junction, under its own name, for the lanes of `edge`.
pub(crate) fn dead_end_of(edge: &Element, junction: &Element, id: &str) -> Element {
    let lanes: Vec<&str> = edge.all("lane").filter_map(|lane| lane.attribute("id")).collect();
    let mut end = dead_end(junction, |_| false);
    set(&mut end, "id", id);
    set(&mut end, "incLanes", &lanes.join(" "));
    end
}

/// Returns an edge under another name, between other junctions.
pub(super) fn copy(edge: &Element, id: &str, [from, to]: [&str; 2]) -> Element {
    let mut copy = edge.clone();
    set(&mut copy, "id", id);
    set(&mut copy, "from", from);
    set(&mut copy, "to", to);
    // Edges and lanes of the opposite direction have no copies.
    copy.attributes.retain(|(key, _)| key != "bidi");
    for (index, lane) in copy.children.iter_mut().filter(|child| child.name == "lane").enumerate() {
        lane.children.retain(|child| child.name != "neigh");
        set(lane, "id", &format!("{id}_{index}"));
    }
    copy
}

/// Returns a connection between other edges, without the inside of its junction. `gate`: the light that it obeys, and
/// the letter.
pub(super) fn connection(like: &Element, [from, to]: [&str; 2], gate: Option<(&str, usize)>) -> Element {
    const KEPT: [&str; 3] = ["fromLane", "toLane", "dir"];
    let mut connection = like.clone();
    connection.attributes.retain(|(key, _)| KEPT.contains(&key.as_str()));
    set(&mut connection, "from", from);
    set(&mut connection, "to", to);
    if let Some((light, letter)) = gate {
        set(&mut connection, "tl", light);
        set(&mut connection, "linkIndex", &letter.to_string());
    }
    set(&mut connection, "state", "M");
    connection
}

/// Sets an attribute, at its place if the element has it.
fn set(element: &mut Element, key: &str, value: &str) {
    match element.attributes.iter_mut().find(|(known, _)| known == key) {
        Some((_, old)) => *old = value.to_owned(),
        None => element.attributes.push((key.to_owned(), value.to_owned())),
    }
}
