//! Coordinated lights: the clock of fixed-time lights, with a little leeway for the cars that are there.
//!
//! The clock lets neighbours work together: with offsets that suit the roads, cars meet green after green. The leeway
//! lets a light use what it sees. It gives an unused green away some steps early, and it holds a green some steps for
//! a car that is almost there. It needs no more than an observation and the time.

use std::path::Path;

use anyhow::Result;

use super::arguments::Arguments;
use super::control::LightController;
use super::fixed_time;
use super::gap_out::has_car_within;
use super::intersections::{Intersection, Intersections};
use super::timing::{ClockPlan, Leeway, Timing};
use super::timing_file::TimingFile;
use crate::base::Seed;
use crate::domain::Action;
use crate::traffic::agents::phases::Light;
use crate::traffic::light::{KEEP, SWITCH};
use crate::traffic::paper_grid::grid::Grid;

/// A green is in use while a car is in one of these cells before its line.
const GREEN_CELLS: usize = 4;
/// A green is wanted when a car is in one of these cells before the red line.
const RED_CELLS: usize = 5;
/// A green is held for a car in one of these cells before its line.
const HELD_CELLS: usize = 3;

/// Lights that follow a clock, each with the same leeway. Every episode begins with vertical green.
pub struct Coordinated {
    plan: ClockPlan,
    step: u32,
}

impl Coordinated {
    pub fn new(plan: ClockPlan) -> Self {
        Coordinated { plan, step: 0 }
    }
}

impl LightController for Coordinated {
    fn begin(&mut self, _episode: Seed) {
        self.step = 0;
    }

    fn act(&mut self, intersections: &Intersections<'_>, actions: &mut [Action]) {
        let ClockPlan { timings, leeway } = &self.plan;
        for ((action, at), timing) in actions.iter_mut().zip(intersections.iter()).zip(timings) {
            *action = decide(&at, *timing, *leeway, self.step);
        }
        self.step += 1;
    }
}

/// Decides for one light at a step of the clock.
fn decide(at: &Intersection<'_>, timing: Timing, leeway: Leeway, step: u32) -> Action {
    let Some([green, red]) = at.green_and_red() else { return KEEP };
    let car_within = |sides: [_; 2], cells| sides.into_iter().any(|side| has_car_within(at.obs(), side, cells));
    let agrees = (at.light() == Light::VerticalGreen) == timing.is_vertical(step);
    if agrees {
        let soon = timing.until_change(step) <= leeway.early;
        let unused = !car_within(green, GREEN_CELLS) && car_within(red, RED_CELLS);
        return if soon && unused { SWITCH } else { KEEP };
    }
    // A light that changed early is ahead of the clock, which will follow.
    if timing.until_change(step) <= leeway.early {
        return KEEP;
    }
    let held = timing.since_change(step) < leeway.late && car_within(green, HELD_CELLS);
    if held { KEEP } else { SWITCH }
}

/// Returns the plan for these parameters: those of [`fixed_time::timings`], but neighbours half a cycle apart if they
/// do not say otherwise; `early` and `late`, steps of leeway. A `file` of the tuner has all of them.
pub fn plan(arguments: &mut Arguments<'_>, grid: Grid) -> Result<ClockPlan> {
    if let Some(file) = arguments.take("file")? {
        return TimingFile::plan(Path::new(file), super::COORDINATED, grid);
    }
    let timings = fixed_time::clock(arguments, grid, "checkerboard")?;
    let leeway = Leeway::default();
    let early = arguments.leeway("early")?.unwrap_or(leeway.early);
    let late = arguments.leeway("late")?.unwrap_or(leeway.late);
    Ok(ClockPlan { timings, leeway: Leeway { early, late } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traffic::agents::region::{CELLS, OCCUPANCY};
    use crate::traffic::controllers::intersections::tests::middle;

    /// Vertical green at steps 0 to 9, horizontal at 13 to 22; the clock changes at 10 and at 23.
    const TIMING: Timing = Timing { vertical: 10, horizontal: 10, offset: 0 };
    const LEEWAY: Leeway = Leeway { early: 3, late: 2 };
    /// Sides of an observation.
    const WEST: usize = 0;
    const SOUTH: usize = 1;

    fn decided(light: Light, step: u32, cars: &[(usize, usize)]) -> Action {
        let mut obs = vec![0.0; OCCUPANCY + 4];
        cars.iter().for_each(|&(edge, cell)| obs[edge * CELLS + cell] = 1.0);
        let at = Intersection { obs: obs.leak(), ..middle(light, 9, [(0, 0); 4], [0; 4]) };
        decide(&at, TIMING, LEEWAY, step)
    }

    #[test]
    fn without_cars_the_clock_alone_decides() {
        assert_eq!([7, 9, 10, 12].map(|step| decided(Light::VerticalGreen, step, &[])), [KEEP, KEEP, SWITCH, SWITCH]);
        let horizontal = [20, 22, 23, 25].map(|step| decided(Light::HorizontalGreen, step, &[]));
        assert_eq!(horizontal, [KEEP, KEEP, SWITCH, SWITCH]);
        assert_eq!(decided(Light::VerticalYellow, 11, &[]), KEEP);
    }

    #[test]
    fn an_unused_green_is_given_away_up_to_three_steps_early() {
        let wanted = [(WEST, 4)];
        let steps = [6, 7, 9].map(|step| decided(Light::VerticalGreen, step, &wanted));
        assert_eq!(steps, [KEEP, SWITCH, SWITCH], "a car 40 to 50 m before red");
        assert_eq!(decided(Light::VerticalGreen, 7, &[(WEST, 5)]), KEEP, "a car further away does not want it yet");
        assert_eq!(decided(Light::VerticalGreen, 7, &[(WEST, 0), (SOUTH, 3)]), KEEP, "a car within 40 m uses it");
        assert_eq!(decided(Light::VerticalGreen, 7, &[(WEST, 0), (SOUTH, 4)]), SWITCH);
        assert_eq!(decided(Light::HorizontalGreen, 8, &[(SOUTH, 0)]), KEEP, "it went ahead and waits for the clock");
    }

    #[test]
    fn a_green_is_held_up_to_two_steps_for_a_car_that_is_almost_there() {
        let near = [(SOUTH, 2), (WEST, 0)];
        assert_eq!([10, 11, 12].map(|step| decided(Light::VerticalGreen, step, &near)), [KEEP, KEEP, SWITCH]);
        assert_eq!(decided(Light::VerticalGreen, 10, &[(SOUTH, 3)]), SWITCH, "30 m away is too far");
    }

    #[test]
    fn its_parameters_are_those_of_the_clock_and_two_more() {
        let asked_for = |text: &str| plan(&mut Arguments::of(text), Grid::new(1, 2).unwrap());
        let timing = |green, offset| Timing { vertical: green, horizontal: green, offset };
        let plan = asked_for("coordinated").unwrap();
        assert_eq!(plan, ClockPlan { timings: vec![timing(10, 0), timing(10, 13)], leeway: LEEWAY });
        let plan = asked_for("coordinated:green=7,offsets=none,early=0,late=5").unwrap();
        assert_eq!(plan, ClockPlan { timings: vec![timing(7, 0); 2], leeway: Leeway { early: 0, late: 5 } });
        let error = asked_for("coordinated:late=-1").unwrap_err().to_string();
        assert_eq!(error, "controller `coordinated:late=-1`: late = -1: must be a whole number from 0 to 60");
    }
}
