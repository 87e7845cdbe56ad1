//! A way along edges of a scenario: the one that the user names, or the one on which lights meet the most cars.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use anyhow::{Result, bail, ensure};

use crate::network::roads::{Connection, EdgeNo, Roads};
use crate::sim::recorded_roads::RecordedRoads;
use crate::sim::recording::Recording;
use dials_core::outside::{did_you_mean, excerpt};

/// Edges that follow each other, each of them once; at least one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route(pub(super) Vec<EdgeNo>);

impl Route {
    /// Reads the names of edges, separated by commas or blanks. An error says which edge is wrong.
    pub(crate) fn read(text: &str, roads: &Roads) -> Result<Route> {
        let names: Vec<&str> = text.split([',', ' ']).filter(|name| !name.is_empty()).collect();
        ensure!(!names.is_empty(), "names no edge; name edges that follow each other, separated by commas");
        let mut edges: Vec<EdgeNo> = Vec::new();
        for name in names {
            let edge = roads.edge_named(name).filter(|&edge| roads.edge(edge).ends.is_some());
            let Some(edge) = edge else {
                let near = did_you_mean(name, roads.roads().map(|(_, edge)| &*edge.id));
                bail!("the net has no edge `{}`{near}; sumo-gui shows the names of edges", excerpt(name))
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

    /// Returns the route of a car of an episode on which lights under control meet the most cars. A car counts at each
    /// light, and also if it drives only a part of the route. `None`: no car entered.
    pub(crate) fn busiest(recording: &Recording) -> Option<Route> {
        let RecordedRoads { roads, agents, .. } = &*recording.roads;
        let learning: HashSet<&str> = agents.iter().map(|agent| agent.light.as_str()).collect();
        let lit = |two: &[EdgeNo]| light_between(roads, two[0], two[1]).is_some_and(|light| learning.contains(light));
        let driven = recording.entries.iter().filter_map(|entry| {
            entry.car.edges.iter().map(|name| roads.edge_named(name)).collect::<Option<Vec<EdgeNo>>>()
        });
        let driven: Vec<Vec<EdgeNo>> = driven.filter(|edges| !edges.is_empty()).collect();
        let mut cars: BTreeMap<&[EdgeNo], usize> = BTreeMap::new();
        driven.iter().flat_map(|edges| edges.windows(2)).for_each(|two| *cars.entry(two).or_default() += 1);
        cars.retain(|two, _| lit(two));
        let met = |edges: &[EdgeNo]| edges.windows(2).filter_map(|two| cars.get(two)).sum::<usize>();
        // A picture can show each edge once. Of equals the one with the lower numbers of edges counts.
        let differ = |edges: &&Vec<EdgeNo>| edges.iter().collect::<HashSet<_>>().len() == edges.len();
        let routes: BTreeSet<&Vec<EdgeNo>> = driven.iter().filter(differ).collect();
        let best = routes.into_iter().rev().max_by_key(|edges| met(edges));
        best.cloned().map(Route)
    }
}

pub(crate) fn ways(roads: &Roads, from: EdgeNo, to: EdgeNo) -> impl Iterator<Item = &Connection> {
    let lanes = roads.edge(from).lanes.iter();
    lanes.flat_map(|&lane| roads.links_from(lane)).filter(move |way| roads.lane(way.to).edge == to)
}

pub(crate) fn light_between(roads: &Roads, from: EdgeNo, to: EdgeNo) -> Option<&str> {
    ways(roads, from, to).find_map(|way| way.signal.as_ref()).map(|signal| signal.light.as_str())
}

/// Returns the error about an edge that does not follow another one, with those that do.
fn no_way(roads: &Roads, before: EdgeNo, name: &str) -> String {
    let lanes = roads.edge(before).lanes.iter();
    let next = lanes.flat_map(|&lane| roads.links_from(lane)).map(|way| roads.edge(roads.lane(way.to).edge));
    // Walking areas are no edges for cars.
    let mut next: Vec<&str> = next.map(|edge| edge.id.as_str()).filter(|id| !id.starts_with(':')).collect();
    next.sort_unstable();
    next.dedup();
    let before = &roads.edge(before).id;
    match next.is_empty() {
        true => format!("no edge follows `{before}`, so `{name}` cannot; end the route there"),
        false => format!("edge `{name}` does not follow `{before}`; these do: {}", next.join(", ")),
    }
}
