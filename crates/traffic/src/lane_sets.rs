//! A light as a set of lanes and a set of greens: an observation that fits a light of any shape.
//!
//! Each lane before a stop line and each green has a few features. For each green it is said which lanes it opens. Policies read
//! that as [`Sets`], so the order of lanes and greens, their number and their names mean nothing to them.

use super::agents::loops::Loop;
use super::agents::phase_plan::Shown;
use super::agents::plan::AgentPlan;
use super::cars_at::CarsAt;
use super::observe::JAM_M;
use super::reward::PERSONS;
use crate::config::DETECTORS_ONLY;
use crate::events::site::DetectorPlace;
use crate::sim::readings::{COLUMNS, Readings};
use dials_core::base::{Seed, scramble};
use dials_core::domain::Sets;
use libsumo::{Car, LaneCars};
use rand::RngCore;

/// Features of a lane, in this order. Counts are in tens of cars.
const OF_LANE: [&str; 29] = [
    "is there",
    "length in view",
    "speed limit",
    "links",
    "queue",
    "cars",
    "cars within 10 m",
    "cars within 25 m",
    "cars within 50 m",
    "cars within 100 m",
    "cars within 150 m",
    "mean speed",
    "share with green",
    "time since green",
    "cars behind the light",
    "queue behind the light",
    "share filled behind the light",
    "share filled on the fullest exit",
    "joins another light",
    "share of the cars that is not seen",
    "detector at the stop line",
    "count at the stop line",
    "occupancy at the stop line",
    "gap at the stop line",
    "advance detector",
    "advance count",
    "advance occupancy",
    "advance gap",
    "cars between the detectors",
];
/// Where a lane shows the share of the cars that is not seen.
const NOT_SEEN: usize = 19;
/// Where the features of a lane's detectors begin: of that at the stop line, and of the advance detector.
const OF_STOP_BAR: usize = 20;
const OF_ADVANCE: usize = 24;
/// Features of a green, in this order. People are in tens, and those who wait to walk stand at the crossings that it opens.
const OF_GREEN: [&str; 11] = [
    "is there",
    "is shown or comes next",
    "is shown",
    "time shown",
    "time since it was shown",
    "least time left",
    "time to change to it",
    "may be shown",
    "lanes that it opens",
    "people who wait to walk",
    "longest time since they could",
];
/// A green opens a lane for a share of its links: in all, and with priority.
const WAYS: usize = 2;

/// Distances from the stop line at which the stretches end whose cars are counted, in metres.
const STRETCHES_M: [f64; 5] = [10.0, 25.0, 50.0, 100.0, 150.0];
/// Units of features, chosen so that usual values are near 1.
const CARS: f32 = 10.0;
const SPEED_MPS: f64 = 20.0;
const LENGTH_M: f64 = 150.0;
const LINKS: f32 = 4.0;
const LANES: f32 = 4.0;
const CLEARING_S: f32 = 10.0;
/// Standing cars from which on a queue is long, and for which a green stays, in [`CARS`].
const LONG_QUEUE: f32 = 0.8;
const SEVERAL: f32 = 0.3;

/// Returns the names of the features of a lane, and of those of a green.
pub(crate) fn features() -> [Vec<String>; 2] {
    [OF_LANE.map(str::to_owned).to_vec(), OF_GREEN.map(str::to_owned).to_vec()]
}

/// Returns the places of features in an observation with room for this many lanes and greens.
pub(crate) fn sets(lanes: usize, greens: usize) -> Sets {
    Sets { items: lanes, item_features: OF_LANE.len(), choices: greens, choice_features: OF_GREEN.len(), ways: WAYS }
}

/// Returns the sets of some lights, all with the room that the largest one needs.
pub(crate) fn of_lights(plans: &[AgentPlan], up_to_m: f64) -> Vec<LaneSets> {
    let most = |count: fn(&AgentPlan) -> usize| plans.iter().map(count).max().unwrap_or(0);
    let (lanes, greens) = (most(|plan| plan.region.approaches.len()), most(AgentPlan::greens));
    let of_light = |plan: &AgentPlan| {
        LaneSets::new(plan.region.approaches.len(), plan.greens(), up_to_m).fitted(plan, lanes, greens)
    };
    plans.iter().map(of_light).collect()
}

/// Draws the cars that a light sees in an episode, each by its number: whoever is seen at one light is seen at all with such a share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Draw {
    episode: u64,
    /// Share of the cars, at most 1. Each of them counts for one over the share. 0: detectors only.
    share: f64,
}

impl Default for Draw {
    /// All cars are seen.
    fn default() -> Draw {
        Draw { episode: 0, share: 1.0 }
    }
}

impl Draw {
    pub(crate) fn of(episode: Seed, share: f64) -> Draw {
        Draw { episode: episode.fork_named("seen cars").dice().next_u64(), share }
    }

    fn sees(self, car: &Car) -> bool {
        // The upper 53 bits are a number from 0 to 1.
        self.share >= 1.0 || ((scramble(car.id.0 ^ self.episode) >> 11) as f64) < self.share * 2_f64.powi(53)
    }

    fn seen<'a>(self, cars: LaneCars<'a>) -> impl Iterator<Item = Car> + use<'a> {
        cars.iter().filter(move |car| self.sees(car))
    }

    /// Returns the number of cars for which a number of seen ones stands.
    fn stand_for(self, seen: usize) -> f32 {
        if self.is_blind() { 0.0 } else { (seen as f64 / self.share) as f32 }
    }

    /// Returns whether a light sees no car, but what its detectors count.
    pub(crate) fn is_blind(self) -> bool {
        self.share == DETECTORS_ONLY
    }
}

/// How the lanes and greens of an agent lie in its observation, and what of them never changes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LaneSets {
    pub(crate) sets: Sets,
    /// How far before the stop line cars are seen, in metres.
    pub(crate) up_to_m: f64,
    /// Detectors of its lanes.
    pub(crate) loops: Vec<Loop>,
    /// An observation with all that never changes. Empty until the agents know how much room they need together.
    fixed: Vec<f32>,
}

/// What an agent sees of its light at a decision.
pub(crate) struct Seen<'a> {
    pub(crate) cars: CarsAt<'a>,
    pub(crate) exits: CarsAt<'a>,
    /// Persons who stand at each crossing. Empty where nobody walks.
    pub(crate) people: &'a [u32],
    pub(crate) shown: Shown,
    /// Number of steps for which it has been shown.
    pub(crate) shown_steps: u32,
    pub(crate) since: &'a SinceGreen,
    pub(crate) draw: Draw,
    /// What its detectors have seen since the last decision. They show if it sees no car.
    pub(crate) readings: Option<&'a Readings>,
}

/// Number of seconds since each green of a light was shown last. At the beginning of an episode all are 0.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct SinceGreen(Vec<u32>);

impl SinceGreen {
    pub(crate) fn begin(greens: usize) -> SinceGreen {
        SinceGreen(vec![0; greens])
    }

    /// Notes what the light has shown in a second.
    pub(crate) fn note(&mut self, shown: Shown) {
        self.0.iter_mut().for_each(|seconds| *seconds += 1);
        if let Some(seconds) = shown.green().and_then(|green| self.0.get_mut(green)) {
            *seconds = 0;
        }
    }
}

impl LaneSets {
    /// Returns the sets of an agent with this number of lanes and greens.
    pub(crate) fn new(lanes: usize, greens: usize, up_to_m: f64) -> LaneSets {
        LaneSets { sets: sets(lanes, greens), up_to_m, loops: Vec::new(), fixed: Vec::new() }
    }

    /// Gives the agent as much room as the largest one of them needs, and writes down what never changes. `plan`: its own.
    pub(crate) fn fitted(&self, plan: &AgentPlan, lanes: usize, greens: usize) -> LaneSets {
        let sets = Sets { items: lanes, choices: greens, ..self.sets };
        let mut fixed = vec![0.0; sets.inputs()];
        for (lane, approach) in plan.region.approaches.iter().enumerate() {
            let in_view_m = approach.length_m.min(self.up_to_m - approach.ahead_m);
            let joins =
                approach.links.iter().filter(|&&link| !plan.region.exits[plan.region.links[link].to].leaves_the_net);
            let links = approach.links.len().max(1) as f32;
            let features = &mut fixed[sets.item(lane)];
            features[0] = 1.0;
            features[1] = (in_view_m / LENGTH_M) as f32;
            features[2] = (approach.speed_limit_mps / SPEED_MPS) as f32;
            features[3] = approach.links.len() as f32 / LINKS;
            features[18] = joins.count() as f32 / links;
        }
        for green in 0..plan.greens() {
            let served: f64 = (0..plan.region.approaches.len()).map(|lane| plan.share(green, lane)).sum();
            let features = &mut fixed[sets.choice(green)];
            features[0] = 1.0;
            features[8] = served as f32 / LANES;
            let shares: [fn(&AgentPlan, usize, usize) -> f64; WAYS] =
                [AgentPlan::share, AgentPlan::share_with_priority];
            for (way, share) in shares.into_iter().enumerate() {
                let lanes = fixed[sets.belongs(green, way)].iter_mut().take(plan.region.approaches.len());
                lanes.enumerate().for_each(|(lane, weight)| *weight = share(plan, green, lane) as f32);
            }
        }
        LaneSets { sets, up_to_m: self.up_to_m, loops: Loop::of(&plan.region.approaches), fixed }
    }

    pub(crate) fn columns(&self) -> usize {
        self.sets.inputs()
    }

    /// Returns the name of every column. `lanes`: those of the agent; what is beyond them is room for others.
    pub(crate) fn names<'a>(&self, lanes: impl Iterator<Item = &'a String>) -> Vec<String> {
        let lanes: Vec<&String> = lanes.collect();
        let lane = |item: usize| lanes.get(item).map_or_else(|| format!("lane[{item}]"), |lane| (*lane).clone());
        let Sets { items, choices, .. } = self.sets;
        let of_lanes = (0..items).flat_map(|item| OF_LANE.map(|feature| format!("{feature} {}", lane(item))));
        let of_greens = (0..choices).flat_map(|green| OF_GREEN.map(|feature| format!("green[{green}] {feature}")));
        let opens = (0..choices).flat_map(|green| ["opens", "opens with priority"].map(|how| (green, how)));
        let opens = opens.flat_map(|(green, how)| (0..items).map(move |item| (green, how, item)));
        let opens = opens.map(|(green, how, item)| format!("green[{green}] {how} {}", lane(item)));
        of_lanes.chain(of_greens).chain(opens).collect()
    }

    /// Returns which greens serve those who have stood at red for longest, cars on a lane or persons at a crossing, as an observation
    /// shows them; and for how many seconds it has been red. Where a long queue stands, a second counts as three.
    pub(crate) fn longest_waiting(&self, plan: &AgentPlan, obs: &[f32]) -> (Vec<bool>, u32) {
        let red_s = |lane: usize| match &obs[self.sets.item(lane)] {
            features if !stands(features) => 0,
            features => seconds(features[13]) * if shows_queue(features, LONG_QUEUE) { 3 } else { 1 },
        };
        let reds: Vec<u32> = (0..plan.region.approaches.len()).map(red_s).collect();
        let people: Vec<u32> = (0..plan.greens()).map(|green| seconds(obs[self.sets.choice(green)][10])).collect();
        let longest = reds.iter().chain(&people).copied().max().unwrap_or(0);
        let serves = |green: usize| {
            people[green] == longest || (0..reds.len()).any(|lane| reds[lane] == longest && plan.serves(green, lane))
        };
        ((0..plan.greens()).map(serves).collect(), longest)
    }

    /// Returns the green that an observation shows, if it has been shown for less than `hold` seconds, several cars stand on a lane that
    /// it opens, and nobody waits to walk.
    pub(crate) fn still_needed(&self, plan: &AgentPlan, obs: &[f32], hold: u32) -> Option<usize> {
        let features = |green: usize| &obs[self.sets.choice(green)];
        let green = (0..plan.greens()).find(|&green| features(green)[2] == 1.0)?;
        let queues = (0..plan.region.approaches.len()).filter(|&lane| plan.serves(green, lane));
        let is_needed = queues.into_iter().any(|lane| shows_queue(&obs[self.sets.item(lane)], SEVERAL));
        let somebody_waits = (0..plan.greens()).any(|green| features(green)[9] > 0.0);
        (is_needed && !somebody_waits && seconds(features(green)[3]) < hold).then_some(green)
    }

    /// Writes an observation.
    pub(crate) fn observe(&self, plan: &AgentPlan, seen: &Seen<'_>, obs: &mut [f32]) {
        obs.copy_from_slice(&self.fixed);
        for lane in 0..plan.region.approaches.len() {
            self.observe_lane(plan, seen, lane, &mut obs[self.sets.item(lane)]);
        }
        for (detector, read, between) in
            seen.readings.filter(|_| seen.draw.is_blind()).into_iter().flat_map(Readings::iter)
        {
            let first = match detector.place {
                DetectorPlace::StopBar => OF_STOP_BAR,
                DetectorPlace::Advance => OF_ADVANCE,
            };
            let features = &mut obs[self.sets.item(detector.approach)][first..];
            features[0] = 1.0;
            features[1..=COLUMNS].copy_from_slice(&read);
            if detector.place == DetectorPlace::Advance {
                features[COLUMNS + 1] = between as f32 / CARS;
            }
        }
        let Seen { shown, shown_steps, .. } = *seen;
        let target = shown.target();
        for green in 0..plan.greens() {
            let features = &mut obs[self.sets.choice(green)];
            let is_shown = shown.green() == Some(green);
            features[1] = f32::from(u8::from(green == target));
            features[2] = f32::from(u8::from(is_shown));
            if is_shown {
                let least = plan.phases.min_green_steps()[green];
                features[3] = time(shown_steps);
                features[5] = least.saturating_sub(shown_steps) as f32 / CLEARING_S;
            }
            features[4] = time(seen.since.0[green]);
            if let (Some(from), false) = (shown.green(), is_shown) {
                features[6] = plan.phases.clearing_steps(from, green) as f32 / CLEARING_S;
            }
            features[7] = f32::from(u8::from(is_old_enough(plan, shown, shown_steps, green)));
        }
        for (crossing, &persons) in seen.people.iter().enumerate().filter(|(_, persons)| **persons > 0) {
            let greens = plan.walked_in(crossing);
            let red = time(greens.iter().map(|&green| seen.since.0[green]).min().unwrap_or(0));
            for green in greens {
                let features = &mut obs[self.sets.choice(green)];
                features[9] += persons as f32 / PERSONS as f32;
                features[10] = red.max(features[10]);
            }
        }
    }

    fn observe_lane(&self, plan: &AgentPlan, seen: &Seen<'_>, lane: usize, features: &mut [f32]) {
        let approach = &plan.region.approaches[lane];
        let (mut queue, mut count, mut speeds_mps) = (0, 0, 0.0);
        let one = seen.draw.stand_for(1) / CARS;
        for car in seen.draw.seen(seen.cars.lane(lane)) {
            let before_m = approach.length_m - car.position_m + approach.ahead_m;
            if before_m > self.up_to_m {
                continue;
            }
            count += 1;
            queue += usize::from(car.stands());
            speeds_mps += car.speed_mps;
            if let Some(stretch) = STRETCHES_M.iter().position(|&end_m| before_m < end_m) {
                features[6 + stretch] += one;
            }
        }
        features[4] = seen.draw.stand_for(queue) / CARS;
        features[5] = seen.draw.stand_for(count) / CARS;
        if count > 0 {
            features[11] = (speeds_mps / count as f64 / approach.speed_limit_mps) as f32;
        }
        if let Some(green) = seen.shown.green() {
            features[12] = plan.share(green, lane) as f32;
        }
        let opening = (0..plan.greens()).filter(|&green| plan.serves(green, lane));
        features[13] = time(opening.map(|green| seen.since.0[green]).min().unwrap_or(0));
        let exits = approach.links.iter().map(|&link| plan.region.links[link].to);
        let links = approach.links.len().max(1) as f32;
        for exit in exits {
            let (mut count, mut queue) = (0, 0);
            for car in seen.draw.seen(seen.exits.lane(exit)) {
                count += 1;
                queue += usize::from(car.stands());
            }
            let room = (plan.region.exits[exit].length_m / JAM_M).max(1.0) as f32;
            let filled = (seen.draw.stand_for(count) / room).min(1.0);
            features[14] += seen.draw.stand_for(count) / CARS / links;
            features[15] += seen.draw.stand_for(queue) / CARS / links;
            features[16] += filled / links;
            features[17] = filled.max(features[17]);
        }
        features[NOT_SEEN] = (1.0 - seen.draw.share) as f32;
    }
}

/// Returns whether a lane has a queue of this length, in [`CARS`], by its features. Where only a part of the cars is seen, the queue is a
/// guess, and the answer is no.
fn shows_queue(lane: &[f32], cars: f32) -> bool {
    lane[4] >= cars && lane[NOT_SEEN] == 0.0
}

/// Returns whether somebody stands on a lane with these features. Where only detectors see, somebody does who has been over the one at the
/// stop line all the time.
fn stands(lane: &[f32]) -> bool {
    lane[4] > 0.0 || lane[OF_STOP_BAR + 2] >= 1.0
}

/// Returns whether the least time of what is shown lets a light go to a green, or keep it. Other limits do not show.
fn is_old_enough(plan: &AgentPlan, shown: Shown, shown_steps: u32, green: usize) -> bool {
    match shown {
        Shown::Green(from) => from == green || shown_steps >= plan.phases.least_before(from, green),
        Shown::Between { to, .. } => to == green,
    }
}

/// Returns a time of so many seconds as a feature: 0 for 0 s, 0.36 for 5 s, 0.82 for a minute, 1.14 for five.
fn time(seconds: u32) -> f32 {
    (seconds as f32).ln_1p() / 5.0
}

/// Returns the time that a feature shows.
fn seconds(time: f32) -> u32 {
    (5.0 * time).exp_m1().round() as u32
}

/// Gives all agents that see sets the room that the largest of them needs.
pub(crate) fn make_room(agents: &mut [AgentPlan]) {
    let Some(up_to_m) = agents.first().and_then(|agent| agent.sensor.sets()).map(|sets| sets.up_to_m) else { return };
    let fitted = of_lights(agents, up_to_m);
    agents.iter_mut().zip(fitted).for_each(|(agent, sets)| agent.sensor.see(sets));
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::agents::others_plan::Crossing;
    use crate::cars_at::no_cars;
    use crate::config::DetectorFaults;
    use crate::controllers::examples::{crossing, middle};
    use libsumo::{CarId, CarTable};

    /// Returns a table with these cars on each lane: metres from its beginning, and metres per second.
    fn cars(lanes: &[&[(f64, f64)]]) -> CarTable {
        let car = |(number, &(metres, mps)): (usize, &(f64, f64))| (CarId(number as u64), metres, mps);
        CarTable::of(lanes.iter().map(|cars| cars.iter().enumerate().map(car).collect()))
    }

    const UP_TO_M: f64 = 150.0;

    fn observe(
        plan: &AgentPlan,
        room: [usize; 2],
        shown: Shown,
        cars_on: [&CarTable; 2],
        since: &SinceGreen,
    ) -> Vec<f32> {
        let sets = LaneSets::new(plan.region.approaches.len(), plan.greens(), UP_TO_M).fitted(plan, room[0], room[1]);
        let mut obs = vec![7.0; sets.columns()];
        let [cars, exits] = cars_on.map(CarsAt::all);
        sets.observe(
            plan,
            &Seen { cars, exits, people: &[], shown, shown_steps: 3, since, draw: Draw::default(), readings: None },
            &mut obs,
        );
        obs
    }

    fn close_to(found: &[f32], expected: &[f32]) {
        assert_eq!(found.len(), expected.len());
        let is_close = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6);
        assert!(is_close, "{found:?} instead of {expected:?}");
    }

    #[test]
    fn a_lane_shows_its_cars_by_distance_its_light_and_what_is_behind_it() {
        let plan = crossing();
        // From the south: one stands 5 m before the stop line, one drives with 5 m/s 45 m before it.
        let approaches = cars(&[&[], &[], &[(5.0, 5.0), (45.0, 0.0)], &[], &[]]);
        let exits = cars(&[&[], &[(10.0, 0.0), (20.0, 8.0)], &[]]);
        let mut since = SinceGreen::begin(4);
        (0..6).for_each(|_| since.note(Shown::Green(0)));
        let obs = observe(&plan, [5, 4], Shown::Green(0), [&approaches, &exits], &since);
        let filled = 2.0 * 7.5 / 100.0;
        let red_for = 7.0_f32.ln() / 5.0;
        let expected = [
            // There, seen, 10 m/s, two links.
            &[1.0, 50.0 / 150.0, 0.5, 0.5][..],
            // Queue, cars, their distances, half of half the speed limit.
            &[0.1, 0.2, 0.1, 0.0, 0.1, 0.0, 0.0, 0.25],
            // Red, and since when.
            &[0.0, red_for],
            // Behind the light only one of the two exits has cars.
            &[0.1, 0.05, filled / 2.0, filled],
            // One of two exits leads to another light.
            &[0.5],
            // All cars are seen.
            &[0.0],
            // Detectors show only to whom no car does.
            &[0.0; 9],
        ];
        close_to(&obs[sets(5, 4).item(2)], &expected.concat());
        // Cars upstream of another lane are 10 m farther away.
        let upstream = cars(&[&[], &[], &[], &[], &[(59.0, 0.0)]]);
        let obs = observe(&plan, [5, 4], Shown::Green(0), [&upstream, &exits], &since);
        close_to(&obs[sets(5, 4).item(4)][4..11], &[0.1, 0.1, 0.0, 0.1, 0.0, 0.0, 0.0]);
        assert_eq!(obs[sets(5, 4).item(4)][12], 1.0, "it has green");
    }

    #[test]
    fn a_green_shows_its_time_what_it_opens_and_what_a_change_costs() {
        let plan = crossing();
        let nobody = [5, 3].map(no_cars);
        let mut since = SinceGreen::begin(4);
        (0..3).for_each(|_| since.note(Shown::Green(1)));
        let obs = observe(&plan, [5, 4], Shown::Green(1), nobody.each_ref(), &since);
        let time = 4.0_f32.ln() / 5.0;
        // Two of five seconds are left.
        close_to(&obs[sets(5, 4).choice(1)], &[1.0, 1.0, 1.0, time, 0.0, 0.2, 0.0, 1.0, 0.25, 0.0, 0.0]);
        // Yellow for three seconds and red for one.
        close_to(&obs[sets(5, 4).choice(3)], &[1.0, 0.0, 0.0, 0.0, time, 0.0, 0.4, 0.0, 0.375, 0.0, 0.0]);
        // The left turn from the west yields in green 3; half of the lane from the south is open.
        close_to(&obs[sets(5, 4).belongs(3, 0)], &[0.0, 1.0, 0.5, 0.0, 0.0]);
        close_to(&obs[sets(5, 4).belongs(3, 1)], &[0.0, 0.0, 0.5, 0.0, 0.0]);
        let between = observe(&plan, [5, 4], Shown::Between { from: 1, to: 3 }, nobody.each_ref(), &since);
        let marks = [0, 1, 2, 3].map(|green| between[sets(5, 4).choice(green)][1]);
        assert_eq!(marks, [0.0, 0.0, 0.0, 1.0], "it comes next");
        assert_eq!([0, 1, 2, 3].map(|green| between[sets(5, 4).choice(green)][7]), [0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_green_shows_who_waits_to_walk_and_since_when_nobody_could() {
        let mut plan = crossing();
        // Green 0 opens the first crossing, greens 1 and 3 the second one, and none the third one.
        let letters = [&[0, 4][..], &[1], &[]];
        plan.others.crossings = letters.map(Crossing::of_letters).to_vec();
        let sets = LaneSets::new(5, 4, UP_TO_M).fitted(&plan, 5, 4);
        let [cars, exits] = [5, 3].map(no_cars);
        let mut since = SinceGreen::begin(4);
        (0..9).for_each(|_| since.note(Shown::Green(0)));
        (0..130).for_each(|_| since.note(Shown::Green(2)));
        let observed = |people: &[u32]| {
            let [cars, exits] = [&cars, &exits].map(CarsAt::all);
            let (shown, draw) = (Shown::Green(2), Draw::default());
            let mut obs = vec![7.0; sets.columns()];
            sets.observe(
                &plan,
                &Seen { cars, exits, people, shown, shown_steps: 130, since: &since, draw, readings: None },
                &mut obs,
            );
            obs
        };
        let shown = |people: &[u32], green: usize| observed(people)[sets.sets.choice(green)][9..].to_vec();
        let since_s = |seconds: u32| (seconds as f32).ln_1p() / 5.0;
        let people = [3, 20, 7];
        close_to(&shown(&people, 0), &[0.3, since_s(130)]);
        for green in [1, 3] {
            close_to(&shown(&people, green), &[2.0, since_s(139)]);
        }
        close_to(&shown(&people, 2), &[0.0; 2]);
        close_to(&shown(&[3, 0, 7], 1), &[0.0; 2]);
        close_to(&shown(&[], 0), &[0.0; 2]);
        // People count as cars do for those who have stood longest.
        let longest = |people: &[u32]| sets.longest_waiting(&plan, &observed(people));
        assert_eq!(longest(&people), (vec![false, true, false, true], 139));
        assert_eq!(longest(&[1, 0, 0]), (vec![true, false, false, false], 130));
        assert_eq!(longest(&[0, 0, 9]).1, 0, "no green is for them");
    }

    #[test]
    fn each_seen_car_stands_for_those_that_are_not_seen() {
        let (plan, draw) = (crossing(), Draw::of(Seed::new(1), 0.5));
        let seen = |episode: Seed| {
            let cars = (0..10_000).map(|number| Car { id: CarId(number), position_m: 0.0, speed_mps: 0.0 });
            cars.filter(|car| Draw::of(episode, 0.5).sees(car)).count()
        };
        // Half of 10 000, standard deviation 50.
        let counts = [1, 2].map(|seed| seen(Seed::new(seed)));
        assert!(counts.iter().all(|count| (4_800..5_200).contains(count)) && counts[0] != counts[1], "{counts:?}");
        // Four cars stand 5 m before the stop line, and the first is on its exit, too.
        let ids: Vec<u64> = (0..4).collect();
        let row = |ids: &[u64]| ids.iter().map(|&id| (CarId(id), 95.0, 0.0)).collect();
        let table = |on: usize, ids: &[u64], lanes: usize| {
            CarTable::of((0..lanes).map(|lane| if lane == on { row(ids) } else { Vec::new() }))
        };
        let [cars, exits] = [table(0, &ids, 5), table(0, &ids[..1], 3)];
        let sets = LaneSets::new(5, 4, UP_TO_M).fitted(&plan, 5, 4);
        let mut obs = vec![0.0; sets.columns()];
        let [at, behind] = [&cars, &exits].map(CarsAt::all);
        let since = SinceGreen::begin(4);
        let shown = Shown::Green(0);
        sets.observe(
            &plan,
            &Seen { cars: at, exits: behind, people: &[], shown, shown_steps: 1, since: &since, draw, readings: None },
            &mut obs,
        );
        let sees = |id: &u64| draw.sees(&Car { id: CarId(*id), position_m: 0.0, speed_mps: 0.0 });
        let count = ids.iter().filter(|id| sees(id)).count() as f32;
        assert!(count > 0.0 && count < 4.0, "otherwise this shows nothing");
        let lane = &obs[sets.sets.item(0)];
        close_to(&[lane[4], lane[5], lane[6]], &[2.0 * count / 10.0; 3]);
        assert_eq!(lane[19], 0.5);
        assert!((lane[14] - if sees(&0) { 0.2 } else { 0.0 }).abs() < 1e-6, "on the exit");
    }

    #[test]
    fn a_light_that_sees_no_car_sees_what_its_detectors_count() {
        let plan = crossing();
        let sets = LaneSets::new(5, 4, UP_TO_M).fitted(&plan, 5, 4);
        let mut readings = Readings::begin(&sets.loops, DetectorFaults::default(), Seed::new(1));
        // A car stands at the stop line of the first lane for two seconds, and one is behind the light.
        let [at, behind] = [cars(&[&[(95.0, 0.0)], &[], &[], &[], &[]]), cars(&[&[(5.0, 0.0)], &[], &[]])];
        let since = {
            let mut since = SinceGreen::begin(4);
            (0..130).for_each(|_| since.note(Shown::Green(2)));
            since
        };
        (0..2).for_each(|_| readings.second(&plan.region, CarsAt::all(&at)));
        let observed = |share: f64| {
            let [cars, exits] = [&at, &behind].map(CarsAt::all);
            let (shown, draw) = (Shown::Green(2), Draw::of(Seed::new(1), share));
            let mut obs = vec![7.0; sets.columns()];
            let readings = Some(&readings);
            let seen = Seen { cars, exits, people: &[], shown, shown_steps: 130, since: &since, draw, readings };
            sets.observe(&plan, &seen, &mut obs);
            obs
        };
        let blind = observed(DETECTORS_ONLY);
        let lane = &blind[sets.sets.item(0)];
        assert!(lane[4..12].iter().chain(&lane[14..18]).all(|&feature| feature == 0.0), "{lane:?}");
        assert_eq!(lane[19], 1.0);
        // The one at the stop line has been covered all the time, without a car that came; the other one has seen nobody.
        close_to(&lane[OF_STOP_BAR..], &[1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!(sets.longest_waiting(&plan, &blind), (vec![true, false, false, false], 130));
        let sees = observed(1.0);
        assert!(sees[sets.sets.item(0)][OF_STOP_BAR..].iter().all(|&feature| feature == 0.0));
        assert_eq!(sees[sets.sets.item(0)][4], 0.1);
    }

    #[test]
    fn room_for_larger_lights_stays_empty() {
        let (plan, sets) = (crossing(), sets(9, 6));
        let nobody = [5, 3].map(no_cars);
        let obs = observe(&plan, [9, 6], Shown::Green(0), nobody.each_ref(), &SinceGreen::begin(4));
        let empty = (5..9).map(|lane| sets.item(lane)).chain((4..6).map(|green| sets.choice(green)));
        assert!(empty.flatten().all(|column| obs[column] == 0.0));
        assert!((0..4).all(|green| obs[sets.belongs(green, 0)][5..].iter().all(|&share| share == 0.0)));
    }

    #[test]
    fn lights_of_different_shapes_get_the_same_room_and_every_column_a_name_of_its_own() {
        let plans = [middle(), crossing()];
        let fitted = of_lights(&plans, UP_TO_M);
        assert_eq!(fitted[0].sets, fitted[1].sets);
        assert_eq!([fitted[0].sets.items, fitted[0].sets.choices], [5, 4]);
        let names = fitted[1].names(plans[1].region.approaches.iter().map(|approach| &approach.lane));
        assert_eq!(names.len(), fitted[1].columns());
        assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len());
    }
}
