//! A way along edges of a scenario: the one that the user names, or the one with the most lights.

use std::collections::{BTreeMap, HashSet};

use anyhow::{Result, bail, ensure};

use crate::outside::excerpt;
use crate::traffic::network::roads::{Connection, EdgeNo, Roads};
use crate::traffic::sim::recorded_roads::RecordedScenario;
use crate::traffic::sim::recording::Recording;

/// Edges that follow each other, each of them once; at least one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route(Vec<EdgeNo>);

impl Route {
    /// Reads the names of edges, separated by commas or blanks. An error says which edge is wrong.
    pub fn read(text: &str, roads: &Roads) -> Result<Route> {
        let names: Vec<&str> = text.split([',', ' ']).filter(|name| !name.is_empty()).collect();
        ensure!(!names.is_empty(), "names no edge; name edges that follow each other, separated by commas");
        let mut edges: Vec<EdgeNo> = Vec::new();
        for name in names {
            let edge = roads.edge_named(name).filter(|&edge| roads.edge(edge).ends.is_some());
            let Some(edge) = edge else {
                bail!("the net has no edge `{}`; sumo-gui shows the names of edges", excerpt(name))
            };
            ensure!(!edges.contains(&edge), "names edge `{name}` twice; a picture can show each edge once");
            if let Some(&before) = edges.last()
                && ways(roads, before, edge).next().is_none()
            {
                bail!("{}", no_way(roads, before, name));
            }
            edges.push(edge);
        }
        Ok(Route(edges))
    }

    /// Returns the route of the cars of an episode that passes the most lights under control. Of several it is the one
    /// that the most cars took. `None`: no car entered.
    pub fn with_most_lights(recording: &Recording, scenario: &RecordedScenario) -> Option<Route> {
        let roads = &scenario.roads;
        let learning: HashSet<&str> = scenario.agents.iter().map(|agent| agent.light.as_str()).collect();
        let lit = |two: &[EdgeNo]| light_between(roads, two[0], two[1]).is_some_and(|light| learning.contains(light));
        let mut taken: BTreeMap<&[String], usize> = BTreeMap::new();
        recording.entries.iter().for_each(|entry| *taken.entry(&entry.car.edges).or_default() += 1);
        let known = taken.into_iter().filter_map(|(names, cars)| {
            let edges = names.iter().map(|name| roads.edge_named(name)).collect::<Option<Vec<EdgeNo>>>()?;
            let differ = edges.iter().collect::<HashSet<_>>().len() == edges.len();
            let lights = edges.windows(2).filter(|two| lit(two)).count();
            (differ && !edges.is_empty()).then_some((lights, cars, edges))
        });
        // The order of the names decides between equals.
        let best = known.reduce(|best, next| if (next.0, next.1) > (best.0, best.1) { next } else { best });
        best.map(|(_, _, edges)| Route(edges))
    }

    pub fn edges(&self) -> &[EdgeNo] {
        &self.0
    }
}

/// Returns the connections that lead from an edge to the next one.
pub fn ways(roads: &Roads, from: EdgeNo, to: EdgeNo) -> impl Iterator<Item = &Connection> {
    let lanes = roads.edge(from).lanes.iter();
    lanes.flat_map(|&lane| roads.from_lane(lane)).filter(move |way| roads.lane(way.to).edge == to)
}

/// Returns the light between an edge and the next one.
pub fn light_between(roads: &Roads, from: EdgeNo, to: EdgeNo) -> Option<&str> {
    ways(roads, from, to).find_map(|way| way.signal.as_ref()).map(|signal| signal.light.as_str())
}

/// Returns the error about an edge that does not follow another one, with those that do.
fn no_way(roads: &Roads, before: EdgeNo, name: &str) -> String {
    let lanes = roads.edge(before).lanes.iter();
    let next = lanes.flat_map(|&lane| roads.from_lane(lane)).map(|way| roads.edge(roads.lane(way.to).edge));
    let mut next: Vec<&str> = next.map(|edge| edge.id.as_str()).collect();
    next.sort_unstable();
    next.dedup();
    let before = &roads.edge(before).id;
    match next.is_empty() {
        true => format!("no edge follows `{before}`, so `{name}` cannot; end the route there"),
        false => format!("edge `{name}` does not follow `{before}`; these do: {}", next.join(", ")),
    }
}
