//! The lanes of a region as its agent and its controllers know them: approaches, exits and links. And what the agent
//! sees of them.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use anyhow::Result;

use super::Rules;
use super::region::Region;
use crate::agents::loops::Loop;
use crate::agents::region::CELL_M;
use crate::agents::region_plan::{Approach, Exit, Link, RegionPlan};
use crate::agents::sensor::{CarColumns, LightColumns, Sensor};
use crate::config::{DSet, Observation};
use crate::lane_sets::LaneSets;
use crate::network::roads::{Connection, EdgeNo, LaneNo, Roads};

/// Approaches: first the edges at the stop line in the order of the light's letters, then the others by distance; the
/// lanes of an edge from the right to the left. Links are in the order of the letters, exits in that of the links.
///
/// `minds_trapped`: whether masks mind the cars that are trapped within the junctions. An error is one of [`Roads::crossing_letters`].
pub(crate) fn region_plan(roads: &Roads, light: &str, region: &Region, minds_trapped: bool) -> Result<RegionPlan> {
    let mut ways: Vec<(usize, &Connection)> = roads
        .under_light(light)
        .filter(|link| region.ahead_m.contains_key(&link.from))
        .map(|link| (link.signal.as_ref().expect("a light controls it").letter, link))
        .collect();
    ways.sort_by_key(|(letter, link)| (*letter, link.from, link.to));
    let order = lanes_in_order(roads, region, &ways);
    let mut leaving: Vec<LaneNo> = Vec::new();
    for (_, link) in &ways {
        if !leaving.contains(&link.to) {
            leaving.push(link.to);
        }
    }
    let places = |lanes: &[LaneNo]| lanes.iter().enumerate().map(|(place, &lane)| (lane, place)).collect();
    let [approach_of, exit_of]: [HashMap<LaneNo, usize>; 2] = [places(&order), places(&leaving)];
    let crossing = if minds_trapped { roads.crossing_letters(light)? } else { BTreeSet::new() };
    let links: Vec<Link> = ways
        .iter()
        .map(|&(letter, link)| {
            let across = |other: usize| crossing.contains(&[letter.min(other), letter.max(other)]);
            let inside = roads.lanes_within_junction(link).filter(|_| minds_trapped);
            Link {
                letter,
                from: approach_of[&link.from],
                to: exit_of[&link.to],
                inside: inside.map(|lane| roads.lane(lane).id.clone()).collect(),
                crosses: (0..ways.len()).filter(|&other| across(ways[other].0)).collect(),
            }
        })
        .collect();
    let reached = links_reached(roads, &order, &approach_of, &links);
    let approaches = order.iter().zip(reached).map(|(&lane, links)| {
        let ahead_m = region.ahead_m[&lane];
        let lane = roads.lane(lane);
        let (length_m, speed_limit_mps) = (lane.length_m, lane.speed_limit_mps);
        Approach { lane: lane.id.clone(), length_m, speed_limit_mps, ahead_m, links: links.into_iter().collect() }
    });
    let exits = leaving.iter().map(|&lane| {
        let leaves_the_net = leaves_the_net(roads, light, roads.lane(lane).edge);
        let lane = roads.lane(lane);
        Exit { lane: lane.id.clone(), length_m: lane.length_m, speed_limit_mps: lane.speed_limit_mps, leaves_the_net }
    });
    Ok(RegionPlan { approaches: approaches.collect(), exits: exits.collect(), links })
}

fn lanes_in_order(roads: &Roads, region: &Region, ways: &[(usize, &Connection)]) -> Vec<LaneNo> {
    let mut found: BTreeMap<EdgeNo, (usize, f64)> = BTreeMap::new();
    for (&lane, &ahead_m) in &region.ahead_m {
        let (_, nearest_m) = found.entry(roads.lane(lane).edge).or_insert((usize::MAX, ahead_m));
        *nearest_m = nearest_m.min(ahead_m);
    }
    for (letter, link) in ways {
        let (first, _) = found.get_mut(&roads.lane(link.from).edge).expect("links begin at lanes of the region");
        *first = (*first).min(*letter);
    }
    let mut edges: Vec<(usize, f64, EdgeNo)> =
        found.into_iter().map(|(edge, (letter, nearest_m))| (letter, nearest_m, edge)).collect();
    edges.sort_by(|one, other| (one.0.cmp(&other.0)).then(one.1.total_cmp(&other.1)).then(one.2.cmp(&other.2)));
    let lanes = edges.iter().flat_map(|(_, _, edge)| &roads.edge(*edge).lanes).copied();
    lanes.filter(|lane| region.ahead_m.contains_key(lane)).collect()
}

/// Returns the links that cars on each lane can come to without changing lanes.
fn links_reached(
    roads: &Roads,
    lanes: &[LaneNo],
    places: &HashMap<LaneNo, usize>,
    links: &[Link],
) -> Vec<BTreeSet<usize>> {
    let mut reached = vec![BTreeSet::new(); lanes.len()];
    for (number, link) in links.iter().enumerate() {
        reached[link.from].insert(number);
    }
    // Links pass back from lane to lane until nothing changes, because there may be rings.
    loop {
        let before = reached.clone();
        for (place, &lane) in lanes.iter().enumerate() {
            let next = roads.links_from(lane).filter(|way| way.signal.is_none() && !way.turns_around());
            for next in next.filter_map(|way| places.get(&way.to)) {
                let more = reached[*next].clone();
                reached[place].extend(more);
            }
        }
        if reached == before {
            return reached;
        }
    }
}

/// Returns whether cars on an edge leave the net without coming to another light, or at once to another junction of this one. They
/// do not turn around.
fn leaves_the_net(roads: &Roads, light: &str, exit: EdgeNo) -> bool {
    let mut seen = BTreeSet::from([exit]);
    let mut open = vec![exit];
    while let Some(edge) = open.pop() {
        let ways = roads.edge(edge).lanes.iter().flat_map(|&lane| roads.links_from(lane));
        for way in ways.filter(|way| roads.carries_cars(way) && !way.turns_around()) {
            match &way.signal {
                Some(signal) if signal.light != light || edge == exit => return false,
                Some(_) => {}
                None => {
                    let next = roads.lane(way.to).edge;
                    if seen.insert(next) {
                        open.push(next);
                    }
                }
            }
        }
    }
    true
}

/// Makes the sensor of an agent: cars up to `approach_m` before the stop line, and a light with this number of greens.
pub(super) fn sensor(region: &RegionPlan, rules: &Rules, greens: usize) -> Sensor {
    let cells = region.approaches.iter().map(|approach| {
        let seen_m = approach.length_m.min(rules.approach_m - approach.ahead_m);
        (seen_m / CELL_M).ceil() as usize
    });
    let cars = match rules.cars {
        Observation::Cells | Observation::CellsAndBuses => CarColumns::Cells(cells.collect()),
        Observation::Queues => CarColumns::QueueAndDensity(region.approaches.len()),
        Observation::Detectors => CarColumns::Detectors(Loop::of(&region.approaches)),
        Observation::Lanes => CarColumns::Sets(LaneSets::new(region.approaches.len(), greens, rules.approach_m)),
    };
    let light = match rules.cars {
        Observation::Lanes => LightColumns::WithLanes,
        _ => LightColumns::TargetAndAge(greens),
    };
    Sensor {
        cars,
        light,
        clock: 0,
        clock_ahead: 0,
        sees_others: rules.cars == Observation::CellsAndBuses,
        d_set: DSet::Cells,
    }
}
