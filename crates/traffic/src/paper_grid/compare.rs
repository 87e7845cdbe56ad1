//! A file of a network compared, element by element, with what this program writes for a grid of that size. Another
//! network with the same names would give wrong returns without a warning. Two things may differ: how often cars arrive
//! (probabilities, and flows left out), and what is only drawn.

use std::collections::HashMap;

use crate::network::tree::Element;

/// Returns the first difference between an element and what this program would write, with both values.
pub(super) fn difference(found: &Element, expected: &Element, name: &str) -> Option<String> {
    for (key, wanted) in &expected.attributes {
        let is_probability = found.name == "flow" && key == "probability";
        let fits = |value: &str| match is_probability {
            true => value.parse::<f64>().is_ok_and(|share| share > 0.0 && share <= 1.0),
            false => value == wanted || !is_text(key) && same_numbers(value, wanted),
        };
        let has = match found.attribute(key) {
            Some(value) if fits(value) => continue,
            Some(value) => format!("{key}={value:?}"),
            None => format!("has no {key}"),
        };
        let simulated = match is_probability {
            true => "probabilities above 0 and up to 1".to_owned(),
            false => format!("{key}={wanted:?}"),
        };
        return Some(format!("{name}: {has}, and this program simulates {simulated}"));
    }
    let mut added = found.attributes.iter().filter(|(key, _)| expected.attribute(key).is_none());
    if let Some((key, value)) = added.find(|(key, _)| !is_drawn_only(&found.name, key)) {
        return Some(format!("{name}: {key}={value:?}, and this program simulates none"));
    }
    in_children(found, expected, name)
}

fn in_children(found: &Element, expected: &Element, name: &str) -> Option<String> {
    let mut missing: HashMap<String, &Element> = named(expected, name).collect();
    for (called, child) in named(found, name) {
        // SUMO's arithmetic ignores the place of a net on the map.
        if child.name == "location" && child.children.is_empty() {
            continue;
        }
        match missing.remove(&called) {
            None if named(expected, name).any(|(other, _)| other == called) => {
                return Some(format!("it has {called} twice, the second time as {}", tag(child)));
            }
            None => return Some(format!("it has {}, and this program simulates none", tag(child))),
            Some(wanted) => {
                let difference = self::difference(child, wanted, &called);
                if difference.is_some() {
                    return difference;
                }
            }
        }
    }
    let mut missing = named(expected, name).filter(|(name, child)| missing.contains_key(name) && child.name != "flow");
    missing.next().map(|(_, child)| format!("it lacks {}, which this program simulates", tag(child)))
}

/// Returns the elements within another with their names in messages, which differ unless one is there twice.
fn named<'a>(parent: &'a Element, name: &str) -> impl Iterator<Item = (String, &'a Element)> {
    let mut counts: HashMap<&str, usize> = HashMap::new();
    parent.children.iter().map(move |child| {
        let count = counts.entry(&child.name).or_default();
        *count += 1;
        let kind = &child.name;
        let called = match (child.attribute("id"), child.attribute("from")) {
            (Some(id), _) => format!("{kind} {id:?}"),
            // Roads lead straight on only: one connection per edge.
            (None, Some(from)) => format!("{kind} from {from:?}"),
            (None, None) => format!("{kind} {count} of {name}"),
        };
        (called, child)
    })
}

/// Returns the tag of an element, such as `<edge id="a" from="b" to="c">`, without the elements in it.
fn tag(element: &Element) -> String {
    let attributes = element.attributes.iter().map(|(key, value)| format!(" {key}=\"{value}\""));
    format!("<{}{}>", element.name, attributes.collect::<String>())
}

/// Returns whether an attribute may have any value: it is only drawn, or is about the file itself.
fn is_drawn_only(element: &str, key: &str) -> bool {
    match (element, key) {
        // The side of the road that cars drive on is the only attribute of a net that affects their motion.
        ("net", key) => key != "lefthand",
        ("junction", "shape") | ("vType", "guiShape") | (_, "color" | "name") => true,
        _ => false,
    }
}

/// Returns whether an attribute's digits are not a number: `0101` is not `101`.
fn is_text(key: &str) -> bool {
    matches!(key, "response" | "foes" | "id" | "programID")
}

/// Returns whether both are lists of the same numbers, with blanks or commas between them. `100` is `100.00`.
fn same_numbers(found: &str, expected: &str) -> bool {
    let numbers = |text: &str| text.split([' ', ',']).map(|number| number.parse().ok()).collect::<Option<Vec<f64>>>();
    numbers(found).is_some_and(|found| numbers(expected) == Some(found))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;

    fn difference_of(found: &str, expected: &str) -> Option<String> {
        let [found, expected] = [found, expected].map(|text| parse(text).expect("XML of the test"));
        difference(&found, &expected, &found.name)
    }

    #[test]
    fn order_spelling_of_numbers_and_what_is_only_drawn_may_differ() {
        let expected = r#"<net><edge id="a" length="100.00" shape="0.00,1.60 2.00,3.00"/><junction id="b"/></net>"#;
        let drawn = r#"<location/><junction id="b" shape="1,1" name="Main St" color="red"/>"#;
        let found = format!(r#"<net version="2">{drawn}<edge id="a" length="1e2" shape="0,1.6 2,3"/></net>"#);
        assert_eq!(difference_of(&found, expected), None);
        let bits = difference_of(r#"<x><request foes="101"/></x>"#, r#"<x><request foes="0101"/></x>"#);
        assert_eq!(bits.unwrap(), r#"request 1 of x: foes="101", and this program simulates foes="0101""#);
    }
}
