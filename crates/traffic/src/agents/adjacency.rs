//! Which light feeds which: the shortest ways from the exits of each light to the stop lines of the next ones.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::plan::AgentPlan;
use crate::network::roads::{LaneNo, Roads};
use dials_core::domain::roads::Adjacent;

/// What lies around the lights.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Adjacency {
    /// Ordered by the light that feeds, then by the one that is fed.
    pub(crate) ways: Vec<Adjacent>,
    /// The nearest light that feeds each approach of each agent, if there is one, and the nearest one that each exit feeds.
    pub(crate) feeders: Vec<Vec<Option<usize>>>,
    pub(crate) fed: Vec<Vec<Option<usize>>>,
}

/// A place on the way from an exit: metres and seconds from the beginning of the exit to the beginning of a lane.
type Way = (f64, f64);

impl Adjacency {
    pub(crate) fn of(roads: &Roads, agents: &[AgentPlan]) -> Adjacency {
        let lights: HashMap<&str, usize> =
            agents.iter().enumerate().map(|(number, agent)| (&*agent.light, number)).collect();
        // A lane may end at the stop lines of several lights only in broken nets.
        let stops_at = |lane: LaneNo| {
            let signals = roads.links_from(lane).filter_map(|link| link.signal.as_ref());
            signals.filter_map(|signal| lights.get(&*signal.light).copied()).next()
        };
        let mut ways: BTreeMap<(usize, usize), Way> = BTreeMap::new();
        // Lights that feed a lane, with their distances.
        let mut reached: HashMap<LaneNo, Vec<(f64, usize)>> = HashMap::new();
        let mut fed = Vec::with_capacity(agents.len());
        for (from, agent) in agents.iter().enumerate() {
            let exits = agent.region.exits.iter().map(|exit| {
                let begin = roads.lane_named(&exit.lane)?;
                let mut nearest: Option<(f64, usize)> = None;
                for (lane, (metres, seconds)) in downstream(roads, begin, &stops_at) {
                    reached.entry(lane).or_default().push((metres, from));
                    let Some(to) = stops_at(lane).filter(|&to| to != from) else { continue };
                    let (length_m, limit_mps) = (roads.lane(lane).length_m, roads.lane(lane).speed_limit_mps);
                    let way = (metres + length_m, seconds + length_m / limit_mps);
                    let known = ways.entry((from, to)).or_insert(way);
                    if way.0 < known.0 {
                        *known = way;
                    }
                    if nearest.is_none_or(|(known, _)| way.0 < known) {
                        nearest = Some((way.0, to));
                    }
                }
                nearest.map(|(_, to)| to)
            });
            fed.push(exits.collect());
        }
        let feeder = |lane: &str, own: usize| {
            let of_lane = reached.get(&roads.lane_named(lane)?)?;
            let others = of_lane.iter().filter(|(_, from)| *from != own);
            others.min_by(|one, other| one.0.total_cmp(&other.0)).map(|&(_, from)| from)
        };
        let feeders = agents.iter().enumerate().map(|(number, agent)| {
            agent.region.approaches.iter().map(|approach| feeder(&approach.lane, number)).collect()
        });
        let ways = ways.into_iter().map(|((from, to), (metres, seconds))| Adjacent { from, to, metres, seconds });
        Adjacency { ways: ways.collect(), feeders: feeders.collect(), fed }
    }
}

/// Returns the lanes behind `begin`, itself first, until the next light, each with the shortest way to its beginning.
fn downstream(roads: &Roads, begin: LaneNo, stops_at: &impl Fn(LaneNo) -> Option<usize>) -> Vec<(LaneNo, Way)> {
    // Distances are not negative, so their bits are in the same order.
    let mut open = BTreeSet::from([(0.0_f64.to_bits(), begin)]);
    let mut ways: HashMap<LaneNo, Way> = HashMap::from([(begin, (0.0, 0.0))]);
    let mut visited = Vec::new();
    let mut done = BTreeSet::new();
    while let Some((_, lane)) = open.pop_first() {
        if !done.insert(lane) {
            continue;
        }
        let (metres, seconds) = ways[&lane];
        visited.push((lane, (metres, seconds)));
        if stops_at(lane).is_some() {
            continue;
        }
        let here = roads.lane(lane);
        for link in roads.links_from(lane).filter(|link| roads.carries_cars(link) && roads.is_road(link.to)) {
            let within: f64 = roads.length_within_junction(link);
            let next = (
                metres + here.length_m + within,
                seconds + here.length_m / here.speed_limit_mps + within / roads.lane(link.to).speed_limit_mps,
            );
            let known = ways.entry(link.to).or_insert((f64::INFINITY, 0.0));
            if next.0 < known.0 {
                *known = next;
                open.insert((next.0.to_bits(), link.to));
            }
        }
    }
    visited
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrafficConfig;
    use crate::network::contents::Network;
    use crate::network::files::NetworkFiles;
    use crate::network::way_out::Role;
    use crate::paper_grid::grid::Grid;
    use crate::paper_grid::plans::plans;
    use std::path::Path;

    #[test]
    fn on_the_grid_of_two_by_two_everyone_feeds_the_two_beside_and_is_100_m_from_them() {
        let config = TrafficConfig::new("", "");
        let agents = plans(Grid::new(2, 2).unwrap(), &config);
        let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../sumo_nets/grid_2x2");
        let roads = Network::read(&NetworkFiles::of(&nets), Role::Global).unwrap().roads().unwrap();
        let adjacency = Adjacency::of(&roads, &agents);
        let pairs: Vec<_> = adjacency.ways.iter().map(|way| (way.from, way.to)).collect();
        assert_eq!(pairs, [(0, 1), (0, 2), (1, 0), (1, 3), (2, 0), (2, 3), (3, 1), (3, 2)]);
        for way in &adjacency.ways {
            assert_eq!(way.metres, 100.0);
            assert!((way.seconds - 10.0).abs() < 1e-9, "100 m at 10 m/s");
        }
        // Each has two approaches from a neighbour, and two from the boundary.
        for feeders in &adjacency.feeders {
            assert_eq!(feeders.iter().flatten().count(), 2, "{feeders:?}");
        }
    }
}
