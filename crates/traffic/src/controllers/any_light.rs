//! A policy for any light as a controller: every few seconds it scores the greens of each light.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;

use super::arguments::Arguments;
use super::intersections::Intersections;
use super::{ANY_LIGHT, FILE, LightController};
use crate::agents::plan::AgentPlan;
use crate::any_light::AnyLight;
use crate::lane_sets::{self, LaneSets, Seen, SinceGreen};
use dials_core::base::{AgentId, Dice, RandomPurpose, Rows, Seed};
use dials_core::domain::sampling::{self, Selection};
use dials_core::outside::Printable;
use stacknets::Stack;

/// Largest number of lights that a warning names.
const MOST_NAMES: usize = 5;

pub(super) struct AnyLightController {
    network: Stack,
    /// Seconds from one decision to the next. All lights decide together.
    every: u32,
    selection: Selection,
    longest_red: Option<u32>,
    /// What of each light never changes.
    sets: Vec<LaneSets>,
    since: Vec<SinceGreen>,
    /// The green that each light wants until the next decision.
    wanted: Vec<usize>,
    dice: Vec<Dice>,
    second: u32,
}

/// Returns those of the allowed greens that serve the lane where cars have stood at red for longest, if that is `longest_red` seconds
/// and one of them does.
fn for_the_overdue(
    longest_red: Option<u32>,
    since: &SinceGreen,
    intersections: &Intersections<'_>,
    row: usize,
    allowed: Vec<bool>,
) -> Vec<bool> {
    let (Some(longest_red), plan) = (longest_red, &intersections.plans[row]) else { return allowed };
    let cars = intersections.approaches.at(row);
    let red =
        |lane: usize| (0..plan.greens()).filter(|&green| plan.serves(green, lane)).map(|green| since.of(green)).min();
    let waiting = (0..plan.region.approaches.len()).filter(|&lane| cars.lane(lane).halting() > 0);
    let overdue =
        waiting.filter_map(|lane| Some((red(lane)?, lane))).max().filter(|(seconds, _)| *seconds >= longest_red);
    let Some((_, lane)) = overdue else { return allowed };
    let serving: Vec<bool> =
        allowed.iter().enumerate().map(|(green, &is_allowed)| is_allowed && plan.serves(green, lane)).collect();
    if serving.contains(&true) { serving } else { allowed }
}

/// What the parameters say.
#[derive(Clone)]
pub(super) struct Choices {
    model: Arc<AnyLight>,
    every: u32,
    selection: Selection,
    /// Seconds of red after which a lane where cars stand comes next. `None`: the network alone decides.
    longest_red: Option<u32>,
}

impl Choices {
    pub(super) fn of(arguments: &mut Arguments<'_>) -> Result<Choices> {
        let model = match arguments.take(FILE)? {
            Some(file) => AnyLight::read(Path::new(file))?,
            None => AnyLight::shipped()?,
        };
        let selection = match arguments.take("choice")? {
            None | Some("sampled") => Selection::Sampled,
            Some("greedy") => Selection::Greedy,
            Some(other) => {
                return Err(arguments.refuse(format!("choice = {other}: must be sampled or greedy")));
            }
        };
        let every = arguments.steps("every")?.unwrap_or(model.decision_s());
        let longest_red = arguments.steps("longest-red")?;
        Ok(Choices { model: Arc::new(model), every, selection, longest_red })
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
            sets,
            since: Vec::new(),
            wanted: Vec::new(),
            dice: Vec::new(),
            second: 0,
        }
    }
}

impl LightController for AnyLightController {
    fn begin(&mut self, episode: Seed) {
        let agents = AgentId::all(self.sets.len());
        self.dice = episode.fork(RandomPurpose::Acting).for_agents(&agents).collect();
        self.since.clear();
        self.second = 0;
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        if self.second == 0 {
            self.since = intersections.plans.iter().map(|plan| SinceGreen::begin(plan.greens())).collect();
        } else {
            self.since.iter_mut().zip(intersections.shown).for_each(|(since, &shown)| since.note(shown));
        }
        if self.second.is_multiple_of(self.every) {
            self.wanted = self.decide(intersections);
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
            let seen = Seen { cars, exits, shown, shown_steps, since: &self.since[row] };
            self.sets[row].observe(plan, &seen, obs.row_mut(row));
        }
        let scores = self.network.step(&obs, &mut self.network.states(lights));
        let mut log_probs = Vec::new();
        let choose = |(row, (scores, dice)): (usize, (&[f32], &mut Dice))| {
            let greens = intersections.plans[row].greens();
            let allowed: Vec<bool> = (0..greens).map(|green| intersections.allows(row, green)).collect();
            let allowed = for_the_overdue(self.longest_red, &self.since[row], intersections, row, allowed);
            let mut scores = scores[..greens].to_vec();
            sampling::forbid(&mut scores, &allowed);
            log_probs.resize(greens, 0.0);
            sampling::log_softmax(&scores, &mut log_probs);
            usize::from(self.selection.choose(&log_probs, dice))
        };
        scores.iter().zip(&mut self.dice).enumerate().map(choose).collect()
    }
}
