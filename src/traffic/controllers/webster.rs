//! Webster's fixed time: cycle and greens from measured flows, for each intersection.
//!
//! Source: Webster, "Traffic signal settings", Road Research Technical Paper 39, 1958. The flow ratio `y` of a phase is
//! the flow of its busiest edge over the saturation flow. `Y` is the sum of the flow ratios, and `L` the lost time of a
//! cycle. The delay is least near the cycle `C = (1.5 L + 5) / (1 - Y)`. Of it, each phase gets the green
//! `(C - L) y / Y`. The lost time is the two yellows of 3 s: `L = 6`.

use anyhow::Result;

use super::arguments::Arguments;
use super::control::{HandCoded, Trials};
use super::fixed_time::FixedTime;
use super::timing::Timing;
use crate::base::{RandomPurpose, Rows, Seed};
use crate::traffic::agents::region::EDGES;
use crate::traffic::light::{KEEP, YELLOW_STEPS};

/// Cars per hour that pass the stop line from a standing queue of our vehicle type: one in 2.28 s.
const SATURATION_PER_H: f64 = 1580.0;
/// Longest cycle. Near saturation, the formula goes to infinity.
const LONGEST_CYCLE_S: f64 = 120.0;
/// Number of episodes that measure the flows.
const EPISODES: u32 = 5;
/// Timing of the lights while the flows are measured.
const MEANWHILE: Timing = Timing { vertical: 10, horizontal: 10, offset: 0 };

/// The measurement that the timings are computed from.
pub struct TimingPlan {
    episodes: u32,
    saturation_per_h: f64,
}

impl TimingPlan {
    pub fn of(arguments: &mut Arguments<'_>) -> Result<TimingPlan> {
        let what = "a number of cars per hour, above 0";
        let saturation = arguments.number("saturation", what, |&flow: &f64| flow > 0.0 && flow.is_finite())?;
        let episodes = arguments.number("episodes", "a whole number, at least 1", |&episodes: &u32| episodes >= 1)?;
        Ok(TimingPlan {
            episodes: episodes.unwrap_or(EPISODES),
            saturation_per_h: saturation.unwrap_or(SATURATION_PER_H),
        })
    }

    /// Measures the flows on the GS (global simulator), on separate episodes, and computes the timings.
    pub fn timings(&self, agents: usize, trials: &dyn Trials) -> Result<Vec<Timing>> {
        let mut gs = trials.load_gs(HandCoded::rule(FixedTime::new(vec![MEANWHILE; agents])))?;
        let (keep, mut cars) = (vec![KEEP; agents], Rows::<u32>::new(agents, EDGES));
        for episode in 0..self.episodes {
            gs.reset(Seed::new(0).fork(RandomPurpose::Webster).for_episode(episode as usize))?;
            for _ in 0..trials.horizon() {
                gs.step(&keep)?;
                let arrivals = gs.influence_sample().sources.as_slice();
                cars.as_mut_slice().iter_mut().zip(arrivals).for_each(|(sum, &arrived)| *sum += u32::from(arrived));
            }
        }
        let seconds = f64::from(self.episodes) * trials.horizon() as f64;
        let saturation = self.saturation_per_h / 3600.0 * seconds;
        Ok(cars.iter().map(|edges| timing(std::array::from_fn(|edge| f64::from(edges[edge]) / saturation))).collect())
    }
}

/// Returns the timing of one light. `ratios`: flow over saturation flow on the edges from west, south, east and north.
fn timing([west, south, east, north]: [f64; EDGES]) -> Timing {
    let (vertical, horizontal) = (south.max(north), west.max(east));
    let sum = vertical + horizontal;
    let lost_s = 2.0 * f64::from(YELLOW_STEPS);
    let cycle_s = if sum < 1.0 { ((1.5 * lost_s + 5.0) / (1.0 - sum)).min(LONGEST_CYCLE_S) } else { LONGEST_CYCLE_S };
    // Without cars, the phases have equal shares.
    let share = if sum > 0.0 { vertical / sum } else { 0.5 };
    let green = |share: f64| (((cycle_s - lost_s) * share).round() as u32).max(1);
    Timing { vertical: green(share), horizontal: green(1.0 - share), offset: 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greens_are_websters() {
        let timing = |ratios| {
            let Timing { vertical, horizontal, offset } = super::timing(ratios);
            assert_eq!(offset, 0);
            (vertical, horizontal)
        };
        // Y = 0.3 + 0.2: C = 14 / 0.5 = 28, of which 22 are green: 13.2 and 8.8.
        assert_eq!(timing([0.2, 0.3, 0.1, 0.0]), (13, 9));
        // Y = 0.23 + 0.23: C = 14 / 0.54 = 25.93, greens of 9.96.
        assert_eq!(timing([0.23; 4]), (10, 10));
        // Without cars C = 14, greens of 4.
        assert_eq!(timing([0.0; 4]), (4, 4));
        // Beyond saturation 120 s, 114 of them green, 2 : 1.
        assert_eq!(timing([0.0, 0.8, 0.4, 0.0]), (76, 38));
        // A road without cars still gets one step.
        assert_eq!(timing([0.0, 0.5, 0.0, 0.0]), (22, 1));
    }
}
