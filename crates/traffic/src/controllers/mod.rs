//! Hand-coded controllers of traffic lights: baselines for policies, and control of the lights around the agents.
//!
//! All but SUMO's own programs are [`LightController`]s. They live in the GS and see its [`Intersections`], which is
//! more than a policy observes. They say which green each light should show; yellow comes before it by itself.
//!
//! To add one, implement the trait, or write a function of one [`Intersection`] and wrap it in [`Each`]. Then give it a
//! name in [`recipe`] and [`NAMES`]. A program of its own needs no name: it passes its controller to
//! [`crate::Traffic::global`].
//!
//! - [`intersections`]: what a controller sees. `responsive`, `max_pressure`, `max_wave`: lights that look at the
//!   traffic. `any_light`: a policy that was trained on many lights.
//! - `clock`, `webster`: lights that go by the clock; [`actuated`]: the programs of SUMO's actuated lights.
//! - [`plan_file`]: plans that `plan` has written, which SUMO plays.
//! - [`timing_file`]: files of the tuner; [`search`]: its search for the best timings.
//! - `arguments`: the text that names a controller. `examples`: lights made by hand, for tests.

pub(crate) mod actuated;
mod any_light;
mod arguments;
mod clock;
#[cfg(test)]
pub(crate) mod examples;
pub(crate) mod intersections;
mod max_pressure;
mod max_wave;
pub mod plan_file;
mod responsive;
pub(crate) mod search;
pub mod timing_file;
pub(crate) mod webster;

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use rand::Rng;

use crate::Traffic;
use crate::agents::phase_plan::Choice;
use crate::agents::plan::AgentPlan;
use crate::any_light::AnyLight;
use arguments::Arguments;
pub(crate) use arguments::split;
use dials_core::base::{Dice, RandomPurpose, Seed};
use dials_core::domain::Action;
use dials_core::outside::did_you_mean;
use max_wave::MaxWave;
use responsive::GreenLimits;
use timing_file::TimingFile;

pub(crate) use clock::{ClockLights, ClockPlan, Leeway, Timing};
pub use intersections::{Intersection, Intersections};
pub(crate) use webster::Webster;

pub trait LightController {
    /// Begins an episode. Everything random in the decisions follows from `episode`.
    fn begin(&mut self, _episode: Seed) {}

    /// Sets the green that each light should show: one index per intersection. Each target comes as the green that is
    /// shown or comes next, so a target that is left alone keeps the light. Targets between greens have no effect.
    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]);

    /// Returns whether it looks at the cars within the junctions and at the persons at crossings when it acts next.
    fn looks_closely(&self) -> bool {
        false
    }
}

/// A rule that every intersection follows on its own. It returns the green that the light should show.
pub struct Each<F: FnMut(&Intersection<'_>) -> usize>(pub F);

impl<F: FnMut(&Intersection<'_>) -> usize> LightController for Each<F> {
    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        targets.iter_mut().zip(intersections.iter()).for_each(|(target, at)| *target = (self.0)(&at));
    }
}

/// Writes the action for each light by which it goes where the controller wants it.
pub(crate) fn ask(controller: &mut dyn LightController, intersections: &Intersections<'_>, actions: &mut [Action]) {
    let mut targets: Vec<usize> = intersections.shown.iter().map(|shown| shown.target()).collect();
    controller.act(intersections, &mut targets);
    let lights = intersections.plans.iter().zip(intersections.shown);
    for ((action, target), (plan, &shown)) in actions.iter_mut().zip(targets).zip(lights) {
        let greens = plan.greens();
        assert!(target < greens, "a controller wants green {target} of light {}, which has {greens}", plan.light);
        *action = plan.phases.towards(shown, target);
    }
}

pub enum HandCoded {
    /// The program of each light in its net.
    OwnProgram,
    Actuated,
    /// Programs that SUMO loads last: the text of an additional file.
    Programs(Arc<str>),
    Rule(Box<dyn LightController>),
}

impl HandCoded {
    pub fn rule(controller: impl LightController + 'static) -> HandCoded {
        HandCoded::Rule(Box::new(controller))
    }
}

/// Names that [`recipe`] takes; K is a number of steps.
pub const NAMES: &[&str] = &[
    "random",
    "never",
    "always",
    "switch-every-K",
    PROGRAM,
    "actuated",
    "gap-out",
    FIXED_TIME,
    COORDINATED,
    "webster",
    "max-pressure",
    "max-wave",
    "longest-queue",
    ANY_LIGHT,
    PLAN,
];

pub const PROGRAM: &str = "program";
pub const FIXED_TIME: &str = "fixed-time";
pub const COORDINATED: &str = "coordinated";
pub const ANY_LIGHT: &str = "any-light";
pub const PLAN: &str = "plan";

const SWITCH_EVERY: &str = "switch-every-";
const FILE: &str = "file";

/// A function that makes a controller. It first measures what the controller needs to know, on simulators of its own.
pub(crate) type Recipe = Box<dyn Fn(&Traffic) -> Result<HandCoded>>;

/// Returns the controller of these lights that a text names, with parameters: `max-pressure:min-green=5`. Errors: an
/// unknown name (the error lists the known ones) and an unknown parameter (it lists those of the controller).
pub fn recipe(text: &str, plans: &[AgentPlan]) -> Result<Recipe> {
    let mut arguments = Arguments::of(text);
    let recipe: Recipe = match arguments.name {
        "random" => Box::new(|_| Ok(HandCoded::rule(Random::new(Seed::new(0))))),
        "never" => Box::new(|_| Ok(HandCoded::rule(Each(|at: &Intersection<'_>| at.target())))),
        "always" => Box::new(|_| Ok(HandCoded::rule(SwitchEvery { steps: 1, step: 0 }))),
        PROGRAM => Box::new(|_| Ok(HandCoded::OwnProgram)),
        "actuated" => Box::new(|_| Ok(HandCoded::Actuated)),
        "gap-out" => each(responsive::gap_out, GreenLimits::longest(&mut arguments, plans)?),
        "max-pressure" => each(max_pressure::decide, GreenLimits::of(&mut arguments, plans)?),
        "max-wave" => {
            let every = max_wave::every(&mut arguments)?;
            Box::new(move |_| Ok(HandCoded::rule(MaxWave::new(every))))
        }
        "longest-queue" => each(responsive::longest_queue, GreenLimits::of(&mut arguments, plans)?),
        ANY_LIGHT => {
            let choices = any_light::Choices::of(&mut arguments)?;
            Box::new(move |traffic| Ok(HandCoded::rule(choices.controller(traffic.plans()))))
        }
        PLAN => {
            let programs = plan_file::programs(&mut arguments, plans)?;
            Box::new(move |_| Ok(HandCoded::Programs(programs.clone())))
        }
        FIXED_TIME => by_the_clock(arguments::fixed_time(&mut arguments, plans)?),
        COORDINATED => by_the_clock(arguments::coordinated(&mut arguments, plans)?),
        "webster" => {
            let webster = Webster::of(&mut arguments)?;
            Box::new(move |traffic| {
                let timings = webster.timings(traffic)?;
                Ok(HandCoded::rule(ClockLights::new(ClockPlan::fixed(timings))))
            })
        }
        name => match name.strip_prefix(SWITCH_EVERY).map(str::parse::<usize>) {
            Some(Ok(steps)) if steps >= 1 => Box::new(move |_| Ok(HandCoded::rule(SwitchEvery { steps, step: 0 }))),
            Some(_) => bail!("controller `{text}`: K must be a number of steps, at least 1, as in {SWITCH_EVERY}10"),
            None => bail!("{}", unknown(text, name)),
        },
    };
    arguments.all_taken()?;
    Ok(recipe)
}

/// Returns what somebody should know who plays the controller of this text at these lights, a sentence each.
pub(crate) fn warnings(text: &str, plans: &[AgentPlan]) -> Result<Vec<String>> {
    let mut arguments = Arguments::of(text);
    if arguments.name != ANY_LIGHT {
        return Ok(Vec::new());
    }
    Ok(any_light::Choices::of(&mut arguments)?.warning(plans).into_iter().collect())
}

/// Returns an error if a text names no controller. It needs no lights, so parameters are not checked.
pub fn check_name(text: &str) -> Result<()> {
    let Arguments { name, .. } = Arguments::of(text);
    let is_known = NAMES.contains(&name) || name.starts_with(SWITCH_EVERY);
    ensure!(is_known, "{}", unknown(text, name));
    Ok(())
}

fn unknown(text: &str, name: &str) -> String {
    let near = did_you_mean(name, NAMES.iter().copied());
    format!("controller `{text}`: unknown{near}; one of {}", NAMES.join(", "))
}

/// A controller whose timings are known before an episode begins, so that SUMO can play them.
pub(crate) enum Timed {
    Timings(Vec<Timing>),
    Webster(Webster),
    /// One cycle for all lights, and offsets that suit the traffic.
    Coordinated,
}

/// Returns what a text names. `None`: a controller that looks at the traffic. Errors: those of [`recipe`].
pub(crate) fn timed(text: &str, plans: &[AgentPlan]) -> Result<Option<Timed>> {
    let mut arguments = Arguments::of(text);
    let timed = match arguments.name {
        COORDINATED if text == COORDINATED && !are_of_a_grid(plans) => Timed::Coordinated,
        FIXED_TIME => Timed::Timings(arguments::fixed_time(&mut arguments, plans)?.timings),
        COORDINATED => Timed::Timings(arguments::coordinated(&mut arguments, plans)?.timings),
        "webster" => Timed::Webster(Webster::of(&mut arguments)?),
        _ => return recipe(text, plans).map(|_| None),
    };
    arguments.all_taken()?;
    Ok(Some(timed))
}

fn each(decide: fn(&Intersection<'_>, GreenLimits) -> usize, limits: GreenLimits) -> Recipe {
    Box::new(move |_| Ok(HandCoded::rule(Each(move |at: &Intersection<'_>| decide(at, limits)))))
}

fn by_the_clock(plan: ClockPlan) -> Recipe {
    Box::new(move |_| Ok(HandCoded::rule(ClockLights::new(plan.clone()))))
}

/// Returns the CRC-32 of the file that a controller reads. If it reads none: `None`.
pub(crate) fn checksum(text: &str) -> Result<Option<u32>> {
    let checksum = match Arguments::of(text).name {
        ANY_LIGHT => AnyLight::checksum,
        PLAN => plan_file::checksum,
        _ => TimingFile::checksum,
    };
    file_of(text)?.map(checksum).transpose()
}

/// Returns the name of a controller that plays a policy for any light. `file`: its file.
pub fn any_light_of(file: &Path, greedy: bool) -> Result<String> {
    let choice = if greedy { ",choice=greedy" } else { "" };
    Ok(with_file(ANY_LIGHT, file)? + choice)
}

/// Returns the name of a controller with its file. Errors: the path cannot stand in a name.
fn with_file(name: &str, file: &Path) -> Result<String> {
    let path = file.to_str().filter(|path| !path.contains(','));
    let why = || format!("{}: rename it: a name of a controller has no commas, and is UTF-8", file.display());
    Ok(format!("{name}:{FILE}={}", path.with_context(why)?))
}

/// Returns the file that a controller reads, by the text that names the controller. If it reads none: `None`.
pub(crate) fn file_of(text: &str) -> Result<Option<&Path>> {
    let mut arguments = Arguments::of(text);
    let reads_one = [FIXED_TIME, COORDINATED, ANY_LIGHT, PLAN].contains(&arguments.name);
    if reads_one { Ok(arguments.take(FILE)?.map(Path::new)) } else { Ok(None) }
}

/// Returns whether all lights are those of the paper's grids: green 0 for the cars from south and north, green 1 for the
/// others. Lights of other nets choose their green.
pub(crate) fn are_of_a_grid(plans: &[AgentPlan]) -> bool {
    plans.iter().all(|plan| plan.phases.choice() == Choice::KeepOrSwitch)
}

/// Leaves its green with probability one half, for each light and step. All other greens are equally likely.
struct Random {
    dice: Dice,
}

impl Random {
    fn new(episode: Seed) -> Random {
        Random { dice: episode.fork(RandomPurpose::Acting).dice() }
    }
}

impl LightController for Random {
    fn begin(&mut self, episode: Seed) {
        *self = Random::new(episode);
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        for (target, at) in targets.iter_mut().zip(intersections.iter()) {
            if self.dice.random::<bool>() {
                let others = at.plan().greens() - 1;
                let steps = if others == 1 { 1 } else { self.dice.random_range(1..=others) };
                *target = (*target + steps) % (others + 1);
            }
        }
    }
}

/// Sends all lights to their next green at every K-th step: some steps of yellow, the rest of green (at least one).
struct SwitchEvery {
    steps: usize,
    step: usize,
}

impl LightController for SwitchEvery {
    fn begin(&mut self, _episode: Seed) {
        self.step = 0;
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        self.step += 1;
        if self.step.is_multiple_of(self.steps) {
            targets.iter_mut().zip(intersections.plans).for_each(|(target, plan)| *target = plan.phases.next(*target));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use examples::{crossing, middle};

    #[test]
    fn only_lights_that_go_by_the_clock_read_a_file() {
        let file = |text: &'static str| file_of(text).unwrap().map(|path| path.to_str().unwrap());
        assert_eq!(file("fixed-time:file=a/b.toml"), Some("a/b.toml"));
        assert_eq!(file("coordinated:file=c"), Some("c"));
        assert_eq!([file("fixed-time"), file("fixed-time:green=7"), file("random:file=a")], [None; 3]);
    }

    #[test]
    fn bad_numbers_and_parameters_that_a_controller_does_not_have_get_the_reason() {
        for (text, why) in [
            ("switch-every-0", "K must be a number of steps, at least 1, as in switch-every-10"),
            ("switch-every-", "K must be a number of steps, at least 1, as in switch-every-10"),
            ("max-pressure:green=5", "has no parameter `green`; it takes min-green, max-green"),
            ("longest-queue:min-green=0", "min-green = 0: must be a whole number from 1 to 3600"),
            ("fixed-time:green", "`green` is not a parameter; write key=value"),
            ("max-pressure:min-green=20,max-green=10", "min-green = 20: must be at most max-green, 10"),
            ("max-pressure:min-green=5,min-green=6", "min-green is given twice"),
        ] {
            let error = recipe(text, &[middle()]).err().unwrap_or_else(|| panic!("{text} is taken"));
            assert_eq!(error.to_string(), format!("controller `{text}`: {why}"));
        }
    }

    #[test]
    fn every_name_of_the_list_is_taken() {
        for name in NAMES.iter().filter(|&&name| name != PLAN) {
            let name = name.replace('K', "10");
            assert!(recipe(&name, &[middle()]).is_ok() && recipe(&name, &[crossing()]).is_ok(), "{name}");
        }
    }
}
