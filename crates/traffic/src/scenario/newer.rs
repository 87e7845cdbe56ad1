//! Nets that were made for a newer SUMO than the one here.

use std::collections::BTreeSet;

use crate::network::tree::Element;
use libsumo::Version;

/// Classes of vehicles since SUMO 1.20. Older ones refuse a net that names them. From 1.25 on, SUMO skips all that it does not
/// know (tried with 1.15 to 1.28).
const CLASSES: [&str; 7] = ["aircraft", "cable_car", "container", "drone", "scooter", "subway", "wheelchair"];
const CLASSES_SINCE: Version = Version { major: 1, minor: 20, patch: 0 };

/// Attributes of lanes, connections, types of roads and stops that list classes.
const LISTS: [&str; 6] = ["allow", "disallow", "changeLeft", "changeRight", "vClasses", "exceptions"];
/// An attribute that names one class. Its element is about this class alone.
const ONE: &str = "vClass";
/// A class of no vehicle that a scenario has. A list must not become empty, because an empty one stands for all classes.
const NOBODY: &str = "ignoring";

/// Takes classes that the SUMO `here` does not know out of a net. Returns a sentence about them, if there were some. `here` is
/// asked only if the net names one of them. `None`: there is no SUMO that would load the net.
pub(super) fn forget_classes(net: &mut Element, here: impl FnOnce() -> Option<Version>) -> Option<String> {
    let list = named_below(net).into_iter().collect::<Vec<_>>().join(", ");
    let here = (!list.is_empty()).then(here)??;
    if here >= CLASSES_SINCE {
        return None;
    }
    forget_below(net);
    let made_for = net.attribute("version").unwrap_or("unknown");
    Some(format!("vehicle classes {list}: SUMO {here} does not know them (the net has format {made_for})"))
}

/// Returns which of the new classes are listed.
fn named_below(element: &Element) -> BTreeSet<&str> {
    let lists = element.attributes.iter().filter(|(name, _)| LISTS.contains(&&**name));
    let own = lists.flat_map(|(_, list)| list.split_whitespace()).chain(element.attribute(ONE));
    let own = own.filter(|class| CLASSES.contains(class));
    own.chain(element.children.iter().flat_map(named_below)).collect()
}

fn forget_below(element: &mut Element) {
    for (_, list) in element.attributes.iter_mut().filter(|(name, _)| LISTS.contains(&&**name)) {
        let known: Vec<&str> = list.split_whitespace().filter(|class| !CLASSES.contains(class)).collect();
        let all_are_new = known.is_empty() && !list.trim().is_empty();
        *list = if all_are_new { NOBODY.to_owned() } else { known.join(" ") };
    }
    element.children.retain(|child| child.attribute(ONE).is_none_or(|class| !CLASSES.contains(&class)));
    element.children.iter_mut().for_each(forget_below);
}

/// Returns what to do if the SUMO `here` cannot read a net: a newer SUMO, if the net is made for one.
pub(super) fn way_out(net: &Element, here: Version) -> Option<String> {
    let made_for = Version::parse(net.attribute("version")?)?;
    let is_newer = (made_for.major, made_for.minor) > (here.major, here.minor);
    is_newer.then(|| {
        format!(
            "this net is of SUMO {}.{} or newer; the SUMO here is {here}: pip install eclipse-sumo",
            made_for.major, made_for.minor
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;
    use crate::network::xml;

    #[test]
    fn an_old_sumo_gets_a_net_without_the_classes_of_new_ones() {
        let text = "<net version=\"1.20\"><edge id=\"a\"><lane id=\"a_0\" allow=\"bus drone\"/><lane id=\"a_1\" \
                    allow=\"container scooter\"/><lane id=\"drone\" disallow=\"tram subway\">\
                    <stopOffset vClasses=\"scooter\"/></lane></edge><type id=\"t\"><restriction \
                    vClass=\"aircraft\" speed=\"9\"/></type></net>";
        let [old, new] = ["1.15.0", "1.20.0"].map(|version| Version::parse(version).unwrap());
        let mut net = parse(text).unwrap();
        assert_eq!(forget_classes(&mut net, || Some(new)), None);
        let note = forget_classes(&mut net, || Some(old)).unwrap();
        assert!(
            note.starts_with("vehicle classes aircraft, container, drone, scooter, subway: SUMO 1.15.0 does not"),
            "{note}"
        );
        let text = xml::text(&net);
        assert!(!text.contains("restriction"), "{text}");
        for part in
            ["vClasses=\"ignoring\"", "allow=\"bus\"", "allow=\"ignoring\"", "disallow=\"tram\"", "id=\"drone\""]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert_eq!(way_out(&net, new), None);
        assert!(way_out(&net, old).unwrap().starts_with("this net is of SUMO 1.20 or newer; the SUMO here is 1.15.0"));
    }
}
