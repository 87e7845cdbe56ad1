//! Coordination: one cycle for all lights, and offsets with which cars that leave one light find the next one green.
//!
//! A stretch is a road from one light to the next. The stretches with the most cars come first. A stretch sets the offset
//! of two lights to each other if no heavier ones have done so already, as in a tree of the heaviest stretches. The green
//! at its end then begins when the first cars of the green at its beginning arrive, at the speed limit.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};

use anyhow::Result;

use crate::Traffic;
use crate::agents::plan::AgentPlan;
use crate::controllers::search::net;
use crate::controllers::webster::{FlowRatios, Flows, cycle_s};
use crate::controllers::{Timing, Webster, split};
use crate::network::roads::{EdgeNo, LaneNo, Roads};

/// Longest way from one light to the next that coordination looks at, in seconds at the speed limit. On a longer one cars
/// are no longer in a group.
const LONGEST_S: f64 = 90.0;

/// What offsets depend on, measured once.
pub(super) struct Coordination {
    flows: Flows,
    ratios: Vec<FlowRatios>,
    /// The heaviest first.
    stretches: Vec<Stretch>,
}

#[derive(Clone, Debug, PartialEq)]
struct Stretch {
    /// Lights, as indices.
    from: usize,
    to: usize,
    /// Exit and approaches, as indices into the lists of their lights.
    exit_lanes: BTreeSet<usize>,
    approaches: BTreeSet<usize>,
    travel_s: f64,
    cars: u32,
}

impl Coordination {
    /// Counts cars in episodes of their own.
    pub(super) fn measure(traffic: &Traffic) -> Result<Coordination> {
        let webster = Webster::default();
        let flows = webster.flows(traffic, usize::MAX)?.swap_remove(0);
        let ratios = webster.ratios_of(traffic.plans(), &flows);
        let stretches = stretches(&traffic.network.roads()?, traffic.plans(), &flows);
        Ok(Coordination { flows, ratios, stretches })
    }

    /// Returns Webster's greens in a common cycle: the longest one that a light needs.
    pub(super) fn timings(&self, plans: &[AgentPlan]) -> Vec<Timing> {
        let needed = self.ratios.iter().map(|ratios| cycle_s(ratios.sum(), ratios.lost_s));
        let cycle = needed.fold(0.0, f64::max).round() as u32;
        self.with_offsets(plans, net::of_cycle(plans, &self.ratios, cycle))
    }

    pub(super) fn with_offsets(&self, plans: &[AgentPlan], timings: Vec<Timing>) -> Vec<Timing> {
        // Trees of stretches: each joins two lights that were not joined.
        let mut tree_of: Vec<usize> = (0..plans.len()).collect();
        let mut beside: Vec<Vec<&Stretch>> = vec![Vec::new(); plans.len()];
        for stretch in &self.stretches {
            let [from, to] = [stretch.from, stretch.to].map(|light| tree_of[light]);
            if from != to {
                tree_of.iter_mut().filter(|tree| **tree == to).for_each(|tree| *tree = from);
                beside[stretch.from].push(stretch);
                beside[stretch.to].push(stretch);
            }
        }
        let mut begun: Vec<Option<f64>> = vec![None; plans.len()];
        for first in 0..plans.len() {
            if begun[first].is_some() {
                continue;
            }
            begun[first] = Some(0.0);
            let mut reached = VecDeque::from([first]);
            while let Some(light) = reached.pop_front() {
                let own = begun[light].expect("it was reached");
                for stretch in &beside[light] {
                    let lag = self.lag_s(plans, &timings, stretch);
                    let (other, offset) =
                        if stretch.from == light { (stretch.to, own + lag) } else { (stretch.from, own - lag) };
                    if begun[other].is_none() {
                        begun[other] = Some(offset);
                        reached.push_back(other);
                    }
                }
            }
        }
        let shift = |(timing, offset): (Timing, Option<f64>)| {
            let cycle = f64::from(timing.cycle());
            timing.shifted(offset.unwrap_or(0.0).round().rem_euclid(cycle) as u32)
        };
        timings.into_iter().zip(begun).map(shift).collect()
    }

    /// Returns by how much the light at the end of a stretch begins its cycle later than the one at its beginning.
    fn lag_s(&self, plans: &[AgentPlan], timings: &[Timing], stretch: &Stretch) -> f64 {
        let cars = |light: usize, approach: usize| f64::from(self.flows.cars.row(light)[approach]);
        let sends = |green: usize| -> f64 {
            let plan = &plans[stretch.from];
            let links = plan.region.links.iter().enumerate().filter(|(_, link)| stretch.exit_lanes.contains(&link.to));
            let open = links.filter(|&(link, _)| plan.opens(green, link));
            open.map(|(_, link)| cars(stretch.from, link.from) / plan.region.approaches[link.from].links.len() as f64)
                .sum()
        };
        let takes = |green: usize| -> f64 {
            let plan = &plans[stretch.to];
            stretch.approaches.iter().map(|&lane| plan.share(green, lane) * cars(stretch.to, lane)).sum()
        };
        let begin = |timing: &Timing, weight: &dyn Fn(usize) -> f64| {
            let mut greens = timing.order();
            let first = greens.next().expect("a light shows some green");
            let most = greens.fold(first, |best, green| if weight(green) > weight(best) { green } else { best });
            f64::from(timing.begin_of(most))
        };
        begin(&timings[stretch.from], &sends) + stretch.travel_s - begin(&timings[stretch.to], &takes)
    }
}

/// Returns the same shares of green in a common cycle. A light whose least greens do not fit has a longer one.
pub(super) fn of_common_cycle(plans: &[AgentPlan], timings: &[Timing], cycle: u32) -> Vec<Timing> {
    let in_cycle = |(plan, timing): (&AgentPlan, &Timing)| {
        let least = plan.phases.min_green_steps();
        let green: u32 = timing.greens().iter().sum();
        let shortest: u32 = timing.order().map(|green| least[green]).sum();
        let steps = cycle.saturating_sub(timing.cycle() - green).max(shortest);
        let weights: Vec<f64> = timing.greens().iter().map(|&green| f64::from(green)).collect();
        let greens = split(steps, &weights, least).expect("there are steps for the least greens");
        timing.with_lengths(&plan.phases, &plan.phases.fitted(&greens))
    };
    plans.iter().zip(timings).map(in_cycle).collect()
}

/// Returns the stretches between lights, those with the most cars first.
fn stretches(roads: &Roads, plans: &[AgentPlan], flows: &Flows) -> Vec<Stretch> {
    let edge_of = |lane: &str| roads.lane_named(lane).map(|lane| roads.lane(lane).edge);
    let mut exits: HashMap<EdgeNo, (usize, BTreeSet<usize>)> = HashMap::new();
    for (light, plan) in plans.iter().enumerate() {
        for (number, exit) in plan.region.exits.iter().enumerate() {
            let Some(edge) = edge_of(&exit.lane) else { continue };
            exits.entry(edge).or_insert_with(|| (light, BTreeSet::new())).1.insert(number);
        }
    }
    let mut found = Vec::new();
    for (to, plan) in plans.iter().enumerate() {
        let mut roads_to: BTreeMap<EdgeNo, BTreeSet<usize>> = BTreeMap::new();
        for (number, approach) in plan.region.approaches.iter().enumerate().filter(|(_, lane)| lane.ahead_m == 0.0) {
            let Some(edge) = edge_of(&approach.lane) else { continue };
            roads_to.entry(edge).or_default().insert(number);
        }
        for (edge, approaches) in roads_to {
            let Some((begin, travel_s)) = upstream(roads, edge, |edge| exits.contains_key(&edge)) else { continue };
            let (from, exit_lanes) = exits[&begin].clone();
            let cars = approaches.iter().map(|&approach| flows.cars.row(to)[approach]).sum();
            if from != to {
                found.push(Stretch { from, to, exit_lanes, approaches, travel_s, cars });
            }
        }
    }
    found.sort_by_key(|stretch| (std::cmp::Reverse(stretch.cars), stretch.from, stretch.to));
    found
}

/// Returns the nearest edge before the end of this one, or itself, that leaves a light, with the seconds from there.
fn upstream(roads: &Roads, edge: EdgeNo, leaves_a_light: impl Fn(EdgeNo) -> bool) -> Option<(EdgeNo, f64)> {
    let seconds = |edge: EdgeNo| -> f64 {
        let lanes = roads.edge(edge).lanes.iter().filter(|&&lane| roads.lane(lane).carries_cars);
        let of_lane = |&lane: &LaneNo| roads.lane(lane).length_m / roads.lane(lane).speed_limit_mps.max(0.1);
        lanes.map(of_lane).fold(0.0, f64::max)
    };
    let mut open = vec![(edge, seconds(edge))];
    let mut seen = BTreeSet::new();
    while let Some(nearest) = (0..open.len()).min_by(|&one, &other| open[one].1.total_cmp(&open[other].1)) {
        let (edge, travel_s) = open.swap_remove(nearest);
        if travel_s > LONGEST_S || !seen.insert(edge) {
            continue;
        }
        if leaves_a_light(edge) {
            return Some((edge, travel_s));
        }
        for link in roads.edge(edge).lanes.iter().flat_map(|&lane| roads.links_to(lane)) {
            // Arrivals behind a light without an agent are not predictable.
            if link.signal.is_none() && roads.is_road(link.from) {
                let before = roads.lane(link.from).edge;
                open.push((before, travel_s + seconds(before)));
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::crossing;
    use crate::network::roads::example;
    use dials_core::base::Ragged;

    /// Two lights. Cars leave the first one to the east and come to the second one from the west, 12 s later.
    fn coordination(cars: u32) -> (Vec<AgentPlan>, Coordination) {
        let stretch = |from, to, travel_s, cars| Stretch {
            from,
            to,
            exit_lanes: [0].into(),
            approaches: [0].into(),
            travel_s,
            cars,
        };
        let plans = vec![crossing(), crossing()];
        let flows = Flows { cars: Ragged::from_vec(vec![9; 10], [5, 5]).unwrap(), seconds: 900 };
        (
            plans,
            Coordination {
                flows,
                ratios: Vec::new(),
                stretches: vec![stretch(0, 1, 12.0, cars), stretch(1, 0, 30.0, 1)],
            },
        )
    }

    #[test]
    fn the_next_light_turns_green_when_the_cars_arrive() {
        let (plans, coordination) = coordination(50);
        // Green 0 is for the cars to the east at both. At the second light it comes last: 4 + 20 + 4 s after the cycle began.
        let timings = [[0, 1], [1, 0]].map(|order| Timing::in_order(&plans[0].phases, &[30, 20, 0, 0], &order, 0));
        let found = coordination.with_offsets(&plans, timings.to_vec());
        assert_eq!(found[1].begin_of(0), 24);
        // 12 s after the first one, so the cycle begins 12 s before it: 12 - 24 + 58.
        assert_eq!(found.iter().map(Timing::offset).collect::<Vec<_>>(), [0, 46]);
    }

    #[test]
    fn a_common_cycle_keeps_the_shares_and_the_least_greens() {
        let plans = [crossing(), crossing()];
        let timing = |greens: [u32; 4]| Timing::new(&plans[0].phases, &greens, 3);
        let found = of_common_cycle(&plans, &[timing([30, 10, 0, 0]), timing([10; 4])], 28);
        // 20 steps of green: 15 and 5. Four greens of 5 steps need 36 s.
        assert_eq!(found, [timing([15, 5, 0, 0]), timing([5; 4])]);
        assert_eq!(found.iter().map(Timing::cycle).collect::<Vec<_>>(), [28, 36]);
    }

    #[test]
    fn stretches_are_found_through_junctions_without_lights() {
        let roads = example::roads(&[]);
        let [far, near, side] = ["far", "near", "side"].map(|edge| roads.edge_named(edge).unwrap());
        // 50 m and 240 m at 13.9 m/s. The side road also leads to `near`.
        let (begin, travel_s) = upstream(&roads, near, |edge| edge == far).unwrap();
        assert_eq!((begin, (travel_s * 13.9).round()), (far, 290.0));
        assert_eq!(upstream(&roads, near, |edge| [far, side].contains(&edge)).unwrap().0, side, "it is nearer");
        assert_eq!(upstream(&roads, near, |_| false), None);
    }
}
