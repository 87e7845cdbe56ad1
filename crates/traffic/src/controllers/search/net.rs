//! The search for the best lights of any net that go by the clock: cycle, splits and offset of each light, and leeway.
//!
//! The search has three parts:
//! - It tries several cycles with Webster's greens.
//! - It tries the best of them with waves. In a wave, lights turn green one after the other, as cars come to them that
//!   drive in one direction. A checkerboard is tried, too.
//! - From the winner it walks: it changes one light after the other a little, and keeps changes that earn more. The
//!   walk ends when no change does, or when its episodes are used up.

use std::f64::consts::TAU;

use anyhow::Result;

use super::{Judge, LEEWAY_CHANGES};
use crate::agents::plan::AgentPlan;
use crate::controllers::arguments::{every_other, split};
use crate::controllers::clock::{ClockPlan, Leeway, Timing};
use crate::controllers::webster::{self, FlowRatios};
use dials_core::base::statistics::mean;

/// Version of the search, as that of [`super::grid`].
pub(crate) const VERSION: u32 = 1;

const CYCLES: [u32; 7] = [40, 50, 60, 75, 90, 110, 130];
const DIRECTIONS: usize = 8;
/// Number of candidates of the first and of the second part that play all episodes.
const FINALISTS: [usize; 2] = [2, 3];
/// The walk plays at most this many times the episodes.
const WALK: usize = 30;
/// Least weight of a green that is shown, as a flow ratio: few cars need some green, too.
const LEAST_RATIO: f64 = 0.02;

/// Steps by which the walk changes the cycle of all lights, moves green from one to the next, and changes an offset.
const CYCLE_CHANGES: [i64; 4] = [5, -5, 10, -10];
const MOVES: [u32; 2] = [2, 5];
const OFFSET_CHANGES: [i64; 6] = [3, -3, 8, -8, 15, -15];

/// Returns the best plan found and its mean over the episodes. `leeway`: to begin with; `None`: the lights have none.
pub(crate) fn search(
    plans: &[AgentPlan],
    ratios: &[FlowRatios],
    leeway: Option<Leeway>,
    mut judge: Judge<'_>,
) -> Result<(ClockPlan, f64)> {
    // Each light with the cycle that Webster's formula gives it, and all with the same cycle.
    let timings = plans.iter().zip(ratios).map(|(plan, ratios)| webster::timing(plan, ratios)).collect();
    let mut cycles = vec![Candidate { timings, leeway }];
    cycles.extend(CYCLES.map(|cycle| Candidate::of_cycle(plans, ratios, cycle, leeway)));
    let (all, some) = (judge.episodes, judge.some());
    let of_waves = FINALISTS[0] * waves(plans, &cycles[0]).len();
    judge.at_most = (cycles.len() + of_waves) * some + FINALISTS.iter().sum::<usize>() * (all - some) + WALK * all;
    let mut ranked = judge.rank(cycles, Candidate::plan, FINALISTS[0])?;
    let of_waves = ranked.iter().flat_map(|(candidate, _)| waves(plans, candidate)).collect();
    ranked.extend(judge.rank(of_waves, Candidate::plan, FINALISTS[1])?);
    // Of equals, the one without waves.
    let (best, earned) = judge.champion(ranked);
    walk(plans, best, earned, judge)
}

/// Walks from these timings and keeps changes that earn more. Lights that share a cycle go on to share one.
pub(crate) fn improve(plans: &[AgentPlan], timings: Vec<Timing>, mut judge: Judge<'_>) -> Result<(ClockPlan, f64)> {
    judge.at_most = (1 + WALK) * judge.episodes;
    let (best, earned) = judge.champion_of(Candidate { timings, leeway: None }, Candidate::plan)?;
    walk(plans, best, earned, judge)
}

/// Returns timings of lights that share a cycle, with Webster's greens. One whose least greens do not fit has a longer one.
pub(crate) fn of_cycle(plans: &[AgentPlan], ratios: &[FlowRatios], cycle: u32) -> Vec<Timing> {
    let timing = |(plan, ratios): (&AgentPlan, &FlowRatios)| {
        let mut weights = vec![0.0; plan.greens()];
        ratios.greens.iter().for_each(|&(green, ratio)| weights[green] = ratio.max(LEAST_RATIO));
        let least = plan.phases.min_green_steps();
        let shortest: u32 = ratios.greens.iter().map(|&(green, _)| least[green]).sum();
        let steps = cycle.saturating_sub(ratios.lost_s as u32).max(shortest);
        let greens = split(steps, &weights, least).expect("there are steps for the least greens");
        Timing::new(&plan.phases, &plan.phases.fitted(&greens), 0)
    };
    plans.iter().zip(ratios).map(timing).collect()
}

fn walk(
    plans: &[AgentPlan],
    mut best: Candidate,
    mut earned: Vec<f64>,
    mut judge: Judge<'_>,
) -> Result<(ClockPlan, f64)> {
    let end = judge.played + WALK * judge.episodes;
    let changes = best.changes();
    // Number of changes since the last one that earned more. After a whole round of them, none will.
    let mut in_vain = 0;
    for &change in changes.iter().cycle() {
        if in_vain == changes.len() || judge.played + judge.episodes > end {
            break;
        }
        in_vain += 1;
        let Some(challenger) = best.changed(plans, change).filter(|changed| *changed != best) else { continue };
        if let Some(better) = judge.challenge(&challenger.plan(), &earned)? {
            (best, earned, in_vain) = (challenger, better, 0);
        }
    }
    Ok((best.plan(), mean(&earned)))
}

/// Returns a candidate with the offsets of the waves and of the checkerboard; none for a light alone.
fn waves(plans: &[AgentPlan], candidate: &Candidate) -> Vec<Candidate> {
    if plans.len() == 1 {
        return Vec::new();
    }
    let is_odd = every_other(plans);
    let half = |light: usize| if is_odd[light] { f64::from(candidate.timings[light].cycle()) / 2.0 } else { 0.0 };
    let limits = plans.iter().flat_map(|plan| &plan.region.approaches).map(|lane| lane.speed_limit_mps);
    let speed_mps = mean(&limits.collect::<Vec<_>>());
    let wave = |number: usize| {
        let (sin, cos) = (TAU * number as f64 / DIRECTIONS as f64).sin_cos();
        let arrival_s = |plan: &AgentPlan| (plan.place_m[0] * cos + plan.place_m[1] * sin) / speed_mps;
        let first_s = plans.iter().map(arrival_s).fold(f64::INFINITY, f64::min);
        candidate.with_offsets(|light| (arrival_s(&plans[light]) - first_s).round())
    };
    [candidate.with_offsets(half)].into_iter().chain((0..DIRECTIONS).map(wave)).collect()
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Candidate {
    timings: Vec<Timing>,
    /// Leeway of all lights; `None`: they have none.
    leeway: Option<Leeway>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Change {
    /// Makes the cycle of all lights longer by some steps. Greens and offsets keep their shares.
    Cycle(i64),
    Move {
        light: usize,
        from: usize,
        to: usize,
        steps: u32,
    },
    Offset {
        light: usize,
        by: i64,
    },
    Leeway(i32, i32),
}

impl Candidate {
    /// Returns lights that share a cycle, with Webster's greens. One whose least greens do not fit has a longer one.
    fn of_cycle(plans: &[AgentPlan], ratios: &[FlowRatios], cycle: u32, leeway: Option<Leeway>) -> Candidate {
        Candidate { timings: of_cycle(plans, ratios, cycle), leeway }
    }

    /// Returns the same greens with other offsets, in seconds; they may be larger than a cycle.
    fn with_offsets(&self, offset_s: impl Fn(usize) -> f64) -> Candidate {
        let shift = |(light, timing): (usize, &Timing)| {
            timing.shifted(offset_s(light).rem_euclid(f64::from(timing.cycle())) as u32)
        };
        Candidate { timings: self.timings.iter().enumerate().map(shift).collect(), leeway: self.leeway }
    }

    fn plan(&self) -> ClockPlan {
        ClockPlan { timings: self.timings.clone(), leeway: self.leeway.unwrap_or(Leeway::NONE) }
    }

    fn changes(&self) -> Vec<Change> {
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
    fn changed(&self, plans: &[AgentPlan], change: Change) -> Option<Candidate> {
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
                let phases = &plans[light].phases;
                if greens[from] < phases.min_green_steps()[from] || phases.misfit(&greens).is_some() {
                    return None;
                }
                *timing = timing.with_lengths(&plans[light].phases, &greens);
            }
            Change::Offset { light, by } => {
                let timing = &mut changed.timings[light];
                let offset = (i64::from(timing.offset()) + by).rem_euclid(i64::from(timing.cycle()));
                *timing = timing.shifted(offset as u32);
            }
            Change::Leeway(early, late) => {
                let Leeway { early: e, late: l } = self.leeway?;
                let most = |steps: &u32| *steps <= Leeway::MOST;
                let early = e.checked_add_signed(early).filter(most)?;
                changed.leeway = Some(Leeway { early, late: l.checked_add_signed(late).filter(most)? });
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
    let greens = split(steps, &weights, plan.phases.min_green_steps())?;
    if plan.phases.misfit(&greens).is_some() {
        return None;
    }
    let longer = timing.with_lengths(&plan.phases, &greens);
    let offset = f64::from(timing.offset()) * f64::from(longer.cycle()) / f64::from(timing.cycle());
    Some(longer.shifted(offset.round() as u32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::crossing;
    use crate::controllers::search::find as find_with;

    /// Three lights on a road to the east, 100 m apart, where cars drive 10 m/s.
    fn plans() -> Vec<AgentPlan> {
        (0..3).map(|light| AgentPlan { place_m: [100.0 * f64::from(light), 7.0], ..crossing() }).collect()
    }

    fn ratios(left_turn: f64) -> FlowRatios {
        FlowRatios { greens: vec![(0, 0.3), (1, left_turn), (3, 0.1)], lost_s: 12.0 }
    }

    fn find(plans: &[AgentPlan], score: &mut dyn FnMut(&ClockPlan) -> f64) -> (ClockPlan, usize) {
        find_with(4, score, |judge| search(plans, &vec![ratios(0.1); plans.len()], None, judge))
    }

    #[test]
    fn a_wave_along_a_road_is_found() {
        let lag = |plan: &ClockPlan, light: usize| f64::from(plan.timings[light].offset().abs_diff(10 * light as u32));
        let (found, _) = find(&plans(), &mut |plan| -(0..3).map(|light| lag(plan, light)).sum::<f64>());
        assert_eq!(found.timings.iter().map(|timing| timing.offset()).collect::<Vec<_>>(), [0, 10, 20]);
    }

    #[test]
    fn the_walk_ends_with_its_episodes_or_when_nothing_helps() {
        // Longer cycles are always better, so the walk goes on to its end.
        let (_, endless) = find(&plans(), &mut |plan| f64::from(plan.timings[0].cycle()));
        let (_, flat) = find(&plans(), &mut |_| 0.0);
        assert!(endless > flat + WALK / 2, "{endless} episodes against {flat}");
        // A light alone plays no waves. With 4 episodes, 2 of them first: 8 x 2 + 2 x 2, and 2 for each of its changes.
        let (_, alone) = find(&plans()[..1], &mut |_| 0.0);
        let changes = 4 + 12;
        assert!(alone <= 20 + 2 * changes, "{alone}");
    }

    #[test]
    fn lights_share_a_cycle_if_their_greens_fit() {
        let plans = [crossing(), crossing()];
        let ratios = [ratios(0.0), ratios(0.0)];
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
        let leeway = Some(Leeway { early: 0, late: 1 });
        let candidate = Candidate::of_cycle(&plans, &[ratios(0.0), ratios(0.0)], 54, leeway);
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
