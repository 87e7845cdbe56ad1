//! Max-wave: every few seconds the green that serves the most cars, standing or coming.
//!
//! Source: the rule "greedy" of RESCO (Ault and Sharon, "Reinforcement learning benchmarks for traffic signal control",
//! NeurIPS 2021 Datasets and Benchmarks; `agents/maxwave.py`). There a wave is the cars within 200 m of the stop line on
//! the lanes of a movement, and a green counts the waves of its two main movements. Here a green counts the lanes of which it
//! opens a link with priority, each once.

use anyhow::Result;

use super::LightController;
use super::arguments::Arguments;
use super::intersections::{Intersection, Intersections};
use dials_core::base::Seed;

/// Distance before the stop line within which cars count.
const COUNTED_M: f64 = 200.0;
/// Seconds between two decisions, of which the first ones are yellow.
const EVERY: u32 = 10;

pub(super) struct MaxWave {
    every: u32,
    step: u32,
    /// Step at which each light decides next. A light that is between two greens then decides when that is over.
    next: Vec<u32>,
}

/// Returns the seconds between two decisions that the parameters name.
pub(super) fn every(arguments: &mut Arguments<'_>) -> Result<u32> {
    Ok(arguments.steps("every")?.unwrap_or(EVERY))
}

impl MaxWave {
    /// `every`: seconds between two decisions.
    pub(super) fn new(every: u32) -> MaxWave {
        MaxWave { every, step: 0, next: Vec::new() }
    }
}

impl LightController for MaxWave {
    fn begin(&mut self, _episode: Seed) {
        *self = MaxWave::new(self.every);
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        self.next.resize(targets.len(), 0);
        for ((target, next), at) in targets.iter_mut().zip(&mut self.next).zip(intersections.iter()) {
            if let Some(green) = at.green().filter(|_| self.step >= *next) {
                *target = greatest(&at, green);
                *next = self.step + self.every;
            }
        }
        self.step += 1;
    }
}

/// Returns the green with the greatest wave. If several have it: the one that is shown, else the first after it.
fn greatest(at: &Intersection<'_>, shown: usize) -> usize {
    let (mut best, mut most) = (shown, wave(at, shown));
    for other in at.others(shown) {
        let other_wave = wave(at, other);
        if other_wave > most {
            (best, most) = (other, other_wave);
        }
    }
    best
}

/// Returns the number of cars on the lanes that a green serves.
fn wave(at: &Intersection<'_>, green: usize) -> usize {
    let plan = at.plan();
    let has_priority =
        |&approach: &usize| plan.region.approaches[approach].links.iter().any(|&link| plan.serves_best(green, link));
    let cars = |approach| at.speeds_within(approach, COUNTED_M).count();
    plan.served(green).filter(has_priority).map(cars).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::phase_plan::Shown;
    use crate::agents::plan::AgentPlan;
    use crate::controllers::examples::{At, crossing};

    fn shown(plan: &AgentPlan) -> At<'_> {
        At::new(plan, Shown::Green(1))
    }

    #[test]
    fn a_green_counts_all_cars_within_200_m_on_the_lanes_that_it_serves_with_priority() {
        let mut plan = crossing();
        plan.region.approaches[0].length_m = 400.0;
        let at = shown(&plan).cars(0, &[(5.0, 0.0), (199.0, 9.0), (201.0, 9.0)]).queue(1, 4).queue(2, 3).build();
        // Two cars go straight on from the west. Green 3 also lets the four to the left go, but they yield.
        assert_eq!([0, 1, 2, 3].map(|green| wave(&at, green)), [2, 4, 3, 3]);
    }

    #[test]
    fn the_greatest_wave_gets_green_and_a_tie_keeps_it() {
        let plan = crossing();
        let greatest = |at: At<'_>| greatest(&at.build(), 1);
        assert_eq!(greatest(shown(&plan).queue(0, 2).queue(1, 1)), 0);
        assert_eq!(greatest(shown(&plan).queue(0, 2).queue(1, 2)), 1);
        assert_eq!(greatest(shown(&plan).queue(2, 2)), 2, "the first of equals after it");
        assert_eq!(greatest(shown(&plan)), 1, "nobody comes");
    }
}
