//! Who else comes to a light: buses on its approaches, trams on tracks of their own, and persons at its crossings.

use std::collections::BTreeSet;

use crate::network::roads::{Function, LaneNo, Roads};

/// Classes of vehicles that carry many persons.
pub(crate) const PUBLIC: [&str; 4] = ["bus", "coach", "tram", "rail_urban"];

#[derive(Clone, Debug, Default, PartialEq)]
pub struct OthersPlan {
    /// Lanes at the stop line on which no cars drive, but trams do.
    pub tracks: Vec<Track>,
    pub crossings: Vec<Crossing>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    pub lane: String,
    pub(crate) speed_limit_mps: f64,
}

/// A crossing under the light, and the pavements from which persons come to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Crossing {
    pub edge: String,
    pub areas: Vec<String>,
    /// Indices of its letters in the light's state. A letter that only the way back has is not among them.
    pub(crate) letters: BTreeSet<usize>,
}

#[cfg(test)]
impl Crossing {
    pub(crate) fn of_letters(letters: &[usize]) -> Crossing {
        Crossing { edge: String::new(), areas: Vec::new(), letters: letters.iter().copied().collect() }
    }
}

impl OthersPlan {
    pub(crate) fn of(roads: &Roads, light: &str) -> OthersPlan {
        let for_trams = |lane: LaneNo| {
            let lane = roads.lane(lane);
            !lane.carries_cars && PUBLIC.iter().any(|class| lane.classes.has(class)) && !lane.classes.has("pedestrian")
        };
        let lanes: BTreeSet<LaneNo> =
            roads.of_light(light).map(|link| link.from).filter(|&lane| for_trams(lane)).collect();
        let tracks = lanes.into_iter().map(|lane| {
            let lane = roads.lane(lane);
            Track { lane: lane.id.clone(), speed_limit_mps: lane.speed_limit_mps }
        });
        let edge_of = |lane: LaneNo| roads.lane(lane).edge;
        let is = |lane: LaneNo, function| roads.edge(edge_of(lane)).function == function;
        let crossings = roads.of_light(light).map(|link| link.to).filter(|&lane| is(lane, Function::Crossing));
        let crossings: BTreeSet<_> = crossings.map(edge_of).collect();
        let crossing = |crossing| {
            let lanes = &roads.edge(crossing).lanes;
            let from = lanes.iter().flat_map(|&lane| roads.links_to(lane)).map(|link| link.from);
            // Persons walk both ways, so they come from the pavement at its end, too.
            let to = lanes.iter().flat_map(|&lane| roads.links_from(lane)).map(|link| link.to);
            let areas = from.chain(to).filter(|&lane| is(lane, Function::WalkingArea));
            let areas: BTreeSet<_> = areas.map(edge_of).collect();
            let name = |edge| roads.edge(edge).id.clone();
            let links = roads.of_light(light).filter(|link| edge_of(link.to) == crossing);
            let letters = links.filter_map(|link| Some(link.signal.as_ref()?.letter)).collect();
            Crossing { edge: name(crossing), areas: areas.into_iter().map(name).collect(), letters }
        };
        OthersPlan { tracks: tracks.collect(), crossings: crossings.into_iter().map(crossing).collect() }
    }
}
