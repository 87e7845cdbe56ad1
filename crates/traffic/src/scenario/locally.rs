//! What of a scenario the local simulators of its lights do without. They have the cars that drive in lanes for cars.

use std::collections::BTreeMap;

use super::SumoScenario;
use crate::config::sumo_options::without_locally;
use crate::config::sumocfg::Notes;
use crate::network::tree::Element;

const PERSONS: &str = "nobody is on foot, so cars yield to nobody at crossings";
const STOPS: &str = "vehicles do not stop there";
const SPEEDS: &str = "speed limits stay as they are";
const ROADS: &str = "no road is closed";

/// Elements that mean something for traffic, and what is different without them.
const MISSING: [(&str, &str, &str); 8] = [
    ("person", "persons", PERSONS),
    ("personFlow", "flows of persons", PERSONS),
    ("container", "containers", PERSONS),
    ("containerFlow", "flows of containers", PERSONS),
    ("stop", "stops without a duration", STOPS),
    ("variableSpeedSign", "signs of a speed limit", SPEEDS),
    ("closingReroute", "closed roads", ROADS),
    ("closingLaneReroute", "closed lanes", ROADS),
];

pub(super) fn notes(scenario: &SumoScenario) -> Notes {
    let mut counts = BTreeMap::new();
    scenario.additional().chain(scenario.routes()).for_each(|root| count(root, &mut counts));
    let without_locally = counts.into_iter().map(|((kind, why), count)| format!("{kind} ({count}): {why}")).collect();
    let net = scenario.net();
    let is_connected = net.all("connection").next().is_some();
    let has_insides = net.all("edge").any(|edge| edge.attribute("function") == Some("internal"));
    let no_insides =
        "its net has no internal lanes, so cars jump over intersections; make it without --no-internal-links";
    let not_local = (is_connected && !has_insides).then(|| format!("{}: {no_insides}", scenario.net_path().display()));
    Notes { left_out: Vec::new(), without_locally, not_local: not_local.into_iter().collect() }
}

fn count<'a>(element: &'a Element, counts: &mut BTreeMap<(String, &'a str), usize>) {
    for child in &element.children {
        // Stops with a duration are carried over. Persons stop, too, and cars are not held up by that.
        let is_carried = child.name == "stop" && child.attribute("duration").is_some();
        let is_of_person = element.name.starts_with("person") || element.name.starts_with("container");
        let known = MISSING.into_iter().find(|(name, ..)| child.name == *name && !is_of_person && !is_carried);
        let device = || {
            let (key, value) = (child.attribute("key")?, child.attribute("value")?);
            Some((format!("parameters {key}"), without_locally(key, value)?))
        };
        let missing = known.map(|(_, kind, why)| (kind.to_owned(), why));
        if let Some(missing) = missing.or_else(device) {
            *counts.entry(missing).or_default() += 1;
        }
        count(child, counts);
    }
}
