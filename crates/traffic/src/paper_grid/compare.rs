//! A file of a network compared, element by element, with what this program writes for a grid of that size.
//!
//! Observations, rewards, controllers, metrics and local simulators assume the lengths, limits, lanes, connections,
//! lights and vehicles of our own networks. Others with the same names would give wrong returns without a warning, so
//! all of it is compared. Two things may differ: how often cars arrive ([`Allowed::Probability`], and flows left out),
//! and what is only drawn.

use std::collections::HashMap;
use std::fmt;
use std::num::ParseFloatError;

use crate::network::tree::Element;

/// Returns the first difference between an element of a file and the element that this program would write: what it is,
/// with both values. The order of the elements within another does not matter.
pub(super) fn difference(found: &Element, expected: &Element) -> Option<String> {
    within(found, expected, &found.name)
}

/// Compares one element. `name`: what `found` is called in a message.
fn within(found: &Element, expected: &Element, name: &str) -> Option<String> {
    in_attributes(found, expected, name).or_else(|| in_children(found, expected, name))
}

fn in_attributes(found: &Element, expected: &Element, name: &str) -> Option<String> {
    let wrong = expected.attributes.iter().find_map(|(key, value)| {
        let allowed = Allowed::of(&found.name, key, Some(value));
        match found.attribute(key) {
            Some(other) if allowed.has(other) => None,
            Some(other) => Some(format!("{name}: {key}={other:?}, and this program simulates {allowed}")),
            None => Some(format!("{name}: has no {key}, and this program simulates {allowed}")),
        }
    });
    wrong.or_else(|| added_attribute(found, expected, name))
}

fn added_attribute(found: &Element, expected: &Element, name: &str) -> Option<String> {
    let added = found.attributes.iter().filter(|(key, _)| expected.attribute(key).is_none());
    let mut refused = added.filter(|(key, _)| Allowed::of(&found.name, key, None) != Allowed::Anything);
    refused.next().map(|(key, value)| format!("{name}: {key}={value:?}, and this program simulates none"))
}

fn in_children(found: &Element, expected: &Element, name: &str) -> Option<String> {
    let mut missing: HashMap<String, &Element> = named(expected, name).collect();
    for (called, child) in named(found, name).filter(|(_, child)| !is_drawn_only(child)) {
        match missing.remove(&called) {
            None if named(expected, name).any(|(other, _)| other == called) => {
                return Some(format!("it has {called} twice, the second time as {}", tag(child)));
            }
            None => return Some(format!("it has {}, and this program simulates none", tag(child))),
            Some(wanted) => {
                let difference = within(child, wanted, &called);
                if difference.is_some() {
                    return difference;
                }
            }
        }
    }
    let mut missing = named(expected, name).filter(|(name, child)| missing.contains_key(name) && child.name != "flow");
    missing.next().map(|(_, child)| format!("it lacks {}, which this program simulates", tag(child)))
}

/// Returns the elements within another, each with its name in messages. No two have the same name unless one is there
/// twice.
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

/// Returns whether SUMO's arithmetic ignores an element: the place of a net on the map.
fn is_drawn_only(element: &Element) -> bool {
    element.name == "location" && element.children.is_empty()
}

/// Values that an attribute may have.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Allowed<'a> {
    /// This value only. Numbers may be written otherwise: `100` for `100.00`.
    Value {
        key: &'a str,
        value: &'a str,
    },
    /// Above 0 and at most 1: the user chooses how often cars arrive.
    Probability,
    /// Any value: it is only drawn, or is about the file itself.
    Anything,
    Nothing,
}

impl<'a> Allowed<'a> {
    /// Returns the values allowed. `value`: what this program writes; `None`: it does not write this attribute.
    fn of(element: &str, key: &'a str, value: Option<&'a str>) -> Allowed<'a> {
        match (element, key) {
            ("flow", "probability") => Allowed::Probability,
            // The side of the road that cars drive on is the only attribute of a net that affects their motion.
            ("net", key) if key != "lefthand" => Allowed::Anything,
            ("junction", "shape") | ("vType", "guiShape" | "imgFile") | (_, "color" | "name") => Allowed::Anything,
            _ => value.map_or(Allowed::Nothing, |value| Allowed::Value { key, value }),
        }
    }

    fn has(self, found: &str) -> bool {
        match self {
            Allowed::Value { key, value } => found == value || !is_text(key) && same_numbers(found, value),
            Allowed::Probability => found.parse::<f64>().is_ok_and(|share| share > 0.0 && share <= 1.0),
            Allowed::Anything => true,
            Allowed::Nothing => false,
        }
    }
}

impl fmt::Display for Allowed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Allowed::Value { key, value } => write!(f, "{key}={value:?}"),
            Allowed::Probability => f.write_str("probabilities above 0 and up to 1"),
            Allowed::Anything => f.write_str("anything"),
            Allowed::Nothing => f.write_str("nothing"),
        }
    }
}

/// Returns whether an attribute's digits are not a number: `0101` is not `101`.
fn is_text(key: &str) -> bool {
    matches!(key, "response" | "foes" | "id" | "programID")
}

/// Returns whether both are lists of the same numbers, with blanks or commas between them.
fn same_numbers(found: &str, expected: &str) -> bool {
    matches!((numbers(found), numbers(expected)), (Ok(found), Ok(expected)) if found == expected)
}

fn numbers(text: &str) -> Result<Vec<f64>, ParseFloatError> {
    text.split([' ', ',']).map(str::parse).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;

    fn difference_of(found: &str, expected: &str) -> Option<String> {
        let [found, expected] = [found, expected].map(|text| parse(text).expect("XML of the test"));
        difference(&found, &expected)
    }

    #[test]
    fn numbers_may_be_written_otherwise_and_elements_may_be_in_another_order() {
        let expected = r#"<net><edge id="a" length="100.00" shape="0.00,1.60 2.00,3.00"/><edge id="b"/></net>"#;
        let found = r#"<net><location/><edge id="b"/><edge id="a" length="1e2" shape="0,1.6 2,3"/></net>"#;
        assert_eq!(difference_of(found, expected), None);
        let bits = difference_of(r#"<x><request foes="101"/></x>"#, r#"<x><request foes="0101"/></x>"#);
        assert_eq!(bits.unwrap(), r#"request 1 of x: foes="101", and this program simulates foes="0101""#);
    }

    #[test]
    fn what_is_only_drawn_may_differ() {
        let found =
            r#"<net version="2"><junction id="a" shape="1,1"/><junction id="b" name="Main St" color="red"/></net>"#;
        assert_eq!(difference_of(found, r#"<net><junction id="a" shape="0,0"/><junction id="b"/></net>"#), None);
        let lefthand = difference_of(r#"<net lefthand="true"/>"#, "<net/>").unwrap();
        assert_eq!(lefthand, r#"net: lefthand="true", and this program simulates none"#);
    }

    #[test]
    fn a_flow_has_any_probability_or_is_not_there() {
        let expected = r#"<routes><flow id="w0" probability="0.1"/><flow id="e0" probability="0.1"/></routes>"#;
        assert_eq!(difference_of(r#"<routes><flow id="e0" probability="1"/></routes>"#, expected), None);
        for probability in ["0", "1.5", "nan", "-0.1", "often"] {
            let found = format!(r#"<routes><flow id="e0" probability="{probability}"/></routes>"#);
            let told = difference_of(&found, expected).unwrap();
            assert!(told.contains(probability) && told.ends_with("probabilities above 0 and up to 1"), "{told}");
        }
        let hourly = difference_of(r#"<routes><flow id="e0" vehsPerHour="9"/></routes>"#, expected).unwrap();
        assert!(hourly.starts_with(r#"flow "e0": has no probability"#), "{hourly}");
    }

    #[test]
    fn an_element_that_is_missing_added_or_there_twice_is_told_whole() {
        let expected = r#"<net><connection from="a" to="b"/><connection from="b" to="c"/></net>"#;
        let lacks = difference_of(r#"<net><connection from="a" to="b"/></net>"#, expected).unwrap();
        assert_eq!(lacks, r#"it lacks <connection from="b" to="c">, which this program simulates"#);
        let with = |more: &str| difference_of(&expected.replace("</net>", &format!("{more}</net>")), expected).unwrap();
        assert_eq!(with(r#"<type id="road"/>"#), r#"it has <type id="road">, and this program simulates none"#);
        let twice = r#"it has connection from "a" twice, the second time as <connection from="a" to="c">"#;
        assert_eq!(with(r#"<connection from="a" to="c"/>"#), twice);
        let turned = expected.replace(r#"to="c""#, r#"to="a""#);
        let told = difference_of(&turned, expected).unwrap();
        assert_eq!(told, r#"connection from "b": to="a", and this program simulates to="c""#);
    }
}
