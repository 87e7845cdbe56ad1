//! A light as a set of lanes and a set of greens: an observation that fits a light of any shape.
//!
//! Each lane before a stop line and each green has a few features. For each green it is said which lanes it opens. Policies read
//! that as [`Sets`], so the order of lanes and greens, their number and their names mean nothing to them.

use super::agents::phase_plan::Shown;
use super::agents::plan::AgentPlan;
use super::cars_at::CarsAt;
use super::observe::{JAM_M, LightView};
use dials_core::domain::Sets;

/// Features of a lane, in this order. Counts are in tens of cars.
const OF_LANE: [&str; 19] = [
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
];
/// Features of a green, in this order.
const OF_GREEN: [&str; 9] = [
    "is there",
    "is shown or comes next",
    "is shown",
    "time shown",
    "time since it was shown",
    "least time left",
    "time to change to it",
    "may be shown",
    "lanes that it opens",
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

/// How the lanes and greens of an agent lie in its observation, and what of them never changes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LaneSets {
    pub(crate) sets: Sets,
    /// How far before the stop line cars are seen, in metres.
    seen_m: f64,
    /// An observation with all that never changes. Empty until the agents know how much room they need together.
    fixed: Vec<f32>,
}

/// What an agent sees of its light at a decision.
pub(crate) struct Seen<'a> {
    pub(crate) cars: CarsAt<'a>,
    pub(crate) exits: CarsAt<'a>,
    pub(crate) light: LightView,
    pub(crate) since: &'a SinceGreen,
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
    pub(crate) fn new(lanes: usize, greens: usize, seen_m: f64) -> LaneSets {
        let (item_features, choice_features) = (OF_LANE.len(), OF_GREEN.len());
        let sets = Sets { items: lanes, item_features, choices: greens, choice_features, ways: WAYS };
        LaneSets { sets, seen_m, fixed: Vec::new() }
    }

    /// Gives the agent as much room as the largest one of them needs, and writes down what never changes. `plan`: its own.
    pub(crate) fn fitted(&self, plan: &AgentPlan, lanes: usize, greens: usize) -> LaneSets {
        let sets = Sets { items: lanes, choices: greens, ..self.sets };
        let mut fixed = vec![0.0; sets.inputs()];
        for (lane, approach) in plan.region.approaches.iter().enumerate() {
            let in_view_m = approach.length_m.min(self.seen_m - approach.ahead_m);
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
            for lane in 0..plan.region.approaches.len() {
                fixed[sets.belongs(green, 0)][lane] = plan.share(green, lane) as f32;
                fixed[sets.belongs(green, 1)][lane] = plan.share_with_priority(green, lane) as f32;
            }
        }
        LaneSets { sets, fixed, ..*self }
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

    /// Writes an observation.
    pub(crate) fn observe(&self, plan: &AgentPlan, seen: &Seen<'_>, obs: &mut [f32]) {
        obs.copy_from_slice(&self.fixed);
        for lane in 0..plan.region.approaches.len() {
            self.observe_lane(plan, seen, lane, &mut obs[self.sets.item(lane)]);
        }
        let LightView { shown, shown_steps, .. } = seen.light;
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
    }

    fn observe_lane(&self, plan: &AgentPlan, seen: &Seen<'_>, lane: usize, features: &mut [f32]) {
        let approach = &plan.region.approaches[lane];
        let (mut queue, mut count, mut speeds_mps) = (0, 0, 0.0);
        for (car, stands) in seen.cars.lane(lane).iter().zip(seen.cars.lane(lane).standing()) {
            let before_m = approach.length_m - car.position_m + approach.ahead_m;
            if before_m > self.seen_m {
                continue;
            }
            count += 1;
            queue += u32::from(stands.1);
            speeds_mps += car.speed_mps;
            if let Some(stretch) = STRETCHES_M.iter().position(|&end_m| before_m < end_m) {
                features[6 + stretch] += 1.0 / CARS;
            }
        }
        features[4] = queue as f32 / CARS;
        features[5] = count as f32 / CARS;
        if count > 0 {
            features[11] = (speeds_mps / f64::from(count) / approach.speed_limit_mps) as f32;
        }
        if let Some(green) = seen.light.shown.green() {
            features[12] = plan.share(green, lane) as f32;
        }
        let opening = (0..plan.greens()).filter(|&green| plan.serves(green, lane));
        features[13] = time(opening.map(|green| seen.since.0[green]).min().unwrap_or(0));
        let exits = approach.links.iter().map(|&link| plan.region.links[link].to);
        let links = approach.links.len().max(1) as f32;
        for exit in exits {
            let cars = seen.exits.lane(exit);
            let room = (plan.region.exits[exit].length_m / JAM_M).max(1.0) as f32;
            let filled = (cars.len() as f32 / room).min(1.0);
            features[14] += cars.len() as f32 / CARS / links;
            features[15] += cars.halting() as f32 / CARS / links;
            features[16] += filled / links;
            features[17] = filled.max(features[17]);
        }
    }
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

/// Gives all agents that see sets the room that the largest of them needs.
pub(crate) fn make_room(agents: &mut [AgentPlan]) {
    let sets = |agent: &AgentPlan| agent.sensor.sets().map(|it| it.sets);
    let [lanes, greens] = [|it: Sets| it.items, |it: Sets| it.choices]
        .map(|size| agents.iter().filter_map(sets).map(size).max().unwrap_or(0));
    for agent in agents {
        if let Some(fitted) = agent.sensor.sets().map(|sets| sets.fitted(agent, lanes, greens)) {
            agent.sensor.see(fitted);
        }
    }
}
