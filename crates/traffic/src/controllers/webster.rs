//! Webster's fixed time: cycle and greens from measured flows, for each intersection.
//!
//! Source: Webster, "Traffic signal settings", Road Research Technical Paper 39, 1958. The flow ratio `y` of a green is
//! the flow of its busiest approach over the saturation flow. `Y` is the sum of the flow ratios, and `L` the lost time
//! of a cycle, in which no green is shown. The delay is least near the cycle `C = (1.5 L + 5) / (1 - Y)`. Of it, each
//! green gets `(C - L) y / Y`.

use anyhow::Result;

use super::are_of_a_grid;
use super::arguments::Arguments;
use super::clock_text;
use super::control::{Each, Trials};
use super::fixed_time::FixedTime;
use super::flow_ratios::{FlowRatios, LONGEST_CYCLE_S, flow_ratios};
use super::flows::{self, Flows};
use super::green_limits::GreenLimits;
use super::max_pressure;
use super::timing::Timing;
use crate::agents::plan::AgentPlan;
use crate::controllers::intersections::Intersection;

/// Cars per hour that pass the stop line from a standing queue of the vehicle type of the paper's grids: one in 2.28 s.
const SATURATION_PER_H: f64 = 1580.0;
/// Number of episodes that measure the flows.
const EPISODES: u32 = 5;

/// The measurement that the timings are computed from.
pub(crate) struct TimingPlan {
    episodes: u32,
    saturation_per_h: f64,
}

impl Default for TimingPlan {
    fn default() -> Self {
        TimingPlan { episodes: EPISODES, saturation_per_h: SATURATION_PER_H }
    }
}

impl TimingPlan {
    pub(crate) fn of(arguments: &mut Arguments<'_>) -> Result<TimingPlan> {
        let what = "a number of cars per hour, above 0";
        let saturation = arguments.number("saturation", what, |&flow: &f64| flow > 0.0 && flow.is_finite())?;
        let episodes = arguments.number("episodes", "a whole number, at least 1", |&episodes: &u32| episodes >= 1)?;
        let usual = TimingPlan::default();
        Ok(TimingPlan {
            episodes: episodes.unwrap_or(usual.episodes),
            saturation_per_h: saturation.unwrap_or(usual.saturation_per_h),
        })
    }

    /// Measures the flows on the GS (global simulator), on separate episodes, and computes the timings.
    pub(crate) fn timings(&self, plans: &[AgentPlan], trials: &dyn Trials) -> Result<Vec<Timing>> {
        let ratios = self.ratios(plans, trials)?;
        Ok(plans.iter().zip(&ratios).map(|(plan, ratios)| timing(plan, ratios)).collect())
    }

    /// Measures the flows and returns the flow ratios of the greens of each light.
    pub(crate) fn ratios(&self, plans: &[AgentPlan], trials: &dyn Trials) -> Result<Vec<FlowRatios>> {
        let Flows { cars, seconds } = if are_of_a_grid(plans) {
            flows::measure(plans, trials, self.episodes, FixedTime::new(clock_text::usual(plans)))?
        } else {
            // Lights that jam would hide what wants to pass.
            let limits = GreenLimits::usual(plans);
            let rule = Each(move |at: &Intersection<'_>| max_pressure::decide(at, limits));
            flows::measure(plans, trials, self.episodes, rule)?
        };
        let saturation = self.saturation_per_h / 3600.0 * f64::from(seconds);
        let of_light = |(plan, cars): (&AgentPlan, &[u32])| {
            let ratios: Vec<f64> = cars.iter().map(|&cars| f64::from(cars) / saturation).collect();
            flow_ratios(plan, &ratios)
        };
        Ok(plans.iter().zip(cars.iter()).map(of_light).collect())
    }
}

/// Returns the timing of one light.
pub(super) fn timing(plan: &AgentPlan, ratios: &FlowRatios) -> Timing {
    let (sum, lost_s) = (ratios.sum(), ratios.lost_s);
    let cycle_s = if sum < 1.0 { ((1.5 * lost_s + 5.0) / (1.0 - sum)).min(LONGEST_CYCLE_S) } else { LONGEST_CYCLE_S };
    let green_s = (cycle_s - lost_s).max(0.0);
    let least = plan.phases.min_green_steps().max(1);
    let mut greens = vec![0; plan.greens()];
    // The last share is what is left, so that the shares sum up to 1.
    let mut left = 1.0;
    for (place, &(green, ratio)) in ratios.greens.iter().enumerate() {
        // Without cars, the greens have equal shares.
        let share = if sum > 0.0 { ratio / sum } else { 1.0 / ratios.greens.len() as f64 };
        let share = if place + 1 == ratios.greens.len() { left } else { share };
        greens[green] = ((green_s * share).round() as u32).max(least);
        left -= share;
    }
    Timing::new(&plan.phases, &greens, 0)
}

#[cfg(test)]
mod tests {
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
}
