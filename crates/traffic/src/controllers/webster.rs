//! Webster's fixed time: cycle and greens from measured flows, for each intersection.
//!
//! Source: Webster, "Traffic signal settings", Road Research Technical Paper 39, 1958. The flow ratio `y` of a green is
//! the flow of its busiest approach over the saturation flow. `Y` is the sum of the flow ratios, and `L` the lost time
//! of a cycle, in which no green is shown. The delay is least near the cycle `C = (1.5 L + 5) / (1 - Y)`. Of it, each
//! green gets `(C - L) y / Y`.
//!
//! Greens overlap: a lane may have green in several. So some greens can be left out, and a lane shares its flow among
//! those that serve it.

use std::cell::RefCell;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::rc::Rc;

use anyhow::Result;

use super::arguments::{self, Arguments};
use super::clock::{ClockLights, ClockPlan, Timing};
use super::max_pressure;
use super::responsive::GreenLimits;
use super::{Each, HandCoded, Intersection, Intersections, LightController, are_of_a_grid};
use crate::Traffic;
use crate::agents::derive::greens::goes;
use crate::agents::plan::AgentPlan;
use crate::agents::region_plan::Approach;
use dials_core::base::{AgentId, Ragged, RandomPurpose, Seed};
use dials_core::domain::GlobalSimulator;
use libsumo::CarId;

/// Cars per hour that pass the stop line from a standing queue of the vehicle type of the paper's grids: one in 2.28 s.
const SATURATION_PER_H: f64 = 1580.0;
const EPISODES: u32 = 5;

pub(crate) struct Webster {
    episodes: u32,
    saturation_per_h: f64,
}

impl Default for Webster {
    fn default() -> Self {
        Webster { episodes: EPISODES, saturation_per_h: SATURATION_PER_H }
    }
}

impl Webster {
    pub(super) fn of(arguments: &mut Arguments<'_>) -> Result<Webster> {
        let what = "a number of cars per hour, above 0";
        let saturation = arguments.number("saturation", what, |&flow: &f64| flow > 0.0 && flow.is_finite())?;
        let episodes = arguments.number("episodes", "a whole number, at least 1", |&episodes: &u32| episodes >= 1)?;
        Ok(Webster { episodes: episodes.unwrap_or(EPISODES), saturation_per_h: saturation.unwrap_or(SATURATION_PER_H) })
    }

    /// Measures the flows on the GS, on separate episodes, and computes the timings.
    pub(super) fn timings(&self, traffic: &Traffic) -> Result<Vec<Timing>> {
        let ratios = self.ratios(traffic)?;
        Ok(traffic.plans().iter().zip(&ratios).map(|(plan, ratios)| timing(plan, ratios)).collect())
    }

    pub(crate) fn ratios(&self, traffic: &Traffic) -> Result<Vec<FlowRatios>> {
        let flows = self.flows(traffic, usize::MAX)?;
        Ok(self.ratios_of(traffic.plans(), &flows[0]))
    }

    /// Measures the flows on the GS, on separate episodes: those of each slice of this number of seconds. The last one may
    /// be shorter.
    pub(crate) fn flows(&self, traffic: &Traffic, slice_s: usize) -> Result<Vec<Flows>> {
        let plans = traffic.plans();
        if are_of_a_grid(plans) {
            let timings = arguments::usual(plans);
            measure(traffic, self.episodes, slice_s, ClockLights::new(ClockPlan::fixed(timings)))
        } else {
            // Lights that jam would hide what wants to pass.
            let limits = GreenLimits::usual(plans);
            let by = Each(move |at: &Intersection<'_>| max_pressure::decide(at, limits));
            measure(traffic, self.episodes, slice_s, by)
        }
    }

    pub(crate) fn ratios_of(&self, plans: &[AgentPlan], flows: &Flows) -> Vec<FlowRatios> {
        let of_light = |(plan, ratios): (&AgentPlan, Vec<f64>)| flow_ratios(plan, &ratios);
        plans.iter().zip(self.of_approaches(flows)).map(of_light).collect()
    }

    /// Returns the ratios of lights that show the same greens as in `known`, with other flows.
    pub(crate) fn ratios_like(&self, plans: &[AgentPlan], known: &[FlowRatios], flows: &Flows) -> Vec<FlowRatios> {
        let lights = plans.iter().zip(known).zip(self.of_approaches(flows));
        let of_light = |((plan, known), ratios): ((&AgentPlan, &FlowRatios), Vec<f64>)| {
            let greens: Vec<usize> = known.greens.iter().map(|&(green, _)| green).collect();
            of_choice(plan, &ratios, &greens)
        };
        lights.map(of_light).collect()
    }

    /// Returns flow over saturation flow of the approaches of each light.
    fn of_approaches(&self, Flows { cars, seconds }: &Flows) -> impl Iterator<Item = Vec<f64>> {
        let saturation = self.saturation_per_h / 3600.0 * f64::from(*seconds);
        cars.iter().map(move |cars| cars.iter().map(|&cars| f64::from(cars) / saturation).collect())
    }
}

/// Returns Webster's cycle in seconds for a sum of flow ratios and the lost time of a cycle, at most the longest one.
pub(crate) fn cycle_s(sum: f64, lost_s: f64) -> f64 {
    if sum < 1.0 { ((1.5 * lost_s + 5.0) / (1.0 - sum)).min(LONGEST_CYCLE_S) } else { LONGEST_CYCLE_S }
}

pub(crate) fn timing(plan: &AgentPlan, ratios: &FlowRatios) -> Timing {
    let (sum, lost_s) = (ratios.sum(), ratios.lost_s);
    let green_s = (cycle_s(sum, lost_s) - lost_s).max(0.0);
    let mut greens = vec![0; plan.greens()];
    // The last share is what is left, so that the shares sum up to 1.
    let mut left = 1.0;
    for (place, &(green, ratio)) in ratios.greens.iter().enumerate() {
        // Without cars, the greens have equal shares.
        let share = if sum > 0.0 { ratio / sum } else { 1.0 / ratios.greens.len() as f64 };
        let share = if place + 1 == ratios.greens.len() { left } else { share };
        greens[green] = ((green_s * share).round() as u32).max(plan.phases.min_green_steps()[green]);
        left -= share;
    }
    Timing::new(&plan.phases, &plan.phases.fitted(&greens), 0)
}

/// Longest cycle. Near saturation, Webster's formula goes to infinity.
const LONGEST_CYCLE_S: f64 = 120.0;
const FEW_GREENS: usize = 12;

/// Flow over saturation flow of the greens that a light should show.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FlowRatios {
    /// Greens in their order, each with the ratio that it has to carry.
    pub(crate) greens: Vec<(usize, f64)>,
    /// Seconds of a cycle in which no green is shown.
    pub(crate) lost_s: f64,
}

impl FlowRatios {
    pub(crate) fn sum(&self) -> f64 {
        self.greens.iter().map(|(_, ratio)| ratio).sum()
    }

    /// Returns the share of the longest cycle that flows and lost time need.
    fn needed(&self) -> f64 {
        self.sum() + self.lost_s / LONGEST_CYCLE_S
    }
}

/// Returns the greens that need the least time, with their flow ratios. Each link keeps a green that serves it best.
/// `ratios`: flow over saturation flow of each approach.
fn flow_ratios(plan: &AgentPlan, ratios: &[f64]) -> FlowRatios {
    let all = plan.greens();
    let every_green: Vec<usize> = (0..all).collect();
    if all > FEW_GREENS || plan.phases.keeps_order() {
        return of_choice(plan, ratios, &every_green);
    }
    let choices = (1..1_usize << all).rev().map(|bits| (0..all).filter(|green| bits >> green & 1 == 1).collect());
    let mut best = of_choice(plan, ratios, &every_green);
    for choice in choices.filter(|choice: &Vec<usize>| is_enough(plan, choice)) {
        let found = of_choice(plan, ratios, &choice);
        if found.needed() < best.needed() {
            best = found;
        }
    }
    best
}

/// Returns whether each link that has green somewhere has it in these greens, and as well as anywhere. Letters of
/// vehicles that no agent sees, such as bicycles, have green in them, too.
pub(crate) fn is_enough(plan: &AgentPlan, greens: &[usize]) -> bool {
    let served = |link: usize, greens: &[usize]| greens.iter().any(|&green| plan.serves_best(green, link));
    let all: Vec<usize> = (0..plan.greens()).collect();
    let state = |green: usize| plan.phases.greens()[green].as_str().as_bytes();
    let opened = |letter: usize, greens: &[usize]| greens.iter().any(|&green| goes(state(green)[letter].into()));
    (0..plan.region.links.len()).all(|link| served(link, greens) || !served(link, &all))
        && plan.phases.cars().iter().all(|&letter| opened(letter, greens) || !opened(letter, &all))
}

fn of_choice(plan: &AgentPlan, ratios: &[f64], greens: &[usize]) -> FlowRatios {
    let next = |place: usize| greens[(place + 1) % greens.len()];
    let between = |(place, &green): (usize, &usize)| plan.phases.lost_steps(green, next(place));
    let lost: u32 = greens.iter().enumerate().map(between).sum();
    // Lanes that few greens serve come first, and of them the busiest.
    let mut lanes: Vec<(Vec<usize>, f64)> =
        ratios.iter().enumerate().map(|(approach, &ratio)| (carriers(plan, greens, approach), ratio)).collect();
    lanes.sort_by(|(places, ratio), (others, other)| places.len().cmp(&others.len()).then(other.total_cmp(ratio)));
    let mut carried = vec![0.0; greens.len()];
    for (places, ratio) in lanes {
        let lack = ratio - places.iter().map(|&place| carried[place]).sum::<f64>();
        // What is missing goes to the green that is longest already.
        let longest =
            places.into_iter().max_by(|&one, &other| carried[one].total_cmp(&carried[other]).then(other.cmp(&one)));
        if let Some(place) = longest.filter(|_| lack > 0.0) {
            carried[place] += lack;
        }
    }
    FlowRatios { greens: greens.iter().copied().zip(carried).collect(), lost_s: f64::from(lost) }
}

/// Returns the places of the greens in which the flow of an approach passes: those that serve all its links best. A lane
/// at the stop line that none of them serves whole passes in those that serve a part; one upstream does not count then.
fn carriers(plan: &AgentPlan, greens: &[usize], approach: usize) -> Vec<usize> {
    let lane = &plan.region.approaches[approach];
    let served = |place: usize, link: &usize| plan.serves_best(greens[place], *link);
    let whole = |&place: &usize| !lane.links.is_empty() && lane.links.iter().all(|link| served(place, link));
    let part = |&place: &usize| lane.ahead_m == 0.0 && lane.links.iter().any(|link| served(place, link));
    let places: Vec<usize> = (0..greens.len()).filter(whole).collect();
    if places.is_empty() { (0..greens.len()).filter(part).collect() } else { places }
}

/// Cars that came to the lights in a slice of an episode, over all episodes.
#[derive(Clone, Debug)]
pub(crate) struct Flows {
    /// Number of cars that came to each approach, one row per light. A car that changes lanes counts on the lane of the
    /// road on which it was last, in the slice in which it came to the road.
    pub(crate) cars: Ragged<u32>,
    pub(crate) seconds: u32,
}

impl Flows {
    /// Returns both together. They are of the same lights.
    pub(crate) fn and(&self, other: &Flows) -> Flows {
        let mut sum = self.clone();
        sum.seconds += other.seconds;
        for row in 0..sum.cars.len() {
            sum.cars.row_mut(row).iter_mut().zip(other.cars.row(row)).for_each(|(sum, more)| *sum += more);
        }
        sum
    }
}

/// Counts cars on the GS on separate episodes, with the lights under this rule.
fn measure(traffic: &Traffic, episodes: u32, slice_s: usize, by: impl LightController + 'static) -> Result<Vec<Flows>> {
    let plans = traffic.plans();
    let approaches: Vec<usize> = plans.iter().map(|plan| plan.region.approaches.len()).collect();
    let none = Flows { cars: Ragged::new(approaches), seconds: 0 };
    let flows = Rc::new(RefCell::new(vec![none; traffic.seconds().div_ceil(slice_s)]));
    let counter = Counter {
        by: Box::new(by),
        flows: flows.clone(),
        roads: plans.iter().map(|plan| roads(&plan.region.approaches)).collect(),
        last: HashMap::new(),
        slice_s,
        asked: 0,
    };
    let mut gs = traffic.global(traffic.everywhere(HandCoded::rule(counter)))?;
    let mut actions = vec![0; plans.len()];
    for episode in 0..episodes {
        gs.reset(Seed::new(0).fork(RandomPurpose::Webster).for_episode(episode as usize))?;
        for _ in 0..traffic.network.horizon {
            gs.step(&actions)?;
        }
        // The rule sees the cars before each step. Asked once more, it sees those after the last one.
        gs.advise(&mut actions);
    }
    drop(gs);
    Ok(Rc::into_inner(flows).expect("the simulator that held the other one is gone").into_inner())
}

/// Returns the road of each approach: the index of the first approach on the same road.
fn roads(approaches: &[Approach]) -> Vec<usize> {
    let road = |approach: &Approach| approach.lane.rsplit_once('_').map(|(road, _)| road.to_owned());
    let first = |approach| approaches.iter().position(|other| road(other) == road(approach));
    approaches.iter().map(|approach| first(approach).expect("it is one of them")).collect()
}

type CarOnRoad = (AgentId, usize, CarId);

/// The slice in which a car came to a road, and the approach on which it was last.
type Seen = (usize, usize);

/// Counts a car on an approach, and no longer on the one of the same road where it was before.
fn count(flows: &mut [Flows], last: &mut HashMap<CarOnRoad, Seen>, slice: usize, car: CarOnRoad, approach: usize) {
    let (AgentId(agent), ..) = car;
    match last.entry(car) {
        Entry::Vacant(new) => {
            new.insert((slice, approach));
            flows[slice].cars.row_mut(agent)[approach] += 1;
        }
        Entry::Occupied(mut known) => {
            let (slice, before) = known.get_mut();
            let counts = flows[*slice].cars.row_mut(agent);
            counts[*before] -= 1;
            counts[approach] += 1;
            *before = approach;
        }
    }
}

/// A rule that counts cars and lets another rule decide.
struct Counter {
    by: Box<dyn LightController>,
    /// Those of each slice.
    flows: Rc<RefCell<Vec<Flows>>>,
    roads: Vec<Vec<usize>>,
    /// Where a car of this episode was last.
    last: HashMap<CarOnRoad, Seen>,
    slice_s: usize,
    /// Number of times that it has been asked in this episode.
    asked: usize,
}

impl LightController for Counter {
    fn begin(&mut self, episode: Seed) {
        self.last.clear();
        self.asked = 0;
        self.by.begin(episode);
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        let mut flows = self.flows.borrow_mut();
        // Asked for the second time, it sees the cars after the first second.
        let slice = (self.asked.saturating_sub(1) / self.slice_s).min(flows.len() - 1);
        flows[slice].seconds += u32::from(self.asked > 0);
        self.asked += 1;
        for at in intersections.iter() {
            for (approach, (lane, &road)) in at.approaches.iter().zip(&self.roads[at.agent.0]).enumerate() {
                let cars = lane.ids.iter();
                cars.for_each(|&car| count(&mut flows, &mut self.last, slice, (at.agent, road, car), approach));
            }
        }
        self.by.act(intersections, targets);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::controllers::examples::{crossing, middle};

    #[test]
    fn greens_are_websters() {
        let plan = middle();
        // Ratios of the approaches from west, south, east and north.
        let greens = |ratios: [f64; 4]| {
            let timing = timing(&plan, &flow_ratios(&plan, &ratios));
            assert_eq!(timing.offset(), 0);
            (timing.greens()[0], timing.greens()[1])
        };
        // Y = 0.3 + 0.2: C = 14 / 0.5 = 28, of which 22 are green: 13.2 and 8.8.
        assert_eq!(greens([0.2, 0.3, 0.1, 0.0]), (13, 9));
        // Y = 0.23 + 0.23: C = 14 / 0.54 = 25.93, greens of 9.96.
        assert_eq!(greens([0.23; 4]), (10, 10));
        // Without cars C = 14, greens of 4.
        assert_eq!(greens([0.0; 4]), (4, 4));
        // Beyond saturation 120 s, 114 of them green, 2 : 1.
        assert_eq!(greens([0.0, 0.8, 0.4, 0.0]), (76, 38));
        // A road without cars still gets one step.
        assert_eq!(greens([0.0, 0.5, 0.0, 0.0]), (22, 1));
    }

    #[test]
    fn a_light_with_more_greens_has_more_lost_time_and_leaves_out_what_others_serve() {
        let plan = crossing();
        // L = 16 for four greens. Y = 0.3 + 0.1 + 0.1 + 0.1, C = 29 / 0.4 = 72.5, of which 56.5 are green.
        let ratios = FlowRatios { greens: vec![(0, 0.3), (1, 0.1), (2, 0.1), (3, 0.1)], lost_s: 16.0 };
        assert_eq!(timing(&plan, &ratios).greens(), [28, 9, 9, 9]);
        // C = 29 / 0.98 = 29.6, of which 13.6 are green. No green is shorter than the light's least of 5 steps.
        let ratios = FlowRatios { greens: vec![(0, 0.02), (1, 0.0), (2, 0.0), (3, 0.0)], lost_s: 16.0 };
        assert_eq!(timing(&plan, &ratios).greens(), [14, 5, 5, 5]);
    }

    #[test]
    fn the_busiest_approach_of_a_green_counts() {
        let found = flow_ratios(&middle(), &[0.2, 0.3, 0.1, 0.0]);
        assert_eq!(found, FlowRatios { greens: vec![(0, 0.3), (1, 0.2)], lost_s: 6.0 });
        // The lane upstream of the short one counts, too. A lane that greens 2 and 3 share counts once.
        let found = flow_ratios(&crossing(), &[0.1, 0.05, 0.15, 0.2, 0.25]);
        assert_eq!(found, FlowRatios { greens: vec![(0, 0.25), (1, 0.05), (2, 0.15), (3, 0.0)], lost_s: 16.0 });
    }

    #[test]
    fn a_green_is_left_out_if_others_serve_its_links_as_well() {
        let mut plan = crossing();
        assert!(is_enough(&plan, &[0, 1, 2, 3]));
        // Green 3 serves the left turn from the west with `g` only, so green 1 stays.
        assert!(!is_enough(&plan, &[0, 2, 3]));
        // Without the link from the south to the north, only vehicles that the agent does not see need green 2.
        plan.region.links[2].letter = 3;
        assert!(!is_enough(&plan, &[0, 1, 3]));
        // Nobody does if its letter is for people on foot.
        plan.phases = Arc::new((*plan.phases).clone().for_cars([0, 1, 3, 4].into()));
        assert!(is_enough(&plan, &[0, 1, 3]));
        let found = flow_ratios(&plan, &[0.1, 0.05, 0.15, 0.2, 0.25]);
        assert_eq!(found, FlowRatios { greens: vec![(0, 0.25), (1, 0.05), (3, 0.15)], lost_s: 12.0 });
    }

    #[test]
    fn a_lane_that_one_green_serves_whole_does_not_pass_in_a_part_of_another() {
        let mut plan = crossing();
        // The lane from the south now has green whole in green 0, and half of it in green 3. Another lane fills green 3.
        (plan.region.links[2].letter, plan.region.links[3].letter, plan.region.links[1].letter) = (0, 4, 3);
        let found = of_choice(&plan, &[0.0, 0.5, 0.4, 0.0, 0.0], &[0, 2, 3]);
        assert_eq!(found.greens, [(0, 0.4), (2, 0.0), (3, 0.5)]);
    }

    #[test]
    fn lanes_side_by_side_are_one_road() {
        assert_eq!(roads(&crossing().region.approaches), [0, 0, 2, 3, 4]);
        assert_eq!(roads(&middle().region.approaches), [0, 1, 2, 3]);
    }

    #[test]
    fn a_car_that_changes_lanes_counts_on_the_last_one() {
        let (mut flows, mut last) = (vec![Flows { cars: Ragged::new([3]), seconds: 0 }; 2], HashMap::new());
        let mut seen = |slice, car, road, approach| {
            count(&mut flows, &mut last, slice, (AgentId(0), road, CarId(car)), approach);
            [0, 1].map(|slice| flows[slice].cars.row(0).to_vec())
        };
        assert_eq!(seen(0, 5, 0, 0), [[1, 0, 0], [0; 3]]);
        assert_eq!(seen(0, 5, 0, 0), [[1, 0, 0], [0; 3]]);
        assert_eq!(seen(0, 6, 0, 0), [[2, 0, 0], [0; 3]]);
        assert_eq!(seen(1, 5, 0, 1), [[1, 1, 0], [0; 3]], "in the slice in which it came");
        assert_eq!(seen(1, 5, 2, 2), [[1, 1, 0], [0, 0, 1]], "on another road it counts again");
    }
}
