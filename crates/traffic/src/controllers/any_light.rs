//! A policy for any light as a controller: every few seconds it scores the greens of each light.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;

use super::arguments::Arguments;
use super::intersections::Intersections;
use super::{ANY_LIGHT, FILE, LightController};
use crate::agents::plan::AgentPlan;
use crate::any_light::AnyLight;
use crate::config::{DETECTORS_ONLY, DetectorFaults, SHARES, may_be_seen};
use crate::lane_sets::{self, Draw, LaneSets, Seen, SinceGreen};
use crate::sim::readings::Readings;
use dials_core::base::{AgentId, Dice, RandomPurpose, Rows, Seed};
use dials_core::domain::sampling::{self, Selection};
use dials_core::outside::Printable;
use stacknets::Stack;

/// Seconds of red after which cars and people come next, if the parameters do not say: about the longest usual cycle.
const LONGEST_RED: u32 = 120;
/// Seconds for which a green stays while several cars stand on a lane that it opens, if the parameters do not say. Short greens lose
/// too much time where too many cars come.
const HOLD: u32 = 30;
/// Largest number of lights that a warning names.
const MOST_NAMES: usize = 5;

pub(super) struct AnyLightController {
    network: Stack,
    /// Seconds from one decision to the next. All lights decide together.
    every: u32,
    selection: Selection,
    longest_red: u32,
    hold: u32,
    /// What of each light never changes.
    sets: Vec<LaneSets>,
    since: Vec<SinceGreen>,
    /// The green that each light wants until the next decision.
    wanted: Vec<usize>,
    dice: Vec<Dice>,
    /// Share of the cars that it sees.
    seen: f64,
    draw: Draw,
    /// What the detectors of each light have seen, if it sees nothing else.
    readings: Vec<Readings>,
    second: u32,
}

/// Keeps those of the `allowed` greens that may come whatever the network says, by what the light observes. A green stays for `hold`
/// seconds while several cars stand on a lane that it opens and nobody waits to walk. Else, those who have stood at red for
/// `longest_red` seconds come next. It changes nothing if none of them may come.
fn keep_to_the_rules(
    allowed: &mut [bool],
    plan: &AgentPlan,
    sets: &LaneSets,
    obs: &[f32],
    [hold, longest_red]: [u32; 2],
) {
    if let Some(green) = sets.still_needed(plan, obs, hold).filter(|&green| allowed[green]) {
        allowed.iter_mut().enumerate().for_each(|(other, is_allowed)| *is_allowed = other == green);
        return;
    }
    let (serving, red_s) = sets.longest_waiting(plan, obs);
    if red_s >= longest_red && allowed.iter().zip(&serving).any(|(&is_allowed, &serves)| is_allowed && serves) {
        allowed.iter_mut().zip(serving).for_each(|(is_allowed, serves)| *is_allowed &= serves);
    }
}

/// What the parameters say.
#[derive(Clone)]
pub(super) struct Choices {
    model: Arc<AnyLight>,
    every: u32,
    selection: Selection,
    /// Seconds of red after which a lane where cars stand, or a crossing with persons, comes next.
    longest_red: u32,
    /// Seconds for which a green stays while several cars stand on a lane that it opens.
    hold: u32,
    /// Share of the cars that it sees.
    seen: f64,
}

impl Choices {
    pub(super) fn of(arguments: &mut Arguments<'_>) -> Result<Choices> {
        let seen = arguments.number("seen", SHARES, |&share| may_be_seen(share))?.unwrap_or(1.0);
        let model = match arguments.take(FILE)? {
            Some(file) => AnyLight::read(Path::new(file))?,
            None if seen == DETECTORS_ONLY => {
                return Err(arguments.refuse(
                    "seen = 0: no policy of this program sees detectors only; train one with traffic.seen_cars = 0, and name its file"
                        .to_owned(),
                ));
            }
            None => AnyLight::shipped(seen < 1.0)?,
        };
        let selection = match arguments.take("choice")? {
            None | Some("sampled") => Selection::Sampled,
            Some("greedy") => Selection::Greedy,
            Some(other) => {
                return Err(arguments.refuse(format!("choice = {other}: must be sampled or greedy")));
            }
        };
        let every = arguments.steps("every")?.unwrap_or(model.decision_s());
        let longest_red = arguments.steps("longest-red")?.unwrap_or(LONGEST_RED);
        let hold = arguments.steps("hold")?.unwrap_or(HOLD);
        Ok(Choices { model: Arc::new(model), every, selection, longest_red, hold, seen })
    }

    /// Returns a sentence about the lights that are unlike all lights of the training, if there are some.
    pub(super) fn warning(&self, plans: &[AgentPlan]) -> Option<String> {
        let unlike = plans.iter().filter_map(|plan| Some((plan, self.model.unlike(plan)?)));
        let unlike: Vec<String> = unlike.map(|(plan, how)| format!("{} ({how})", Printable(&plan.light))).collect();
        let more = unlike.len().saturating_sub(MOST_NAMES);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        (!unlike.is_empty()).then(|| {
            format!(
                "{ANY_LIGHT} was trained on no light like {}{more}: compare its delay there with that of max-pressure",
                unlike[..unlike.len().min(MOST_NAMES)].join(", ")
            )
        })
    }

    /// Makes a controller of these lights.
    pub(super) fn controller(&self, plans: &[AgentPlan]) -> AnyLightController {
        let sets = lane_sets::of_lights(plans, self.model.seen_m());
        let room = sets.first().map_or_else(|| lane_sets::sets(1, 1), |sets| sets.sets);
        AnyLightController {
            network: self.model.network(room),
            every: self.every,
            selection: self.selection,
            longest_red: self.longest_red,
            hold: self.hold,
            sets,
            since: Vec::new(),
            wanted: Vec::new(),
            dice: Vec::new(),
            seen: self.seen,
            draw: Draw::default(),
            readings: Vec::new(),
            second: 0,
        }
    }
}

impl LightController for AnyLightController {
    fn looks_closely(&self) -> bool {
        self.second.is_multiple_of(self.every)
    }

    fn begin(&mut self, episode: Seed) {
        let agents = AgentId::all(self.sets.len());
        self.dice = episode.fork(RandomPurpose::Acting).for_agents(&agents).collect();
        self.draw = Draw::of(episode, self.seen);
        self.since.clear();
        self.readings.clear();
        if self.draw.is_blind() {
            let of_light = |(sets, agent): (&LaneSets, AgentId)| {
                Readings::begin(&sets.loops, DetectorFaults::default(), episode.for_agent(agent))
            };
            self.readings = self.sets.iter().zip(agents).map(of_light).collect();
        }
        self.second = 0;
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        if self.second == 0 {
            self.since = intersections.plans.iter().map(|plan| SinceGreen::begin(plan.greens())).collect();
        } else {
            self.since.iter_mut().zip(intersections.shown).for_each(|(since, &shown)| since.note(shown));
            for (row, (readings, plan)) in self.readings.iter_mut().zip(intersections.plans).enumerate() {
                readings.second(&plan.region, intersections.approaches.at(row));
            }
        }
        if self.second.is_multiple_of(self.every) {
            self.wanted = self.decide(intersections);
            self.readings.iter_mut().for_each(Readings::decide);
        }
        targets.copy_from_slice(&self.wanted);
        self.second += 1;
    }
}

impl AnyLightController {
    /// Returns the green that each light wants.
    fn decide(&mut self, intersections: &Intersections<'_>) -> Vec<usize> {
        let lights = intersections.plans.len();
        let mut obs = Rows::new(lights, self.network.shape().inputs);
        for (row, plan) in intersections.plans.iter().enumerate() {
            let (shown, shown_steps) = (intersections.shown[row], intersections.shown_steps[row]);
            let [cars, exits] = [intersections.approaches, intersections.exits].map(|lanes| lanes.at(row));
            let (since, people) = (&self.since[row], intersections.people.at(row));
            let (draw, readings) = (self.draw, self.readings.get(row));
            let seen = Seen { cars, exits, people, shown, shown_steps, since, draw, readings };
            self.sets[row].observe(plan, &seen, obs.row_mut(row));
        }
        let scores = self.network.step(&obs, &mut self.network.states(lights));
        let mut log_probs = Vec::new();
        let choose = |(row, (scores, dice)): (usize, (&[f32], &mut Dice))| {
            let (plan, shown) = (&intersections.plans[row], intersections.shown[row]);
            let mut allowed: Vec<bool> = (0..plan.greens()).map(|green| intersections.allows(row, green)).collect();
            plan.mind_trapped(intersections.inside.at(row), shown, &mut allowed);
            keep_to_the_rules(&mut allowed, plan, &self.sets[row], obs.row(row), [self.hold, self.longest_red]);
            let mut scores = scores[..plan.greens()].to_vec();
            sampling::forbid(&mut scores, &allowed);
            log_probs.resize(plan.greens(), 0.0);
            sampling::log_softmax(&scores, &mut log_probs);
            usize::from(self.selection.choose(&log_probs, dice))
        };
        scores.iter().zip(&mut self.dice).enumerate().map(choose).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::crossing;

    #[test]
    fn a_lane_that_has_been_red_too_long_comes_next_if_cars_stand_there() {
        let plan = crossing();
        let sets = LaneSets::new(5, 4, 150.0).fitted(&plan, 5, 4);
        let ways = |stand_and_red: &[(usize, u32)], longest_red: u32, mut allowed: [bool; 4]| {
            let mut obs = vec![0.0; sets.columns()];
            for &(lane, red_s) in stand_and_red {
                let features = &mut obs[sets.sets.item(lane)];
                (features[4], features[13]) = (0.1, (red_s as f32).ln_1p() / 5.0);
            }
            keep_to_the_rules(&mut allowed, &plan, &sets, &obs, [30, longest_red]);
            allowed
        };
        let all = [true; 4];
        let serving = |lane: usize| [0, 1, 2, 3].map(|green| plan.serves(green, lane));
        assert_ne!(serving(1), serving(2));
        assert_eq!(ways(&[], 120, all), all, "nobody stands");
        assert_eq!(ways(&[(2, 119)], 120, all), all);
        assert_eq!(ways(&[(2, 120)], 120, all), serving(2));
        assert_eq!(ways(&[(1, 121), (2, 130)], 120, all), serving(2), "the longest one");
        let both = [0, 1, 2, 3].map(|green| plan.serves(green, 1) || plan.serves(green, 2));
        assert_eq!(ways(&[(1, 130), (2, 130)], 120, all), both, "the order of lanes means nothing");
        let others = serving(2).map(|serves| !serves);
        assert_eq!(ways(&[(2, 300)], 120, others), others, "what may not come does not");
    }

    #[test]
    fn a_green_stays_while_a_queue_passes_and_a_long_queue_waits_a_third_of_the_time() {
        let plan = crossing();
        let sets = LaneSets::new(5, 4, 150.0).fitted(&plan, 5, 4);
        let time = |seconds: u32| (seconds as f32).ln_1p() / 5.0;
        // Green 0 opens lane 0, where this many cars stand. They also stand on lane 2, which has been red for some time.
        let with_people = |people: u32, shown_s: u32, [queue, other]: [u32; 2], red_s: u32, mut allowed: [bool; 4]| {
            let mut obs = vec![0.0; sets.columns()];
            let green = &mut obs[sets.sets.choice(0)];
            (green[2], green[3]) = (1.0, time(shown_s));
            obs[sets.sets.item(0)][4] = queue as f32 / 10.0;
            obs[sets.sets.choice(1)][9] = people as f32 / 10.0;
            let lane = &mut obs[sets.sets.item(2)];
            (lane[4], lane[13]) = (other as f32 / 10.0, time(red_s));
            keep_to_the_rules(&mut allowed, &plan, &sets, &obs, [30, 120]);
            allowed
        };
        let left = |shown_s, queues, red_s, allowed| with_people(0, shown_s, queues, red_s, allowed);
        let all = [true; 4];
        let (shown, serving) = ([true, false, false, false], [0, 1, 2, 3].map(|green| plan.serves(green, 2)));
        assert!(plan.serves(0, 0) && !plan.serves(0, 2));
        assert_eq!([29, 30].map(|shown_s| left(shown_s, [3, 1], 200, all)), [shown, serving]);
        assert_eq!(left(29, [2, 1], 200, all), serving, "too few cars");
        assert_eq!(with_people(1, 29, [3, 1], 200, all), serving, "people wait to walk");
        let others = shown.map(|is_shown| !is_shown);
        assert_eq!(left(5, [3, 0], 0, others), others, "it may not stay");
        assert_eq!([40, 39].map(|red_s| left(40, [0, 8], red_s, all)), [serving, all]);
        assert_eq!(left(40, [0, 7], 119, all), all);
    }
}
