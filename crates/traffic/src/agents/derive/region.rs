//! The roads around a light: its junctions, and those before it that no light controls.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, ensure};

use crate::network::roads::{EdgeNo, JunctionNo, LaneNo, Place, Roads};

/// Largest number of junctions of a region, unless the light itself has more.
const MOST_JUNCTIONS: usize = 8;

#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    pub own: BTreeSet<JunctionNo>,
    /// Uncontrolled junctions that cars pass on their way to the light, the nearest first.
    pub passed: Vec<JunctionNo>,
    /// Lanes on which cars come to the light, with the distance from the end of each to the stop line in metres.
    pub ahead_m: BTreeMap<LaneNo, f64>,
    pub(crate) approach_m: f64,
}

impl Region {
    /// Goes backwards from a light through uncontrolled junctions until `approach_m` is covered, but never through a
    /// light or a turn-around. `lit`: what [`lit_junctions`] returns. `only`: names of the edges that it may go to; one
    /// that is not in the net or does not lead to the light is an error.
    pub(crate) fn of(
        roads: &Roads,
        lit: &BTreeSet<JunctionNo>,
        light: &str,
        approach_m: f64,
        only: Option<&[String]>,
    ) -> Result<Region> {
        let only = only.map(|names| edges(roads, light, names)).transpose()?;
        let may_see = |lane: LaneNo| only.as_ref().is_none_or(|only| only.contains(&roads.lane(lane).edge));
        let at_stop_line = roads.under_light(light).map(|link| link.from).filter(|&lane| may_see(lane));
        let mut region = Region {
            own: roads.junctions_of(light),
            passed: Vec::new(),
            ahead_m: at_stop_line.map(|lane| (lane, 0.0)).collect(),
            approach_m,
        };
        region.go_back(roads, lit, may_see);
        for edge in only.into_iter().flatten() {
            let seen = region.ahead_m.keys().any(|&lane| roads.lane(lane).edge == edge);
            ensure!(
                seen,
                "agents.toml: light `{light}`: approaches: no lane of edge `{}` leads to it within {approach_m} m of \
                 the stop line, over edges of this list; add the edges between, or leave it out",
                roads.edge(edge).id
            );
        }
        Ok(region)
    }

    /// Adds what lies before the lanes of the region, the nearest first, so that each lane is visited once.
    fn go_back(&mut self, roads: &Roads, lit: &BTreeSet<JunctionNo>, may_see: impl Fn(LaneNo) -> bool) {
        // Distances are not negative, so their bits are in the same order.
        let begin = |lane: LaneNo, ahead_m: f64| ((ahead_m + roads.lane(lane).length_m).to_bits(), lane);
        let mut open: BTreeSet<(u64, LaneNo)> =
            self.ahead_m.iter().map(|(&lane, &ahead_m)| begin(lane, ahead_m)).collect();
        let mut visited = BTreeSet::new();
        while let Some((distance, lane)) = open.pop_first() {
            if !visited.insert(lane) {
                continue;
            }
            let distance_m = f64::from_bits(distance);
            let Some(junction) = roads.begin_of(lane).filter(|junction| !lit.contains(junction)) else { continue };
            // Cars on these have just left the light.
            let leaves = |lane: LaneNo| roads.begin_of(lane).is_some_and(|begin| self.own.contains(&begin));
            let before = roads.links_to(lane).filter(|link| roads.carries_cars(link) && !link.turns_around());
            let before = before.filter(|link| roads.is_road(link.from) && may_see(link.from) && !leaves(link.from));
            let before = before.map(|link| (link.from, distance_m + roads.length_within_junction(link)));
            let before: Vec<_> = before.filter(|(_, ahead_m)| *ahead_m < self.approach_m).collect();
            let known = self.passed.contains(&junction);
            if before.is_empty() || (!known && self.own.len() + self.passed.len() >= MOST_JUNCTIONS) {
                continue;
            }
            if !known {
                self.passed.push(junction);
            }
            for (lane, ahead_m) in before {
                let known = self.ahead_m.entry(lane).or_insert(f64::INFINITY);
                if ahead_m < *known {
                    *known = ahead_m;
                    open.insert(begin(lane, ahead_m));
                }
            }
        }
    }

    /// Returns all roads that begin or end at a junction of the region, in the order of the file.
    pub fn edges(&self, roads: &Roads) -> BTreeSet<EdgeNo> {
        let within = |junction: &JunctionNo| self.own.contains(junction) || self.passed.contains(junction);
        let touching = roads.roads().filter(|(_, edge)| edge.ends.iter().flatten().any(within));
        touching.map(|(number, _)| number).collect()
    }

    pub(crate) fn place_m(&self, roads: &Roads) -> Place {
        let places = self.own.iter().map(|&junction| roads.junction(junction).place_m);
        let [x, y] = places.fold([0.0; 2], |sum, place| [sum[0] + place[0], sum[1] + place[1]]);
        [x, y].map(|sum| sum / self.own.len() as f64)
    }
}

fn edges(roads: &Roads, light: &str, names: &[String]) -> Result<BTreeSet<EdgeNo>> {
    let edge = |name: &String| {
        let road = roads.edge_named(name).filter(|&edge| roads.edge(edge).ends.is_some());
        road.with_context(|| format!("agents.toml: light `{light}`: approaches: the net has no road `{name}`"))
    };
    names.iter().map(edge).collect()
}

pub(crate) fn lit_junctions(roads: &Roads) -> BTreeSet<JunctionNo> {
    let links = roads.connections.iter().filter(|link| link.signal.is_some() && roads.carries_cars(link));
    links.filter_map(|link| roads.end_of(link.from)).collect()
}
