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

use super::candidate::Candidate;
use super::{Judge, Ranked};
use crate::agents::plan::AgentPlan;
use crate::controllers::flow_ratios::FlowRatios;
use crate::controllers::neighbours::every_other;
use crate::controllers::timing::{ClockPlan, Leeway};
use crate::controllers::webster;
use dials_core::base::statistics::mean;

/// Version of the search, as [`super::grid::VERSION`].
pub(crate) const VERSION: u32 = 1;

/// Cycles of the first part, in steps.
const CYCLES: [u32; 7] = [40, 50, 60, 75, 90, 110, 130];
/// Number of directions of the waves.
const DIRECTIONS: usize = 8;
/// Number of candidates of the first and of the second part that play all episodes.
const FINALISTS: [usize; 2] = [2, 3];
/// The walk plays at most this many times the episodes.
const WALK: usize = 30;

/// A search on any net.
pub(crate) struct Search<'a> {
    pub(crate) plans: &'a [AgentPlan],
    /// Flow ratios of the lights' greens.
    pub(crate) ratios: &'a [FlowRatios],
    /// Leeway to begin with; `None`: the lights have none.
    pub(crate) leeway: Option<Leeway>,
    pub(crate) judge: Judge<'a>,
}

impl Search<'_> {
    /// Returns the best plan found and its mean over the episodes.
    pub(crate) fn run(mut self) -> Result<(ClockPlan, f64)> {
        let cycles = self.cycles();
        let (all, some) = (self.judge.episodes, self.judge.some());
        let waves = FINALISTS[0] * self.waves(&cycles[0]).len();
        let ranking = (cycles.len() + waves) * some + FINALISTS.iter().sum::<usize>() * (all - some);
        let mut standing = Ranked { played: 0, at_most: ranking + WALK * all, best: f64::NEG_INFINITY };

        let mut ranked = self.judge.rank(cycles, Candidate::plan, FINALISTS[0], &mut standing)?;
        let waves: Vec<Candidate> = ranked.iter().flat_map(|(candidate, _)| self.waves(candidate)).collect();
        ranked.extend(self.judge.rank(waves, Candidate::plan, FINALISTS[1], &mut standing)?);
        // The sort is stable: of equals, the one without waves stays first.
        ranked.sort_by(|(_, one), (_, other)| mean(other).total_cmp(&mean(one)));
        let (best, earned) = ranked.swap_remove(0);
        self.walk(best, earned, standing)
    }

    /// Changes a candidate as long as that earns more.
    fn walk(&mut self, mut best: Candidate, mut earned: Vec<f64>, mut standing: Ranked) -> Result<(ClockPlan, f64)> {
        standing.best = mean(&earned);
        let end = standing.played + WALK * self.judge.episodes;
        let changes = best.changes();
        // Number of changes since the last one that earned more. After a whole round of them, none will.
        let mut in_vain = 0;
        for &change in changes.iter().cycle() {
            if in_vain == changes.len() || standing.played + self.judge.episodes > end {
                break;
            }
            in_vain += 1;
            let Some(challenger) = best.changed(self.plans, change).filter(|changed| *changed != best) else {
                continue;
            };
            if let Some(better) = self.judge.challenge(&challenger.plan(), &earned, &mut standing)? {
                (best, earned, in_vain) = (challenger, better, 0);
                standing.best = mean(&earned);
            }
        }
        Ok((best.plan(), mean(&earned)))
    }

    /// Returns the candidates of the first part: each light with the cycle that Webster's formula gives it, and all with
    /// the same cycle.
    fn cycles(&self) -> Vec<Candidate> {
        let &Search { plans, ratios, leeway, .. } = self;
        let timings = plans.iter().zip(ratios).map(|(plan, ratios)| webster::timing(plan, ratios)).collect();
        let websters = Candidate { timings, leeway };
        let same = CYCLES.into_iter().map(|cycle| Candidate::of_cycle(plans, ratios, cycle, leeway));
        [websters].into_iter().chain(same).collect()
    }

    /// Returns a candidate with the offsets of the waves and of the checkerboard; none for a light alone.
    fn waves(&self, candidate: &Candidate) -> Vec<Candidate> {
        if self.plans.len() == 1 {
            return Vec::new();
        }
        let is_odd = every_other(self.plans);
        let half = |light: usize| if is_odd[light] { f64::from(candidate.timings[light].cycle()) / 2.0 } else { 0.0 };
        let speed_mps = self.speed_mps();
        let wave = |number: usize| {
            let (sin, cos) = (TAU * number as f64 / DIRECTIONS as f64).sin_cos();
            let arrival_s = |plan: &AgentPlan| (plan.place_m[0] * cos + plan.place_m[1] * sin) / speed_mps;
            let first_s = self.plans.iter().map(arrival_s).fold(f64::INFINITY, f64::min);
            candidate.with_offsets(|light| (arrival_s(&self.plans[light]) - first_s).round())
        };
        [candidate.with_offsets(half)].into_iter().chain((0..DIRECTIONS).map(wave)).collect()
    }

    /// Returns the mean speed limit of the approaches.
    fn speed_mps(&self) -> f64 {
        let limits = self.plans.iter().flat_map(|plan| &plan.region.approaches).map(|lane| lane.speed_limit_mps);
        mean(&limits.collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::crossing;

    /// Three lights on a road to the east, 100 m apart, where cars drive 10 m/s.
    fn plans() -> Vec<AgentPlan> {
        (0..3).map(|light| AgentPlan { place_m: [100.0 * f64::from(light), 7.0], ..crossing() }).collect()
    }

    fn ratios() -> FlowRatios {
        FlowRatios { greens: vec![(0, 0.3), (1, 0.1), (3, 0.1)], lost_s: 12.0 }
    }

    /// Searches with a score; returns the best plan and the number of episodes.
    fn find(plans: &[AgentPlan], score: &mut dyn FnMut(&ClockPlan) -> f64) -> (ClockPlan, usize) {
        let ratios = vec![ratios(); plans.len()];
        let mut standings: Vec<Ranked> = Vec::new();
        // Episodes differ by far more than timings do.
        let mut score = |plan: &ClockPlan, episode: usize| Ok(1000.0 * (episode as f64).sin() + score(plan));
        let report = &mut |standing| standings.push(standing);
        let judge = Judge { episodes: 4, score: &mut score, report };
        let (found, _) = Search { plans, ratios: &ratios, leeway: None, judge }.run().unwrap();
        assert!(standings.windows(2).all(|pair| pair[1].played == pair[0].played + 1));
        let last = standings.last().unwrap();
        assert!(last.played <= last.at_most, "{last:?}");
        (found, last.played)
    }

    #[test]
    fn a_wave_along_a_road_is_found() {
        let lag = |plan: &ClockPlan, light: usize| f64::from(plan.timings[light].offset().abs_diff(10 * light as u32));
        let (found, _) = find(&plans(), &mut |plan| -(0..3).map(|light| lag(plan, light)).sum::<f64>());
        assert_eq!(found.timings.iter().map(|timing| timing.offset()).collect::<Vec<_>>(), [0, 10, 20]);
    }

    #[test]
    fn splits_and_offsets_of_single_lights_are_changed() {
        // The second light is best with two steps more of its second green, and three steps later.
        let start = Candidate::of_cycle(&plans(), &vec![ratios(); 3], 60, None).timings;
        let mut score = |plan: &ClockPlan| {
            let error = |light: usize| {
                let (greens, offset) =
                    if light == 1 { (start[1].greens()[1] + 2, 3) } else { (start[0].greens()[1], 0) };
                let found = &plan.timings[light];
                f64::from(
                    found.greens()[1].abs_diff(greens) + found.offset().abs_diff(offset) + found.cycle().abs_diff(60),
                )
            };
            -(0..3).map(error).sum::<f64>()
        };
        let (found, _) = find(&plans(), &mut score);
        assert_eq!(score(&found), 0.0, "{found:?}");
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
}
