//! When an episode ends if the .sumocfg does not say it.
//!
//! SUMO then plays until the last vehicle has left. How long that takes depends on the lights, and episodes of one length are
//! needed: so an episode goes on for ten minutes after the last departure, and at least as long as the last vehicle needs on
//! free roads.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use anyhow::Result;

use crate::config::sumo_time::seconds;
use crate::config::sumocfg::Sumocfg;
use crate::network::tree::{Element, parse_file, read_whole};

const AFTER_LAST_S: f64 = 600.0;
/// How long a flow goes on that has neither an end nor a number. SUMO lets it go on for ever.
const ENDLESS_FLOW_S: f64 = 3600.0;
/// An episode ends at a whole minute.
const MINUTE_S: f64 = 60.0;

const DEPART: [&str; 4] = ["vehicle", "trip", "person", "container"];
const FLOWS: [&str; 3] = ["flow", "personFlow", "containerFlow"];

/// Returns the second at which an episode ends; `None` if nobody departs.
pub(crate) fn of(scenario: &Sumocfg) -> Result<Option<u64>> {
    let mut last: Option<(f64, Element)> = None;
    let mut routes = HashMap::new();
    for path in scenario.additional.iter().chain(&scenario.routes) {
        let root = parse_file(path, &read_whole(path)?)?;
        for element in root.children {
            if let Some(departs_s) = last_departure(&element, scenario.begin_s as f64)
                && last.as_ref().is_none_or(|(latest_s, _)| departs_s > *latest_s)
            {
                last = Some((departs_s, element));
            } else if let (Some(id), Some(edges)) = (element.attribute("id"), element.attribute("edges")) {
                routes.insert(id.to_owned(), edges.to_owned());
            }
        }
    }
    let Some((departs_s, vehicle)) = last else { return Ok(None) };
    let net = parse_file(&scenario.net, &read_whole(&scenario.net)?)?;
    let drives_s = Roads::of(&net).way_s(&vehicle, &routes).unwrap_or(0.0);
    let end_s = departs_s.max(scenario.begin_s as f64) + AFTER_LAST_S.max(drives_s);
    Ok(Some(((end_s / MINUTE_S).ceil() * MINUTE_S) as u64))
}

/// Returns when the last vehicle of an element departs. `None`: it is none, or departs when something else happens.
fn last_departure(element: &Element, begin_s: f64) -> Option<f64> {
    let time = |key: &str| seconds(element.attribute(key)?).ok();
    if DEPART.contains(&&*element.name) {
        return time("depart");
    }
    if !FLOWS.contains(&&*element.name) {
        return None;
    }
    let begins_s = time("begin").unwrap_or(begin_s);
    let number = |key: &str| element.attribute(key)?.trim().parse::<f64>().ok();
    let per_hour = number("vehsPerHour").or(number("perHour")).or(number("personsPerHour"));
    let period_s = number("period").or(per_hour.map(|rate| 3600.0 / rate));
    let of_number = || Some(begins_s + number("number")? * period_s?);
    let last_s = time("end").or_else(of_number).unwrap_or(begins_s + ENDLESS_FLOW_S);
    last_s.is_finite().then_some(last_s)
}

/// Roads as a graph: seconds on each at the speed limit, and where they lead.
struct Roads<'a> {
    seconds: HashMap<&'a str, f64>,
    next: HashMap<&'a str, Vec<&'a str>>,
}

impl<'a> Roads<'a> {
    fn of(net: &'a Element) -> Roads<'a> {
        let number = |element: &Element, key: &str| element.attribute(key)?.parse::<f64>().ok();
        let on_lane = |lane: &Element| Some(number(lane, "length")? / number(lane, "speed")?);
        let on_edge = |edge: &'a Element| Some((edge.attribute("id")?, edge.all("lane").next().and_then(on_lane)?));
        let mut next: HashMap<&str, Vec<&str>> = HashMap::new();
        for connection in net.all("connection") {
            if let (Some(from), Some(to)) = (connection.attribute("from"), connection.attribute("to")) {
                next.entry(from).or_default().push(to);
            }
        }
        Roads { seconds: net.all("edge").filter_map(on_edge).collect(), next }
    }

    /// Returns how long a vehicle drives on free roads. `None` if its way is not known here, as between zones.
    fn way_s(&self, vehicle: &Element, routes: &HashMap<String, String>) -> Option<f64> {
        let inner = || vehicle.all("route").next()?.attribute("edges");
        let named = || routes.get(vehicle.attribute("route")?).map(String::as_str);
        match inner().or_else(named) {
            Some(edges) => edges.split_whitespace().map(|edge| self.seconds.get(edge)).sum(),
            None => self.fastest_s(vehicle.attribute("from")?, vehicle.attribute("to")?),
        }
    }

    /// Dijkstra's algorithm. Keys are milliseconds, because those of a heap must be in order.
    fn fastest_s(&self, from: &str, to: &str) -> Option<f64> {
        let cost = |edge: &str| Some((self.seconds.get(edge)? * 1000.0).ceil() as u64);
        let (from, _) = self.seconds.get_key_value(from)?;
        let mut queue = BinaryHeap::from([Reverse((cost(from)?, *from))]);
        let mut known: HashMap<&str, u64> = HashMap::new();
        while let Some(Reverse((millis, edge))) = queue.pop() {
            if edge == to {
                return Some(millis as f64 / 1000.0);
            }
            if known.get(edge).is_some_and(|best| *best <= millis) {
                continue;
            }
            known.insert(edge, millis);
            let onward = self.next.get(edge).into_iter().flatten();
            queue.extend(onward.filter_map(|next| Some(Reverse((millis + cost(next)?, *next)))));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;

    const NET: &str = "<net><edge id='a'><lane length='100' speed='10'/></edge><edge id='b'><lane length='9000' speed='10'/>\
                       </edge><edge id='c'><lane length='50' speed='10'/></edge><connection from='a' to='b'/>\
                       <connection from='a' to='c'/><connection from='c' to='b'/></net>";

    fn end(demand: &str) -> Option<u64> {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| {
            std::fs::write(dir.path().join(name), text).unwrap();
            dir.path().join(name)
        };
        let net = file("a.net.xml", NET);
        let routes = vec![file("a.rou.xml", &format!("<routes>{demand}</routes>"))];
        of(&Sumocfg { net, routes, begin_s: 100, ..Sumocfg::default() }).unwrap()
    }

    #[test]
    fn an_episode_without_an_end_goes_on_after_the_last_departure() {
        for (demand, expected) in [
            ("", None),
            ("<vType id='t'/><route id='r' edges='a b'/>", None),
            ("<trip id='v' depart='0' from='a' to='c'/>", Some(720)),
            ("<trip id='v' depart='121' from='a' to='c'/>", Some(780)),
            ("<person id='p' depart='01:00:00'><walk edges='a'/></person>", Some(4200)),
            ("<trip id='v' depart='triggered' from='a' to='c'/><trip id='w' depart='200' from='a' to='c'/>", Some(840)),
            // The last one drives for 910 s.
            ("<trip id='v' depart='100' from='a' to='b'/>", Some(1020)),
            ("<route id='r' edges='a b'/><vehicle id='v' depart='100' route='r'/>", Some(1020)),
            ("<vehicle id='v' depart='100'><route edges='a b'/></vehicle>", Some(1020)),
            ("<flow id='f' begin='100' end='1000' period='5' from='a' to='c'/>", Some(1620)),
            ("<flow id='f' begin='100' number='10' period='50' from='a' to='c'/>", Some(1200)),
            ("<flow id='f' number='36' vehsPerHour='360' from='a' to='c'/>", Some(1080)),
            ("<flow id='f' begin='100' period='5' from='a' to='c'/>", Some(4320)),
        ] {
            assert_eq!(end(demand), expected, "{demand}");
        }
    }

    #[test]
    fn the_fastest_way_is_found_and_none_where_there_is_none() {
        let net = parse(NET).unwrap();
        let roads = Roads::of(&net);
        assert_eq!([roads.fastest_s("a", "b"), roads.fastest_s("b", "a")], [Some(910.0), None]);
    }
}
