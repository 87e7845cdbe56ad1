//! Attributes and parameters in a file of SUMO that make SUMO write or read another file.
//!
//! Networks may come from strangers. SUMO opens whatever such a file names, with the rights of the user. So one line in
//! an additional file can overwrite any file of theirs. All of it is refused before SUMO loads anything. Elements that
//! write by themselves, such as detectors, are no part of a grid of ours (`paper_grid/compare.rs`) nor of what a scenario
//! may hold (`scenario/elements.rs`).
//!
//! Source: SUMO 1.15, `src/netload/NLHandler.cpp`, `src/microsim/devices` and `src/microsim/traffic_lights`.

use std::path::Path;

use anyhow::{Result, bail};

use super::tree::Element;
use dials_core::outside::{Printable, excerpt};

const ATTRIBUTES: [(&str, &str); 5] =
    [("file", "writes"), ("output", "writes"), ("dest", "writes"), ("href", "reads"), ("imgFile", "reads")];

/// Beginnings of the keys of `<param>` that give a vehicle a device which writes. The surrogate safety device writes
/// into the working directory even without a file name.
const DEVICES: [&str; 2] = ["has.ssm.", "device.ssm."];

/// Programs of lights that write no file but that of their parameter `file`. Swarm lights also write to `SWARMLOG`.
const PROGRAMS: [&str; 7] = ["static", "actuated", "delay_based", "NEMA", "rail_signal", "rail_crossing", "off"];

/// Emission models that read their data from files.
const EMISSIONS: &str = "PHEMlight";

/// What SUMO takes for a file that keeps nothing.
pub(crate) const NOWHERE: &str = "NUL";

/// Returns an error if SUMO, given this file, would write or read another one. It names the element and the file.
pub(crate) fn refuse(path: &Path, element: &Element) -> Result<()> {
    if let Some((what, does)) = found(element) {
        bail!("{}: has {}, by which SUMO {does} another file; remove it", path.display(), Printable(what));
    }
    element.children.iter().try_for_each(|child| refuse(path, child))
}

/// Returns the part of an element that opens another file, and what SUMO does to that file.
fn found(element: &Element) -> Option<(String, &'static str)> {
    let Element { name, attributes, .. } = element;
    let attribute = attributes.iter().find_map(|(key, value)| {
        let (_, does) = ATTRIBUTES.iter().find(|(other, _)| other == key && value != NOWHERE)?;
        Some((format!("{key}=\"{}\" in <{name}>", excerpt(value)), *does))
    });
    attribute.or_else(|| match name.as_str() {
        "param" => element.attribute("key").filter(|key| names_a_file(key)).map(|_| (in_the_tag(element), "writes")),
        "tlLogic" => {
            let kind = element.attribute("type").filter(|kind| !PROGRAMS.contains(kind))?;
            Some((format!("a light of type=\"{}\"", excerpt(kind)), "may write"))
        }
        _ => {
            let class = element.attribute("emissionClass").filter(|class| reads_emissions(class))?;
            Some((format!("emissionClass=\"{}\" in <{name}>", excerpt(class)), "reads"))
        }
    })
}

fn in_the_tag(element: &Element) -> String {
    let kinds = ["id", "file", "key"].map(|key| element.attribute(key).map(|value| (key, value)));
    let shown = kinds.into_iter().flatten().map(|(key, value)| format!(" {key}=\"{}\"", excerpt(value)));
    format!("<{}{}>", element.name, shown.collect::<String>())
}

/// Returns whether a parameter with this key names a file, or gives a vehicle a device that writes one.
pub(crate) fn names_a_file(key: &str) -> bool {
    let key = key.to_ascii_lowercase();
    let words = ["file", "output", "swarmlog"];
    words.iter().any(|word| key.contains(word)) || DEVICES.iter().any(|device| key.starts_with(device))
}

pub(crate) fn reads_emissions(class: &str) -> bool {
    class.starts_with(EMISSIONS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;

    fn refusal(text: &str) -> Option<String> {
        let root = parse(&format!("<additional><x>{text}</x></additional>")).expect("XML of the test");
        refuse(Path::new("a.add.xml"), &root).err().map(|error| error.to_string())
    }

    #[test]
    fn what_opens_no_file_is_allowed() {
        for allowed in [
            "<tlLogic id='B' type='off'/>",
            "<e1Detector id='a' file='NUL'/>",
            "<param key='has.toc.device' value='true'/>",
            "<param key='max-gap' value='3.0'/>",
            "<tlLogic id='a' type='actuated'/>",
            "<vType id='a' emissionClass='HBEFA4/PC'/>",
            "<param key='has.rerouting.device' value='true'/>",
        ] {
            assert_eq!(refusal(allowed), None);
        }
    }

    #[test]
    fn names_of_a_stranger_are_shown_printable_and_short() {
        let message = refusal(&format!("<poly id=\"a\" file=\"\u{202e}{}\"/>", "x".repeat(10_000))).unwrap();
        assert!(!message.contains('\u{202e}') && message.len() < 300, "{message}");
    }
}
