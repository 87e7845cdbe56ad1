//! The search for the best lights of a grid that go by the clock, over cycle, split, offsets and leeway.
//!
//! The search has three parts:
//! - It tries a grid of greens and of waves on some of the episodes. In a wave, offsets grow by quarters of the cycle
//!   along rows and columns; a half along both is the checkerboard.
//! - It tries the best of them on all episodes.
//! - From the winner it walks: it changes each green, row and column and the leeway a little, and keeps changes that
//!   earn more.

use std::ops::Range;

use anyhow::Result;

use super::{Judge, Ranked};
use crate::agents::phase_plan::PhasePlan;
use crate::controllers::timing::{ClockPlan, Leeway, Timing};
use dials_core::base::statistics::mean;

/// Version of the search. Bump when the space of the search or the choice of the best changes; timings of another
/// version are searched again.
pub(crate) const VERSION: u32 = 1;

/// Greens of the first grid, in steps.
const GREENS: [u32; 8] = [4, 6, 8, 10, 12, 15, 19, 24];
/// Number of candidates of the first grid that play all episodes.
const FINALISTS: usize = 6;
/// Number of times that the walk tries every change.
const ROUNDS: usize = 3;
/// Steps by which the walk changes a green or an offset.
const GREEN_CHANGES: [i64; 4] = [1, -1, 2, -2];
const OFFSET_CHANGES: [i64; 6] = [1, -1, 2, -2, 4, -4];
const LEEWAY_CHANGES: [(i64, i64); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

/// The shape of a grid.
#[derive(Clone, Copy)]
pub(crate) struct Shape<'a> {
    pub(crate) rows: usize,
    pub(crate) cols: usize,
    /// Phases of every light: green for south and north, then for west and east.
    pub(crate) phases: &'a PhasePlan,
}

/// Timings with one cycle and split for all intersections. Each offset is the sum of one per row and one per column.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Candidate {
    vertical: u32,
    horizontal: u32,
    rows: Vec<u32>,
    cols: Vec<u32>,
    /// Leeway of all intersections; `None`: the lights have none.
    leeway: Option<Leeway>,
}

impl Candidate {
    /// Returns timings whose offsets grow by these quarters of the cycle from row to row and from column to column.
    fn wave(grid: Shape<'_>, green: u32, by_row: usize, by_col: usize, leeway: Option<Leeway>) -> Candidate {
        let mut candidate = Candidate { vertical: green, horizontal: green, rows: vec![], cols: vec![], leeway };
        let cycle = candidate.cycle(grid);
        let offsets =
            |count: usize, quarters: usize| (0..count).map(|i| (i * quarters % 4) as u32 * cycle / 4).collect();
        candidate.rows = offsets(grid.rows, by_row);
        candidate.cols = offsets(grid.cols, by_col);
        candidate
    }

    fn cycle(&self, grid: Shape<'_>) -> u32 {
        self.vertical + self.horizontal + grid.phases.clearing_steps(0, 1) + grid.phases.clearing_steps(1, 0)
    }

    fn plan(&self, grid: Shape<'_>) -> ClockPlan {
        ClockPlan { timings: self.timings(grid), leeway: self.leeway.unwrap_or(Leeway::NONE) }
    }

    fn timings(&self, grid: Shape<'_>) -> Vec<Timing> {
        let offset = |row: u32, col: u32| (row + col) % self.cycle(grid);
        let offsets = self.rows.iter().flat_map(|&row| self.cols.iter().map(move |&col| offset(row, col)));
        offsets.map(|offset| Timing::new(grid.phases, &[self.vertical, self.horizontal], offset)).collect()
    }

    /// Returns the candidates that one change makes of this one. When the cycle changes, offsets keep their share of
    /// it.
    fn neighbours(&self, grid: Shape<'_>) -> Vec<Candidate> {
        let mut found = Vec::new();
        for by in GREEN_CHANGES {
            for (vertical, horizontal) in [(by, by), (by, 0), (0, by), (by, -by)] {
                let mut changed = self.clone();
                changed.vertical = lengthened(self.vertical, vertical);
                changed.horizontal = lengthened(self.horizontal, horizontal);
                let (before, now) = (self.cycle(grid), changed.cycle(grid));
                changed
                    .rows
                    .iter_mut()
                    .chain(&mut changed.cols)
                    .for_each(|offset| *offset = (*offset * now + before / 2) / before);
                found.push(changed);
            }
        }
        for place in 0..self.rows.len() + self.cols.len() {
            for by in OFFSET_CHANGES {
                let mut changed = self.clone();
                let offset = changed.rows.iter_mut().chain(&mut changed.cols).nth(place).expect("a row or a column");
                *offset = (i64::from(*offset) + by).rem_euclid(i64::from(self.cycle(grid))) as u32;
                found.push(changed);
            }
        }
        found.retain(|candidate| candidate.vertical >= 1 && candidate.horizontal >= 1);
        for (early, late) in self.leeway.iter().flat_map(|_| LEEWAY_CHANGES) {
            let change =
                |Leeway { early: e, late: l }| Leeway { early: lengthened(e, early), late: lengthened(l, late) };
            found.push(Candidate { leeway: self.leeway.map(change), ..self.clone() });
        }
        found
    }
}

/// Returns a green that is longer by some steps; 0 if it would be negative.
fn lengthened(green: u32, by: i64) -> u32 {
    u32::try_from(i64::from(green) + by).unwrap_or(0)
}

/// Returns the numbers of quarters of the cycle by which offsets can grow. Along a single row or column there is only
/// 0.
fn quarters(count: usize) -> Range<usize> {
    if count > 1 { 0..4 } else { 0..1 }
}

/// A search on a grid.
pub(crate) struct Search<'a> {
    pub(crate) grid: Shape<'a>,
    /// Leeway to begin with; `None`: the lights have none.
    pub(crate) leeway: Option<Leeway>,
    pub(crate) judge: Judge<'a>,
}

impl Search<'_> {
    /// Returns the best plan found and its mean over the episodes.
    pub(crate) fn run(mut self) -> Result<(ClockPlan, f64)> {
        let grid = self.grid;
        let waves = self.waves();
        let (all, some) = (self.judge.episodes, self.judge.some());
        let walk_at_most = ROUNDS * waves[0].neighbours(grid).len() * all;
        let at_most = waves.len() * some + FINALISTS * (all - some) + walk_at_most;
        let mut standing = Ranked { played: 0, at_most, best: f64::NEG_INFINITY };

        let mut ranked = self.judge.rank(waves, |candidate| candidate.plan(grid), FINALISTS, &mut standing)?;
        let (mut best, mut earned) = ranked.swap_remove(0);
        standing.best = mean(&earned);

        for _ in 0..ROUNDS {
            let before = best.clone();
            let count = best.neighbours(grid).len();
            // Changes are counted by number, so that each is tried on top of those that were kept.
            for number in 0..count {
                let Some(challenger) = best.neighbours(grid).into_iter().nth(number) else { break };
                if let Some(better) = self.judge.challenge(&challenger.plan(grid), &earned, &mut standing)? {
                    (best, earned) = (challenger, better);
                    standing.best = mean(&earned);
                }
            }
            if best == before {
                break;
            }
        }
        Ok((best.plan(grid), mean(&earned)))
    }

    fn waves(&self) -> Vec<Candidate> {
        let mut waves = Vec::new();
        for green in GREENS {
            for by_row in quarters(self.grid.rows) {
                for by_col in quarters(self.grid.cols) {
                    waves.push(Candidate::wave(self.grid, green, by_row, by_col, self.leeway));
                }
            }
        }
        waves
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::middle;

    fn timing(vertical: u32, horizontal: u32, offset: u32) -> Timing {
        Timing::new(&middle().phases, &[vertical, horizontal], offset)
    }

    /// Searches for timings that are hidden in the score.
    fn find(rows: usize, cols: usize, wanted: &[Timing]) -> Vec<Timing> {
        let wanted = ClockPlan { timings: wanted.to_vec(), leeway: Leeway::NONE };
        let found = find_plan(rows, cols, None, &wanted);
        assert_eq!(found.leeway, Leeway::NONE);
        found.timings
    }

    /// Searches for a plan that is hidden in the score.
    fn find_plan(rows: usize, cols: usize, leeway: Option<Leeway>, wanted: &ClockPlan) -> ClockPlan {
        let distance = |one: u32, other: u32, cycle: u32| {
            let ahead = (one + cycle - other % cycle) % cycle;
            f64::from(ahead.min(cycle - ahead))
        };
        let mut standings = Vec::new();
        let mut score = |plan: &ClockPlan, episode: usize| {
            let leeway =
                plan.leeway.early.abs_diff(wanted.leeway.early) + plan.leeway.late.abs_diff(wanted.leeway.late);
            let error = plan.timings.iter().zip(&wanted.timings).map(|(timing, wanted)| {
                f64::from(timing.greens()[0].abs_diff(wanted.greens()[0]))
                    + f64::from(timing.greens()[1].abs_diff(wanted.greens()[1]))
                    + 0.1 * distance(timing.offset(), wanted.offset(), timing.cycle())
            });
            // Episodes differ by far more than timings do.
            Ok(1000.0 * (episode as f64).sin() - error.sum::<f64>() - f64::from(leeway))
        };
        let plan = middle();
        let grid = Shape { rows, cols, phases: &plan.phases };
        let report = &mut |standing| standings.push(standing);
        let search = Search { grid, leeway, judge: Judge { episodes: 7, score: &mut score, report } };
        let (found, _) = search.run().unwrap();
        assert!(standings.windows(2).all(|pair| pair[1].played == pair[0].played + 1));
        assert!(standings.iter().all(|standing| standing.played <= standing.at_most));
        found
    }

    #[test]
    fn a_checkerboard_of_unequal_greens_is_found() {
        let timing = |offset| timing(11, 9, offset);
        let wanted = [timing(0), timing(13), timing(13), timing(0)];
        let found = find(2, 2, &wanted);
        assert_eq!(found, wanted);
    }

    #[test]
    fn a_wave_along_a_single_row_is_found() {
        // A quarter of the cycle of 22 (5, after rounding down) is nearest to 7 steps; the walk does the rest.
        let wanted = [0, 7, 14].map(|offset| timing(8, 8, offset));
        let found = find(1, 3, &wanted);
        assert_eq!(found, wanted);
    }

    #[test]
    fn the_leeway_is_searched_for_if_there_is_one() {
        let timing = |offset| timing(10, 10, offset);
        let wanted = ClockPlan { timings: vec![timing(0), timing(13)], leeway: Leeway { early: 1, late: 3 } };
        assert_eq!(find_plan(1, 2, Some(Leeway::default()), &wanted), wanted);
    }

    #[test]
    fn offsets_are_sums_of_one_per_row_and_one_per_column() {
        let plan = middle();
        let grid = Shape { rows: 2, cols: 3, phases: &plan.phases };
        let offsets = |candidate: &Candidate| candidate.timings(grid).iter().map(Timing::offset).collect::<Vec<_>>();
        // A cycle of 26: half of it is 13.
        assert_eq!(offsets(&Candidate::wave(grid, 10, 2, 2, None)), [0, 13, 0, 13, 0, 13]);
        let candidate =
            Candidate { vertical: 10, horizontal: 10, rows: vec![0, 5], cols: vec![1, 2, 25], leeway: None };
        assert_eq!(offsets(&candidate), [1, 2, 25, 6, 7, 4]);
    }
}
