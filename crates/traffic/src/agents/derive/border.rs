//! The border of a light's region: its lanes, entries and exits.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::region::Region;
use crate::agents::border_plan::{BorderLane, BorderPlan, BorderRoad, Entry, EntryPlace};
use crate::config::ScenarioConfig;
use crate::network::roads::{EdgeNo, JunctionNo, LaneNo, Roads, Signal};
use dials_core::domain::DomainTable;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seconds {
    pub decision: usize,
    pub episode: usize,
}

impl Seconds {
    pub fn of(config: &ScenarioConfig) -> Seconds {
        let decision = config.decision_s as usize;
        Seconds { decision, episode: config.horizon() * decision }
    }
}

/// Largest distance behind the border at which a car is first seen, in metres. SUMO moved others there.
const FIRST_SEEN_M: f64 = 60.0;

/// Largest number of roads of a way of which nothing is known.
const MOST_ROADS: usize = 32;

/// Makes the border of a region. `departs_on`: roads on which cars depart; others may be among them.
pub(crate) fn border(roads: &Roads, region: &Region, departs_on: &BTreeSet<EdgeNo>, decision_s: usize) -> BorderPlan {
    let edges = region.edges(roads);
    let within = |junction: JunctionNo| region.own.contains(&junction) || region.passed.contains(&junction);
    let order = lanes(roads, &edges, within);
    let places: HashMap<LaneNo, usize> = order.iter().enumerate().map(|(place, &lane)| (lane, place)).collect();
    let of_roads = || order.iter().copied().filter(|&lane| roads.is_road(lane));
    let begins_outside = |lane: LaneNo| roads.begin_of(lane).is_some_and(|begin| !within(begin));
    let ends_outside = |lane: LaneNo| roads.end_of(lane).is_some_and(|end| !within(end));
    let is_reached = |lane: LaneNo| roads.links_to(lane).any(|link| roads.carries_cars(link));
    let leads_on = |lane: LaneNo| roads.links_from(lane).any(|link| roads.carries_cars(link));
    let entry_lanes: Vec<LaneNo> = of_roads().filter(|&lane| begins_outside(lane) && is_reached(lane)).collect();
    // Nobody sees a car depart where there are no lanes for cars, such as on a cycle track.
    let has_cars = |edge: &EdgeNo| roads.edge(*edge).lanes.iter().any(|&lane| roads.lane(lane).carries_cars);
    let departures: Vec<EdgeNo> = edges.intersection(departs_on).copied().filter(has_cars).collect();
    let entry_of = entries_passed(roads, &places, &entry_lanes);
    let border_lane = |&lane: &LaneNo| {
        let edge = roads.lane(lane).edge;
        let departures = departures.iter().position(|&other| other == edge);
        BorderLane {
            lane: roads.lane(lane).id.clone(),
            road: edges.iter().position(|&other| other == edge),
            length_m: roads.lane(lane).length_m,
            classes: roads.lane(lane).classes.clone(),
            entry: entry_of.get(&lane).copied(),
            departures: departures.map(|number| entry_lanes.len() + number),
        }
    };
    let border_road = |edge: EdgeNo| {
        let edge = roads.edge(edge);
        let [begins_outside, ends_outside] = edge.ends.expect("roads have ends").map(|end| !within(end));
        BorderRoad { road: edge.id.clone(), begins_outside, ends_outside }
    };
    let at_lanes = entry_lanes.iter().map(|&lane| Entry {
        place: EntryPlace::Lane(places[&lane]),
        default_way: default_way(roads, ends_outside, lane),
    });
    let on_roads = departures.iter().map(|&edge| {
        let lanes = &roads.edge(edge).lanes;
        let first = lanes.iter().copied().find(|&lane| roads.lane(lane).carries_cars && leads_on(lane));
        Entry {
            place: EntryPlace::Road(roads.edge(edge).id.clone()),
            default_way: default_way(roads, ends_outside, first.unwrap_or(lanes[0])),
        }
    });
    let exits: Vec<LaneNo> = of_roads().filter(|&lane| ends_outside(lane) && leads_on(lane)).collect();
    let signals = |&lane: &LaneNo| -> Vec<Signal> {
        let ways = roads.links_from(lane).filter(|link| roads.carries_cars(link));
        let signals: Option<Vec<Signal>> = ways.map(|link| link.signal.clone()).collect();
        signals.unwrap_or_default()
    };
    BorderPlan {
        roads: edges.iter().map(|&edge| border_road(edge)).collect(),
        entries: at_lanes.chain(on_roads).collect(),
        exit_signals: exits.iter().map(signals).collect(),
        exits: exits.iter().map(|lane| places[lane]).collect(),
        lanes: order.iter().map(border_lane).collect(),
        decision_s,
    }
}

fn lanes(roads: &Roads, edges: &BTreeSet<EdgeNo>, within: impl Fn(JunctionNo) -> bool) -> Vec<LaneNo> {
    let of_roads: BTreeSet<LaneNo> = edges
        .iter()
        .flat_map(|&edge| &roads.edge(edge).lanes)
        .copied()
        .filter(|&lane| roads.lane(lane).carries_cars)
        .collect();
    let mut inside: BTreeSet<LaneNo> = BTreeSet::new();
    let ends_within = |lane: &&LaneNo| roads.end_of(**lane).is_some_and(&within);
    let mut open: Vec<LaneNo> = of_roads.iter().filter(ends_within).copied().collect();
    while let Some(lane) = open.pop() {
        let next = roads.links_from(lane).filter_map(|link| link.via);
        open.extend(next.filter(|&via| inside.insert(via)).collect::<Vec<_>>());
    }
    of_roads.into_iter().chain(inside).collect()
}

/// Returns the nearest entry to each lane: a car first seen there has passed it. `places`: all lanes.
fn entries_passed(roads: &Roads, places: &HashMap<LaneNo, usize>, entry_lanes: &[LaneNo]) -> BTreeMap<LaneNo, usize> {
    let mut entry_of: BTreeMap<LaneNo, usize> = BTreeMap::new();
    // Distances from the border to the beginning of a lane are not negative, so their bits are in the same order.
    let mut open: BTreeSet<(u64, usize, LaneNo)> = BTreeSet::new();
    for (entry, &lane) in entry_lanes.iter().enumerate() {
        entry_of.insert(lane, entry);
        open.insert((0.0_f64.to_bits(), entry, lane));
    }
    let mut visited = BTreeSet::new();
    while let Some((distance, entry, lane)) = open.pop_first() {
        if !visited.insert(lane) {
            continue;
        }
        entry_of.entry(lane).or_insert(entry);
        let entry = entry_of[&lane];
        let beside = roads.edge(roads.lane(lane).edge).lanes.iter().map(|&lane| (distance, lane));
        let end_m = f64::from_bits(distance) + roads.lane(lane).length_m;
        let ahead = roads.links_from(lane).map(|link| (end_m.to_bits(), link.via.unwrap_or(link.to)));
        let ahead = ahead.filter(|_| end_m <= FIRST_SEEN_M);
        open.extend(
            beside.chain(ahead).filter(|(_, lane)| places.contains_key(lane)).map(|(at, lane)| (at, entry, lane)),
        );
    }
    entry_of
}

/// Returns the roads from a lane on along the first connections, to the first road behind the region.
fn default_way(roads: &Roads, ends_outside: impl Fn(LaneNo) -> bool, lane: LaneNo) -> Vec<String> {
    let mut way = vec![lane];
    let mut is_over = false;
    while !is_over && way.len() < MOST_ROADS {
        let lane = *way.last().expect("it begins with a lane");
        let links = || roads.links_from(lane).filter(|link| roads.carries_cars(link));
        let Some(link) = links().find(|link| !link.turns_around()).or_else(|| links().next()) else { break };
        is_over = ends_outside(lane);
        way.push(link.to);
    }
    way.into_iter().map(|lane| roads.edge(roads.lane(lane).edge).id.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::derive::overrides::Overrides;
    use crate::agents::derive::{Rules, derive};
    use crate::network::roads::example::{LIGHT_AT_U, roads};

    fn plan(changes: &[(&str, &str)], light: &str, departs_on: &[&str]) -> BorderPlan {
        let roads = roads(changes);
        let derived = derive(&roads, &Rules::default(), &Overrides::default()).unwrap();
        let agent = derived.agents.into_iter().find(|agent| agent.plan.light == light).unwrap();
        let departs_on = departs_on.iter().map(|road| roads.edge_named(road).unwrap()).collect();
        border(&roads, &agent.region, &departs_on, 2)
    }

    fn names(plan: &BorderPlan, lanes: impl IntoIterator<Item = usize>) -> Vec<&str> {
        lanes.into_iter().map(|lane| plan.lanes[lane].lane.as_str()).collect()
    }

    #[test]
    fn nobody_is_seen_to_depart_on_a_road_without_lanes_for_cars() {
        const LANE: &str = r#"<lane id="side_1" index="1""#;
        let track = [(LANE, &*format!("{LANE} allow=\"bicycle\""))];
        let places = |changes: &[(&str, &str)]| -> Vec<EntryPlace> {
            plan(changes, "J", &["far", "side"]).entries.into_iter().map(|entry| entry.place).collect()
        };
        let on = |road: &str| EntryPlace::Road(road.to_owned());
        assert_eq!(places(&[]), [on("far"), on("side")]);
        assert_eq!(places(&track), [on("far")]);
    }

    #[test]
    fn roads_of_a_region_may_meet_outside_of_it() {
        // From `back` cars turn around at U to `near`, and U is another light.
        let plan = plan(&LIGHT_AT_U, "J", &[]);
        let lane = |name: &str| plan.lanes.iter().position(|lane| lane.lane == name).unwrap();
        let is_over = |from: &str, to: &str| plan.is_over_the_border(lane(from), lane(to));
        assert!(is_over("back_0", "near_1") && !is_over("near_0", "near_1") && !is_over("near_0", "out_0"));
    }

    #[test]
    fn another_light_is_outside() {
        let plan = plan(&LIGHT_AT_U, "J", &["far"]);
        let roads: Vec<&str> = plan.roads.iter().map(|road| road.road.as_str()).collect();
        assert_eq!(roads, ["near", "north", "out", "back"]);
        let places: Vec<&EntryPlace> = plan.entries.iter().map(|entry| &entry.place).collect();
        assert_eq!(places, [&EntryPlace::Lane(0), &EntryPlace::Lane(1)]);
        assert_eq!(names(&plan, [0, 1]), ["near_0", "near_1"]);
        assert_eq!(names(&plan, plan.exits.iter().copied()), ["back_0"]);
        let way = &plan.entries[1].default_way;
        assert_eq!(way, &["near", "back", "west"], "the first connection behind the region, too");
        assert_eq!((plan.sources(), plan.arrival(1, 0), plan.blocked(0, 0)), (5, 2, 4));
        assert_eq!(plan.source_names()[3..], ["arrival near_1[1]", "blocked back_0[0]"]);
    }

    #[test]
    fn a_car_that_crosses_a_short_entry_within_a_second_has_come_by_it() {
        const NEAR_1: &str = r#"id="near_1" index="1" speed="13.9" length="50""#;
        let short = NEAR_1.replace("50", "5");
        let plan = plan(&[&LIGHT_AT_U[..], &[(NEAR_1, &short)]].concat(), "J", &[]);
        let entry = |lane: &str| plan.lanes.iter().find(|other| other.lane == lane).unwrap().entry;
        assert_eq!(["near_0", "near_1", "back_0", "out_0"].map(entry), [Some(0), Some(1), Some(1), Some(0)]);
        assert_eq!(entry("north_0"), None, "nobody comes to it from the border");
    }
}
