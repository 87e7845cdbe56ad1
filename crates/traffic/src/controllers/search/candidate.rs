//! Candidates of the search on nets that are no grids: a timing for each light, and the same leeway for all.

use crate::agents::plan::AgentPlan;
use crate::controllers::flow_ratios::FlowRatios;
use crate::controllers::split::split;
use crate::controllers::timing::{ClockPlan, Leeway, Timing};

/// Least weight of a green that is shown, as a flow ratio: few cars need some green, too.
const LEAST_RATIO: f64 = 0.02;

/// Steps by which the walk changes the cycle of all lights, moves green from one to the next, and changes an offset.
const CYCLE_CHANGES: [i64; 4] = [5, -5, 10, -10];
const MOVES: [u32; 2] = [2, 5];
const OFFSET_CHANGES: [i64; 6] = [3, -3, 8, -8, 15, -15];
const LEEWAY_CHANGES: [(i64, i64); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

/// Timings of all lights.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Candidate {
    pub(crate) timings: Vec<Timing>,
    /// Leeway of all lights; `None`: they have none.
    pub(crate) leeway: Option<Leeway>,
}

/// A change of a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// Makes the cycle of all lights longer by some steps. Greens and offsets keep their shares.
    Cycle(i64),
    /// Moves steps of one green of a light to another one.
    Move { light: usize, from: usize, to: usize, steps: u32 },
    /// Shifts the clock of a light.
    Offset { light: usize, by: i64 },
    /// Changes the steps of leeway, early and late.
    Leeway(i64, i64),
}

impl Candidate {
    /// Returns lights that share a cycle, with Webster's greens as far as the light's least green allows. A light whose
    /// greens do not fit into the cycle has a longer one.
    pub(crate) fn of_cycle(
        plans: &[AgentPlan],
        ratios: &[FlowRatios],
        cycle: u32,
        leeway: Option<Leeway>,
    ) -> Candidate {
        let timing = |(plan, ratios): (&AgentPlan, &FlowRatios)| {
            let mut weights = vec![0.0; plan.greens()];
            ratios.greens.iter().for_each(|&(green, ratio)| weights[green] = ratio.max(LEAST_RATIO));
            let least = plan.phases.min_green_steps();
            let steps = cycle.saturating_sub(ratios.lost_s as u32).max(ratios.greens.len() as u32 * least);
            let greens = split(steps, &weights, least).expect("there are steps for the least greens");
            Timing::new(&plan.phases, &greens, 0)
        };
        Candidate { timings: plans.iter().zip(ratios).map(timing).collect(), leeway }
    }

    /// Returns the same greens with other offsets, in seconds; they may be larger than a cycle.
    pub(crate) fn with_offsets(&self, offset_s: impl Fn(usize) -> f64) -> Candidate {
        let shift = |(light, timing): (usize, &Timing)| {
            timing.shifted(offset_s(light).rem_euclid(f64::from(timing.cycle())) as u32)
        };
        Candidate { timings: self.timings.iter().enumerate().map(shift).collect(), leeway: self.leeway }
    }

    pub(super) fn plan(&self) -> ClockPlan {
        ClockPlan { timings: self.timings.clone(), leeway: self.leeway.unwrap_or(Leeway::NONE) }
    }

    /// Returns all changes that the walk tries, one of each light in turn.
    pub(super) fn changes(&self) -> Vec<Change> {
        let mut found: Vec<Change> = CYCLE_CHANGES.into_iter().map(Change::Cycle).collect();
        found.extend(self.leeway.iter().flat_map(|_| LEEWAY_CHANGES).map(|(early, late)| Change::Leeway(early, late)));
        let of_lights: Vec<Vec<Change>> = (0..self.timings.len()).map(|light| self.changes_of(light)).collect();
        let most = of_lights.iter().map(Vec::len).max().unwrap_or(0);
        found.extend((0..most).flat_map(|number| of_lights.iter().filter_map(move |of_light| of_light.get(number))));
        found
    }

    fn changes_of(&self, light: usize) -> Vec<Change> {
        let timing = &self.timings[light];
        let mut found = Vec::new();
        // A light alone has nobody to be in step with.
        if self.timings.len() > 1 {
            found.extend(OFFSET_CHANGES.map(|by| Change::Offset { light, by }));
        }
        for steps in MOVES {
            for from in (0..timing.greens().len()).filter(|&green| timing.greens()[green] > 0) {
                let to = timing.after(from);
                if from != to {
                    found.push(Change::Move { light, from, to, steps });
                    found.push(Change::Move { light, from: to, to: from, steps });
                }
            }
        }
        found.dedup();
        found
    }

    /// Returns the candidate after a change; `None` if a green would be too short or a number too large.
    pub(super) fn changed(&self, plans: &[AgentPlan], change: Change) -> Option<Candidate> {
        let mut changed = self.clone();
        match change {
            Change::Cycle(by) => {
                for (timing, plan) in changed.timings.iter_mut().zip(plans) {
                    *timing = lengthened(timing, plan, by)?;
                }
            }
            Change::Move { light, from, to, steps } => {
                let timing = &mut changed.timings[light];
                let mut greens = timing.greens().to_vec();
                greens[from] = greens[from].checked_sub(steps)?;
                greens[to] += steps;
                if greens[from] < plans[light].phases.min_green_steps() {
                    return None;
                }
                *timing = Timing::new(&plans[light].phases, &greens, timing.offset());
            }
            Change::Offset { light, by } => {
                let timing = &mut changed.timings[light];
                let offset = (i64::from(timing.offset()) + by).rem_euclid(i64::from(timing.cycle()));
                *timing = timing.shifted(offset as u32);
            }
            Change::Leeway(early, late) => {
                let Leeway { early: e, late: l } = self.leeway?;
                let most = |steps: &u32| *steps <= Leeway::MOST;
                let early = e.checked_add_signed(early as i32).filter(most)?;
                changed.leeway = Some(Leeway { early, late: l.checked_add_signed(late as i32).filter(most)? });
            }
        }
        Some(changed)
    }
}

/// Returns a timing with a longer cycle, in which greens and offset have the same shares.
fn lengthened(timing: &Timing, plan: &AgentPlan, by: i64) -> Option<Timing> {
    let before: u32 = timing.greens().iter().sum();
    let steps = u32::try_from(i64::from(before) + by).ok()?;
    let weights: Vec<f64> = timing.greens().iter().map(|&green| f64::from(green)).collect();
    let longer = Timing::new(&plan.phases, &split(steps, &weights, plan.phases.min_green_steps())?, 0);
    let offset = f64::from(timing.offset()) * f64::from(longer.cycle()) / f64::from(timing.cycle());
    Some(longer.shifted(offset.round() as u32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::crossing;

    fn ratios() -> FlowRatios {
        FlowRatios { greens: vec![(0, 0.3), (1, 0.0), (3, 0.1)], lost_s: 12.0 }
    }

    #[test]
    fn lights_share_a_cycle_if_their_greens_fit() {
        let plans = [crossing(), crossing()];
        let ratios = [ratios(), ratios()];
        let of_cycle = |cycle| Candidate::of_cycle(&plans, &ratios, cycle, None).timings;
        // 54 - 12 = 42 steps of green: 30 : 2 : 10, but 5 at least.
        let greens = of_cycle(54)[0].greens().to_vec();
        assert_eq!((greens.iter().sum::<u32>(), greens[1], greens[2]), (42, 5, 0));
        assert!(greens[0] > 2 * greens[3], "{greens:?}");
        assert_eq!(of_cycle(20)[1].greens(), [5, 5, 0, 5]);
        assert_eq!(of_cycle(20)[1].cycle(), 27);
    }

    #[test]
    fn changes_keep_the_least_greens_and_the_shares() {
        let plans = [crossing(), crossing()];
        let candidate = Candidate::of_cycle(&plans, &[ratios(), ratios()], 54, Some(Leeway { early: 0, late: 1 }));
        let candidate = candidate.with_offsets(|light| 27.0 * light as f64);
        let changed = |change| candidate.changed(&plans, change);
        assert_eq!(changed(Change::Move { light: 0, from: 1, to: 3, steps: 2 }), None, "5 steps are the least");
        let moved = changed(Change::Move { light: 1, from: 0, to: 1, steps: 2 }).unwrap();
        assert_eq!(moved.timings[1].greens()[1], 7);
        assert_eq!((moved.timings[1].cycle(), moved.timings[1].offset()), (54, 27));
        assert_eq!(changed(Change::Offset { light: 1, by: 30 }).unwrap().timings[1].offset(), 3);
        let longer = changed(Change::Cycle(10)).unwrap();
        assert_eq!(
            longer.timings.iter().map(|timing| (timing.cycle(), timing.offset())).collect::<Vec<_>>(),
            [(64, 0), (64, 32)]
        );
        assert_eq!(changed(Change::Leeway(-1, 0)), None);
        assert_eq!(changed(Change::Leeway(0, -1)).unwrap().leeway, Some(Leeway::NONE));
        // 4 of the cycle, 4 of the leeway, and of each light 6 of its offset and 2 x 3 x 2 of its greens.
        assert_eq!(candidate.changes().len(), 8 + 2 * (6 + 12));
    }
}
