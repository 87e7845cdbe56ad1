//! When an episode ends if the .sumocfg does not say it.
//!
//! SUMO then plays until the last vehicle has left. How long that takes depends on the lights, and episodes of one length are
//! needed: so an episode goes on for ten minutes after the last departure, and at least as long as the last vehicle needs on
//! free roads.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use anyhow::Result;

use super::departing::each;
use super::include;
use crate::config::sumocfg::Sumocfg;
use crate::network::roads::{EdgeNo, Roads};
use crate::network::tree::{Element, parse_file, read_whole};

const AFTER_LAST_S: f64 = 600.0;
/// How long an episode is in which nobody departs.
const EMPTY_S: u64 = 3600;
/// An episode ends at a whole minute.
const MINUTE_S: f64 = 60.0;

/// Returns the second at which an episode ends.
pub(crate) fn of(scenario: &Sumocfg) -> Result<u64> {
    let mut last: Option<(f64, Element)> = None;
    let mut routes = HashMap::new();
    for path in scenario.additional.iter().chain(&scenario.routes) {
        let mut root = parse_file(path, &read_whole(path)?)?;
        include::put_in_place(path, &mut root)?;
        for departing in each(&root) {
            let element = departing.element;
            let departs_s = departing.departs().then(|| departing.last_s(scenario.begin_s as f64)).flatten();
            if let Some(departs_s) = departs_s
                && last.as_ref().is_none_or(|(latest_s, _)| departs_s > *latest_s)
            {
                last = Some((departs_s, element.clone()));
            } else if let (Some(id), Some(edges)) = (element.attribute("id"), element.attribute("edges")) {
                routes.insert(id.to_owned(), edges.to_owned());
            }
        }
    }
    let Some((departs_s, vehicle)) = last else { return Ok(scenario.begin_s + EMPTY_S) };
    // Whoever opens the scenario says what is wrong with its net.
    let drives_s = Roads::of_file(&scenario.net).ok().and_then(|roads| way_s(&roads, &vehicle, &routes)).unwrap_or(0.0);
    let end_s = departs_s.max(scenario.begin_s as f64) + AFTER_LAST_S.max(drives_s);
    Ok(((end_s / MINUTE_S).ceil() * MINUTE_S) as u64)
}

/// Returns how long a vehicle drives on free roads. `None` if its way is not known here, as between zones. `routes`: edges of the
/// routes that have a name.
fn way_s(roads: &Roads, vehicle: &Element, routes: &HashMap<String, String>) -> Option<f64> {
    let inner = || vehicle.all("route").next()?.attribute("edges");
    let named = || routes.get(vehicle.attribute("route")?).map(String::as_str);
    let edge = |name: &str| roads.edge_named(name);
    match inner().or_else(named) {
        Some(edges) => edges.split_whitespace().map(|name| on_edge_s(roads, edge(name)?)).sum(),
        None => fastest_s(roads, edge(vehicle.attribute("from")?)?, edge(vehicle.attribute("to")?)?),
    }
}

fn on_edge_s(roads: &Roads, edge: EdgeNo) -> Option<f64> {
    let lane = roads.lane(*roads.edge(edge).lanes.first()?);
    Some(lane.length_m / lane.speed_limit_mps)
}

/// Dijkstra's algorithm. Keys are milliseconds, because those of a heap must be in order.
fn fastest_s(roads: &Roads, from: EdgeNo, to: EdgeNo) -> Option<f64> {
    let millis_on = |edge| Some((on_edge_s(roads, edge)? * 1000.0).ceil() as u64);
    let mut queue = BinaryHeap::from([Reverse((millis_on(from)?, from))]);
    let mut done = vec![false; roads.edges.len()];
    while let Some(Reverse((millis, edge))) = queue.pop() {
        if edge == to {
            return Some(millis as f64 / 1000.0);
        }
        if std::mem::replace(&mut done[edge.0], true) {
            continue;
        }
        let links = roads.edge(edge).lanes.iter().flat_map(|&lane| roads.links_from(lane));
        let onward = links.map(|link| roads.lane(link.to).edge);
        queue.extend(onward.filter_map(|next| Some(Reverse((millis + millis_on(next)?, next)))));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::roads::example::{changed, roads};

    /// The way from `far` to `near` takes 904 s, that to `out` 14 s longer.
    const LONG: (&str, &str) = ("length='240'", "length='12510'");

    fn end(demand: &str) -> u64 {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| {
            std::fs::write(dir.path().join(name), text).unwrap();
            dir.path().join(name)
        };
        let net = file("a.net.xml", &changed(&[LONG]));
        let routes = vec![file("a.rou.xml", &format!("<routes>{demand}</routes>"))];
        of(&Sumocfg { net, routes, begin_s: 100, ..Sumocfg::default() }).unwrap()
    }

    #[test]
    fn an_episode_without_an_end_goes_on_after_the_last_departure() {
        for (demand, expected) in [
            ("", 3700),
            ("<vType id='t'/><route id='r' edges='far near'/>", 3700),
            ("<trip id='v' depart='0' from='north' to='out'/>", 720),
            ("<trip id='v' depart='121' from='north' to='out'/>", 780),
            ("<person id='p' depart='01:00:00'><walk edges='north'/></person>", 4200),
            (
                "<trip id='v' depart='triggered' from='north' to='out'/><trip id='w' depart='200' from='north' to='out'/>",
                840,
            ),
            // The last one drives for 904 s.
            ("<trip id='v' depart='100' from='far' to='near'/>", 1020),
            ("<route id='r' edges='far near'/><vehicle id='v' depart='100' route='r'/>", 1020),
            ("<vehicle id='v' depart='100'><route edges='far near'/></vehicle>", 1020),
            ("<flow id='f' begin='100' end='1000' period='5' from='north' to='out'/>", 1620),
            ("<flow id='f' begin='100' number='10' period='50' from='north' to='out'/>", 1200),
            ("<flow id='f' number='36' vehsPerHour='360' from='north' to='out'/>", 1080),
            ("<flow id='f' begin='100' period='5' from='north' to='out'/>", 4320),
            ("<interval begin='100' end='1000'><flow id='f' number='9' from='north' to='out'/></interval>", 1620),
        ] {
            assert_eq!(end(demand), expected, "{demand}");
        }
    }

    #[test]
    fn the_fastest_way_is_found_and_none_where_there_is_none() {
        let roads = roads(&[LONG]);
        let [far, near, out] = ["far", "near", "out"].map(|name| roads.edge_named(name).unwrap());
        let [to_near, to_out] = [near, out].map(|to| fastest_s(&roads, far, to).unwrap().round());
        assert_eq!([to_near, to_out], [904.0, 917.0]);
        assert_eq!(fastest_s(&roads, out, far), None);
    }
}
