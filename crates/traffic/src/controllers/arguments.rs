//! The text that names a controller: `name:key=value,key=value`. Its part about the clock: greens, cycle and offsets, or a
//! file of the tuner. Also what that and the tuner share: steps divided by shares, and a checkerboard of lights.

use std::collections::{HashMap, VecDeque};
use std::ops::RangeInclusive;
use std::path::Path;
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};

use super::are_of_a_grid;
use super::clock::{ClockPlan, Leeway, Timing};
use super::timing_file::TimingFile;
use crate::agents::plan::AgentPlan;
use dials_core::outside::Printable;

pub(super) const GREENS: RangeInclusive<u32> = 1..=3600;

/// A controller's name with its parameters. The controller takes the parameters one by one.
pub(crate) struct Arguments<'a> {
    text: &'a str,
    pub(super) name: &'a str,
    /// Parameters that are not taken yet, as they were written.
    left: Vec<&'a str>,
    known: Vec<&'static str>,
}

impl<'a> Arguments<'a> {
    pub(crate) fn of(text: &'a str) -> Self {
        let (name, parameters) = text.split_once(':').unwrap_or((text, ""));
        let left = parameters.split(',').filter(|parameter| !parameter.is_empty()).collect();
        Arguments { text, name, left, known: Vec::new() }
    }

    pub(crate) fn take(&mut self, key: &'static str) -> Result<Option<&'a str>> {
        self.known.push(key);
        let value = |parameter: &&'a str| parameter.split_once('=').filter(|&(name, _)| name == key);
        let values: Vec<&str> = self.left.iter().filter_map(value).map(|(_, value)| value).collect();
        ensure!(values.len() <= 1, "controller `{}`: {key} is given twice", self.text);
        self.left.retain(|parameter| value(parameter).is_none());
        Ok(values.first().copied())
    }

    /// Returns a number of steps within [`GREENS`]; `None` if it was not given.
    pub(crate) fn steps(&mut self, key: &'static str) -> Result<Option<u32>> {
        self.number(key, "a whole number from 1 to 3600", |steps| GREENS.contains(steps))
    }

    /// Returns a number of steps by which a light may leave its clock; `None` if it was not given.
    pub(crate) fn leeway(&mut self, key: &'static str) -> Result<Option<u32>> {
        self.number(key, "a whole number from 0 to 60", |&steps| steps <= Leeway::MOST)
    }

    /// Returns a number that is `good`; `what` says in the error which numbers are.
    pub(crate) fn number<T: FromStr>(
        &mut self,
        key: &'static str,
        what: &str,
        good: impl Fn(&T) -> bool,
    ) -> Result<Option<T>> {
        let Some(text) = self.take(key)? else { return Ok(None) };
        let number = text.parse().ok().filter(good);
        number.map(Some).with_context(|| format!("controller `{}`: {key} = {text}: must be {what}", self.text))
    }

    pub(crate) fn refuse(&self, why: impl std::fmt::Display) -> anyhow::Error {
        anyhow::anyhow!("controller `{}`: {why}", self.text)
    }

    pub(crate) fn all_taken(&self) -> Result<()> {
        let Some(parameter) = self.left.first() else { return Ok(()) };
        let known = if self.known.is_empty() { "none".to_owned() } else { self.known.join(", ") };
        match parameter.split_once('=') {
            Some((key, _)) => bail!(self.refuse(format!("has no parameter `{key}`; it takes {known}"))),
            None => bail!(self.refuse(format!("`{parameter}` is not a parameter; write key=value"))),
        }
    }
}

/// Steps of green if the parameters do not say, for lights of the paper's grids and for others.
const GREEN_OF_A_GRID: u32 = 10;
const GREEN: u32 = 20;

/// Returns what fixed-time lights follow: [`clock`] without leeway, or a `file` that the tuner wrote.
pub(super) fn fixed_time(arguments: &mut Arguments<'_>, plans: &[AgentPlan]) -> Result<ClockPlan> {
    if let Some(file) = arguments.take(super::FILE)? {
        return TimingFile::plan(Path::new(file), super::FIXED_TIME, plans);
    }
    Ok(ClockPlan::fixed(clock(arguments, plans, "none")?))
}

/// Returns what coordinated lights follow: [`clock`], but neighbours half a cycle apart if the parameters do not say
/// otherwise; `early` and `late`, steps of leeway. A `file` of the tuner has all of them.
pub(super) fn coordinated(arguments: &mut Arguments<'_>, plans: &[AgentPlan]) -> Result<ClockPlan> {
    if let Some(file) = arguments.take(super::FILE)? {
        return TimingFile::plan(Path::new(file), super::COORDINATED, plans);
    }
    let timings = clock(arguments, plans, "checkerboard")?;
    let leeway = Leeway::default();
    let early = arguments.leeway("early")?.unwrap_or(leeway.early);
    let late = arguments.leeway("late")?.unwrap_or(leeway.late);
    Ok(ClockPlan { timings, leeway: Leeway { early, late } })
}

/// Returns the timings of all lights with equal greens, if the parameters do not say otherwise.
pub(super) fn usual(plans: &[AgentPlan]) -> Vec<Timing> {
    clock(&mut Arguments::of(""), plans, "none").expect("the defaults suit every light")
}

/// Returns the timings for the parameters; `usual`: the offsets, if they do not say.
///
/// - `green`: steps of every green. A grid also takes `vertical` and `horizontal`.
/// - Other nets take `greens`, one number per green such as `20-0-10`, where 0 leaves a green out, and `cycle`. All
///   lights must then have as many greens, and a cycle keeps the greens' shares.
/// - `offsets`: `none`, `checkerboard` (half a cycle for every other intersection) or one per agent, such as
///   `0-13-13-0`.
fn clock(arguments: &mut Arguments<'_>, plans: &[AgentPlan], usual: &'static str) -> Result<Vec<Timing>> {
    let timings = if are_of_a_grid(plans) {
        let green = arguments.steps("green")?.unwrap_or(GREEN_OF_A_GRID);
        let greens = [arguments.steps("vertical")?.unwrap_or(green), arguments.steps("horizontal")?.unwrap_or(green)];
        plans.iter().map(|plan| Timing::new(&plan.phases, &greens, 0)).collect()
    } else {
        let green = arguments.steps("green")?.unwrap_or(GREEN);
        let greens = arguments.take("greens")?.map(|text| greens(arguments, plans, text)).transpose()?;
        let cycle = arguments.steps("cycle")?;
        let timing = |plan: &AgentPlan| {
            let greens = greens.clone().unwrap_or_else(|| vec![green; plan.greens()]);
            let greens = plan.phases.fitted(&greens);
            if let Some(why) = plan.phases.misfit(&greens) {
                return Err(arguments.refuse(format!("light {}: {why}", Printable(&plan.light))));
            }
            let timing = Timing::new(&plan.phases, &greens, 0);
            cycle.map_or(Ok(timing.clone()), |cycle| of_cycle(arguments, plan, &timing, cycle))
        };
        plans.iter().map(timing).collect::<Result<Vec<_>>>()?
    };
    let offsets = offsets(arguments, plans, &timings, usual)?;
    Ok(timings.iter().zip(offsets).map(|(timing, offset)| timing.shifted(offset)).collect())
}

fn greens(arguments: &Arguments<'_>, plans: &[AgentPlan], text: &str) -> Result<Vec<u32>> {
    let good = |greens: &Vec<u32>| {
        let fits = |&steps: &u32| steps == 0 || GREENS.contains(&steps);
        greens.iter().all(fits) && greens.iter().any(|&steps| steps > 0)
    };
    let greens = steps(text).filter(good).ok_or_else(|| {
        arguments.refuse(format!("greens = {text}: must be steps such as 20-10, from 0 to 3600, not all 0"))
    })?;
    if let Some(other) = plans.iter().find(|plan| plan.greens() != greens.len()) {
        let (given, light, has) = (greens.len(), Printable(&other.light), other.greens());
        let why =
            format!("greens = {text}: has {given} numbers, but light {light} has {has} greens; use green or file");
        return Err(arguments.refuse(why));
    }
    Ok(greens)
}

/// Reads steps such as `20-0-10`.
fn steps(text: &str) -> Option<Vec<u32>> {
    text.split('-').map(|steps| steps.parse().ok()).collect()
}

fn of_cycle(arguments: &Arguments<'_>, plan: &AgentPlan, timing: &Timing, cycle: u32) -> Result<Timing> {
    let lost = timing.cycle() - timing.greens().iter().sum::<u32>();
    let shares: Vec<f64> = timing.greens().iter().map(|&steps| f64::from(steps)).collect();
    let least: Vec<u32> = plan.phases.strict_min_steps().iter().map(|&steps| steps.max(1)).collect();
    let greens = cycle.checked_sub(lost).and_then(|green| split(green, &shares, &least)).ok_or_else(|| {
        let shown = least.iter().zip(&shares).filter(|(_, share)| **share > 0.0);
        let least = lost + shown.map(|(least, _)| least).sum::<u32>();
        let light = Printable(&plan.light);
        arguments.refuse(format!("cycle = {cycle}: light {light} needs {least} steps at least"))
    })?;
    if let Some(why) = plan.phases.misfit(&greens) {
        return Err(arguments.refuse(format!("cycle = {cycle}: light {}: {why}", Printable(&plan.light))));
    }
    Ok(Timing::new(&plan.phases, &greens, timing.offset()))
}

fn offsets(arguments: &mut Arguments<'_>, plans: &[AgentPlan], timings: &[Timing], usual: &str) -> Result<Vec<u32>> {
    match arguments.take("offsets")?.unwrap_or(usual) {
        "none" => Ok(vec![0; plans.len()]),
        "checkerboard" => {
            let half = |(is_odd, timing): (bool, &Timing)| if is_odd { timing.cycle() / 2 } else { 0 };
            Ok(every_other(plans).into_iter().zip(timings).map(half).collect())
        }
        list => {
            let why = format!("offsets = {list}: must be none, checkerboard or steps such as 0-13-13-0");
            let offsets = steps(list).ok_or_else(|| arguments.refuse(why))?;
            ensure!(
                offsets.len() == plans.len(),
                arguments.refuse(format!("{} offsets for {} intersections", offsets.len(), plans.len()))
            );
            Ok(offsets)
        }
    }
}

/// Divides steps in proportion to `weights`, which are not negative. Every weight above 0 gets its `least` steps at least,
/// and a weight of 0 gets none. Returns `None` if there are too few steps.
pub(crate) fn split(steps: u32, weights: &[f64], least: &[u32]) -> Option<Vec<u32>> {
    let mut parts: Vec<u32> =
        weights.iter().zip(least).map(|(&weight, &least)| if weight > 0.0 { least } else { 0 }).collect();
    let free = steps.checked_sub(parts.iter().sum()).filter(|_| weights.iter().any(|&weight| weight > 0.0))?;
    let sum: f64 = weights.iter().sum();
    let exact: Vec<f64> = weights.iter().map(|weight| f64::from(steps) * weight / sum).collect();
    // Each step goes where most is missing.
    for _ in 0..free {
        let lack = |part: usize| exact[part] - f64::from(parts[part]);
        let shown = (0..parts.len()).filter(|&part| weights[part] > 0.0);
        let most = shown.max_by(|&one, &other| lack(one).total_cmp(&lack(other)).then(other.cmp(&one)));
        parts[most.expect("some weight is above 0")] += 1;
    }
    Some(parts)
}

/// Returns for each light whether it is an odd number of roads away from the first light that it is joined to. Two
/// lights are joined if an exit of one is an approach of the other.
pub(super) fn every_other(plans: &[AgentPlan]) -> Vec<bool> {
    let joined = joined(plans);
    let mut odd: Vec<Option<bool>> = vec![None; plans.len()];
    for first in 0..plans.len() {
        let mut reached = VecDeque::from([(first, false)]);
        while let Some((light, is_odd)) = reached.pop_front() {
            if odd[light].is_none() {
                odd[light] = Some(is_odd);
                reached.extend(joined[light].iter().map(|&other| (other, !is_odd)));
            }
        }
    }
    odd.into_iter().map(|odd| odd.expect("every light was reached")).collect()
}

fn joined(plans: &[AgentPlan]) -> Vec<Vec<usize>> {
    let mut behind: HashMap<&str, Vec<usize>> = HashMap::new();
    for (light, plan) in plans.iter().enumerate() {
        plan.region.approaches.iter().for_each(|lane| behind.entry(&lane.lane).or_default().push(light));
    }
    let mut joined = vec![Vec::new(); plans.len()];
    for (light, plan) in plans.iter().enumerate() {
        let ahead = plan.region.exits.iter().filter_map(|exit| behind.get(exit.lane.as_str())).flatten();
        for &other in ahead {
            joined[light].push(other);
            joined[other].push(light);
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::{crossing, grid};

    fn on_a_grid(text: &str) -> Result<Vec<Timing>> {
        Ok(fixed_time(&mut Arguments::of(text), &grid(2, 2))?.timings)
    }

    #[test]
    fn bad_timings_are_refused() {
        let error = |text: &str| on_a_grid(text).unwrap_err().to_string();
        assert!(error("fixed-time:green=0").ends_with("green = 0: must be a whole number from 1 to 3600"));
        assert!(error("fixed-time:offsets=left").ends_with("must be none, checkerboard or steps such as 0-13-13-0"));
        assert!(error("fixed-time:offsets=1-2").ends_with("2 offsets for 4 intersections"));
        assert!(error("fixed-time:file=no/such.toml").starts_with("no/such.toml: cannot be read"));
    }

    #[test]
    fn coordinated_lights_take_the_parameters_of_the_clock_and_two_more() {
        let plans = grid(1, 2);
        let asked_for = |text: &str| coordinated(&mut Arguments::of(text), &plans);
        let timing = |green, offset| Timing::new(&plans[0].phases, &[green, green], offset);
        let plan = asked_for("coordinated").unwrap();
        assert_eq!(plan, ClockPlan { timings: vec![timing(10, 0), timing(10, 13)], leeway: Leeway::default() });
        let plan = asked_for("coordinated:green=7,offsets=none,early=0,late=5").unwrap();
        assert_eq!(plan, ClockPlan { timings: vec![timing(7, 0); 2], leeway: Leeway { early: 0, late: 5 } });
        let error = asked_for("coordinated:late=-1").unwrap_err().to_string();
        assert_eq!(error, "controller `coordinated:late=-1`: late = -1: must be a whole number from 0 to 60");
    }

    #[test]
    fn other_lights_take_a_list_of_greens_and_a_cycle() {
        let plans = [crossing()];
        let asked_for = |text: &str| Ok(fixed_time(&mut Arguments::of(text), &plans)?.timings.swap_remove(0));
        let timing = |greens: [u32; 4], offset| Timing::new(&plans[0].phases, &greens, offset);
        assert_eq!(asked_for("fixed-time").unwrap(), timing([20; 4], 0));
        assert_eq!(asked_for("fixed-time:greens=20-0-10-5,offsets=3").unwrap(), timing([20, 0, 10, 5], 3));
        // Two clearings of 4 steps leave 52 - 8 = 44.
        assert_eq!(asked_for("fixed-time:greens=30-0-10-0,cycle=52").unwrap(), timing([33, 0, 11, 0], 0));
        let error = |text: &str| {
            let error: anyhow::Error = asked_for(text).unwrap_err();
            error.to_string().split_once("`: ").expect("the name of the controller comes first").1.to_owned()
        };
        assert_eq!(error("fixed-time:cycle=19"), "cycle = 19: light crossing needs 20 steps at least");
        assert_eq!(
            error("fixed-time:greens=9-9"),
            "greens = 9-9: has 2 numbers, but light crossing has 4 greens; use green or file"
        );
        for bad in ["0-0-0-0", "9-x", "9--9-9", "9-3601-1-1", ""] {
            let error = error(&format!("fixed-time:greens={bad}"));
            assert!(error.ends_with("must be steps such as 20-10, from 0 to 3600, not all 0"), "{error}");
        }
    }

    #[test]
    fn a_grid_becomes_a_checkerboard_and_lights_alone_are_even() {
        assert_eq!(every_other(&grid(2, 3)), [false, true, false, true, false, true]);
        assert_eq!(every_other(&[crossing(), crossing()]), [false, false]);
    }

    #[test]
    fn parts_sum_up_and_follow_the_weights() {
        assert_eq!(split(10, &[1.0, 1.0], &[1; 4]), Some(vec![5, 5]));
        assert_eq!(split(11, &[1.0, 1.0], &[1; 4]), Some(vec![6, 5]));
        assert_eq!(split(70, &[4.0, 0.0, 2.0, 1.0], &[1; 4]), Some(vec![40, 0, 20, 10]));
        assert_eq!(split(10, &[1000.0, 1.0], &[1; 4]), Some(vec![9, 1]), "one step at least");
        assert_eq!(split(20, &[8.0, 1.0, 1.0], &[5; 4]), Some(vec![10, 5, 5]));
        assert_eq!(split(2, &[3.0, 0.0, 1.0], &[1; 4]), Some(vec![1, 0, 1]));
        assert_eq!(split(9, &[3.0, 1.0], &[5; 4]), None);
        assert_eq!(split(5, &[0.0], &[1; 4]), None);
    }
}
