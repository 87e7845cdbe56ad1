//! Hand-coded controllers of traffic lights: baselines for policies, and control of the lights around the agents.
//!
//! All but SUMO's own programs are [`LightController`]s. They live in the GS and see its
//! [`Intersections`], which is more than a policy observes. They say which green each light should show. Their lights
//! obey the same rules as those of policies, so yellow comes before it.
//!
//! To add one, implement the trait, or write a function of one [`Intersection`] and wrap it in [`Each`]. Then give it a
//! name in [`recipe`] and [`NAMES`]. A program of its own needs no name: it passes its controller to
//! [`crate::Traffic::global`].
//!
//! - `control`: the trait of controllers; [`intersections`]: what a controller sees.
//! - `simple`: lights that do not look at the traffic. `responsive`, `max_pressure`: lights that do.
//! - `clock`, `webster`: lights that go by the clock; [`actuated`]: the programs of SUMO's actuated lights.
//! - [`timing_file`]: files of the tuner; [`search`]: its search for the best timings.
//! - `arguments`: the text that names a controller. `examples`: lights made by hand, for tests.

pub(crate) mod actuated;
mod arguments;
mod clock;
mod control;
#[cfg(test)]
pub(crate) mod examples;
pub(crate) mod intersections;
mod max_pressure;
mod responsive;
pub(crate) mod search;
mod simple;
pub mod timing_file;
mod webster;

use std::path::Path;

use anyhow::{Result, bail};

use crate::Traffic;
use crate::agents::phase_plan::Choice;
use crate::agents::plan::AgentPlan;
use arguments::Arguments;
use dials_core::base::Seed;
use responsive::GreenLimits;
use simple::{Random, SwitchEvery};

pub(crate) use clock::{ClockLights, ClockPlan, Leeway};
pub(crate) use control::ask;
pub use control::{Each, HandCoded, LightController};
pub use intersections::{Intersection, Intersections};
pub(crate) use webster::Webster;

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
    "longest-queue",
];

/// Name of the lights that follow their own programs.
pub(crate) const PROGRAM: &str = "program";
/// Name of the lights that follow a clock whatever the traffic.
pub const FIXED_TIME: &str = "fixed-time";
/// Name of the lights that follow a clock with some leeway.
pub const COORDINATED: &str = "coordinated";

const SWITCH_EVERY: &str = "switch-every-";
/// Parameter that names a file of the tuner.
const FILE: &str = "file";

/// A function that makes a controller. It first measures what the controller needs to know, on simulators of its own.
pub type Recipe = Box<dyn Fn(&Traffic) -> Result<HandCoded>>;

/// Returns the controller of these lights that a text names, with parameters: `max-pressure:min-green=5`. Errors: an
/// unknown name (the error lists the known ones) and an unknown parameter (it lists those of the controller).
pub fn recipe(text: &str, plans: &[AgentPlan]) -> Result<Recipe> {
    let mut arguments = Arguments::of(text);
    let recipe: Recipe = match arguments.name() {
        "random" => Box::new(|_| Ok(HandCoded::rule(Random::new(Seed::new(0))))),
        "never" => Box::new(|_| Ok(HandCoded::rule(Each(|at: &Intersection<'_>| at.target())))),
        "always" => Box::new(|_| Ok(HandCoded::rule(SwitchEvery::new(1)))),
        PROGRAM => Box::new(|_| Ok(HandCoded::OwnProgram)),
        "actuated" => Box::new(|_| Ok(HandCoded::Actuated)),
        "gap-out" => each(responsive::gap_out, GreenLimits::longest(&mut arguments, plans)?),
        "max-pressure" => each(max_pressure::decide, GreenLimits::of(&mut arguments, plans)?),
        "longest-queue" => each(responsive::longest_queue, GreenLimits::of(&mut arguments, plans)?),
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
            Some(Ok(steps)) if steps >= 1 => Box::new(move |_| Ok(HandCoded::rule(SwitchEvery::new(steps)))),
            Some(_) => bail!("controller `{text}`: K must be a number of steps, at least 1, as in {SWITCH_EVERY}10"),
            None => bail!("controller `{text}`: unknown; one of {}", NAMES.join(", ")),
        },
    };
    arguments.all_taken()?;
    Ok(recipe)
}

fn each(decide: fn(&Intersection<'_>, GreenLimits) -> usize, limits: GreenLimits) -> Recipe {
    Box::new(move |_| Ok(HandCoded::rule(Each(move |at: &Intersection<'_>| decide(at, limits)))))
}

fn by_the_clock(plan: ClockPlan) -> Recipe {
    Box::new(move |_| Ok(HandCoded::rule(ClockLights::new(plan.clone()))))
}

/// Returns the file that a controller reads, by the text that names the controller. If it reads none: `None`.
pub(crate) fn file_of(text: &str) -> Result<Option<&Path>> {
    let mut arguments = Arguments::of(text);
    let reads_one = [FIXED_TIME, COORDINATED].contains(&arguments.name());
    if reads_one { Ok(arguments.take(FILE)?.map(Path::new)) } else { Ok(None) }
}

/// Returns whether all lights are those of the paper's grids: green 0 for the cars from south and north, green 1 for the
/// others. Lights of other nets choose their green.
pub(crate) fn are_of_a_grid(plans: &[AgentPlan]) -> bool {
    plans.iter().all(|plan| plan.phases.choice() == Choice::KeepOrSwitch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use examples::{crossing, middle};

    fn error(name: &str) -> String {
        recipe(name, &[middle()]).err().unwrap_or_else(|| panic!("{name} is taken")).to_string()
    }

    #[test]
    fn unknown_names_get_the_list_and_bad_numbers_the_reason() {
        let list = "unknown; one of random, never, always, switch-every-K, program, actuated, gap-out";
        assert!(error("fixed").contains(list), "{}", error("fixed"));
        for name in ["switch-every-0", "switch-every-", "switch-every-ten"] {
            assert!(error(name).contains("K must be a number of steps"));
        }
    }

    #[test]
    fn only_lights_that_go_by_the_clock_read_a_file() {
        let file = |text: &'static str| file_of(text).unwrap().map(|path| path.to_str().unwrap());
        assert_eq!(file("fixed-time:file=a/b.toml"), Some("a/b.toml"));
        assert_eq!(file("coordinated:file=c"), Some("c"));
        assert_eq!([file("fixed-time"), file("fixed-time:green=7"), file("random:file=a")], [None; 3]);
    }

    #[test]
    fn parameters_that_a_controller_does_not_have_get_the_list_too() {
        for (text, why) in [
            ("max-pressure:green=5", "has no parameter `green`; it takes min-green, max-green"),
            ("gap-out:green=5", "has no parameter `green`; it takes max-green"),
            ("longest-queue:min-green=0", "min-green = 0: must be a whole number from 1 to 3600"),
            ("fixed-time:green", "`green` is not a parameter; write key=value"),
            ("max-pressure:min-green=20,max-green=10", "min-green = 20: must be at most max-green, 10"),
            ("max-pressure:min-green=5,min-green=6", "min-green is given twice"),
        ] {
            assert_eq!(error(text), format!("controller `{text}`: {why}"));
        }
    }

    #[test]
    fn every_name_of_the_list_is_taken() {
        for name in NAMES {
            let name = name.replace('K', "10");
            assert!(recipe(&name, &[middle()]).is_ok() && recipe(&name, &[crossing()]).is_ok(), "{name}");
        }
    }
}
