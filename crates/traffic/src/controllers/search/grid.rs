//! The search for the best lights of a grid that go by the clock, over cycle, split, offsets and leeway.
//!
//! The search has three parts:
//! - It tries a grid of greens and of waves on some of the episodes. In a wave, offsets grow by quarters of the cycle
//!   along rows and columns; a half along both is the checkerboard.
//! - It tries the best of them on all episodes.
//! - From the winner it walks: it changes each green, row and column and the leeway a little, and keeps changes that
//!   earn more.

use anyhow::Result;

use super::{Judge, LEEWAY_CHANGES};
use crate::agents::phase_plan::PhasePlan;
use crate::controllers::clock::{ClockPlan, Leeway, Timing};
use dials_core::base::statistics::mean;

/// Bump when the space of the search or the choice of the best changes: then timings are searched again.
pub(crate) const VERSION: u32 = 1;

const GREENS: [u32; 8] = [4, 6, 8, 10, 12, 15, 19, 24];
/// Number of candidates of the first grid that play all episodes.
const FINALISTS: usize = 6;
const ROUNDS: usize = 3;
/// Steps by which the walk changes a green or an offset.
const GREEN_CHANGES: [i32; 4] = [1, -1, 2, -2];
const OFFSET_CHANGES: [i64; 6] = [1, -1, 2, -2, 4, -4];

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
        let offset = |row: u32, col: u32| (row + col) % self.cycle(grid);
        let offsets = self.rows.iter().flat_map(|&row| self.cols.iter().map(move |&col| offset(row, col)));
        let timing = |offset| Timing::new(grid.phases, &[self.vertical, self.horizontal], offset);
        ClockPlan { timings: offsets.map(timing).collect(), leeway: self.leeway.unwrap_or(Leeway::NONE) }
    }

    /// Returns the candidates after one change. When the cycle changes, offsets keep their share of it.
    fn neighbours(&self, grid: Shape<'_>) -> Vec<Candidate> {
        let mut found = Vec::new();
        for by in GREEN_CHANGES {
            for (vertical, horizontal) in [(by, by), (by, 0), (0, by), (by, -by)] {
                let mut changed = self.clone();
                changed.vertical = self.vertical.saturating_add_signed(vertical);
                changed.horizontal = self.horizontal.saturating_add_signed(horizontal);
                let (before, now) = (self.cycle(grid), changed.cycle(grid));
                for offset in changed.rows.iter_mut().chain(&mut changed.cols) {
                    *offset = (*offset * now + before / 2) / before;
                }
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
            let change = |leeway: Leeway| Leeway {
                early: leeway.early.saturating_add_signed(early),
                late: leeway.late.saturating_add_signed(late),
            };
            found.push(Candidate { leeway: self.leeway.map(change), ..self.clone() });
        }
        found
    }
}

/// Returns the best plan found and its mean over the episodes. `leeway`: to begin with; `None`: the lights have none.
pub(crate) fn search(grid: Shape<'_>, leeway: Option<Leeway>, mut judge: Judge<'_>) -> Result<(ClockPlan, f64)> {
    let waves = waves(grid, leeway);
    let (all, some) = (judge.episodes, judge.some());
    let walk_at_most = ROUNDS * waves[0].neighbours(grid).len() * all;
    judge.at_most = waves.len() * some + FINALISTS * (all - some) + walk_at_most;
    let ranked = judge.rank(waves, |candidate| candidate.plan(grid), FINALISTS)?;
    let (mut best, mut earned) = judge.champion(ranked);
    for _ in 0..ROUNDS {
        let before = best.clone();
        // Changes are counted by number, so that each is tried on top of those that were kept.
        for number in 0..best.neighbours(grid).len() {
            let Some(challenger) = best.neighbours(grid).into_iter().nth(number) else { break };
            if let Some(better) = judge.challenge(&challenger.plan(grid), &earned)? {
                (best, earned) = (challenger, better);
            }
        }
        if best == before {
            break;
        }
    }
    Ok((best.plan(grid), mean(&earned)))
}

fn waves(grid: Shape<'_>, leeway: Option<Leeway>) -> Vec<Candidate> {
    // Along a single row or column offsets cannot grow.
    let quarters = |count: usize| if count > 1 { 0..4 } else { 0..1 };
    let mut waves = Vec::new();
    for green in GREENS {
        for by_row in quarters(grid.rows) {
            for by_col in quarters(grid.cols) {
                waves.push(Candidate::wave(grid, green, by_row, by_col, leeway));
            }
        }
    }
    waves
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::middle;
    use crate::controllers::search::find;

    fn timing(vertical: u32, horizontal: u32, offset: u32) -> Timing {
        Timing::new(&middle().phases, &[vertical, horizontal], offset)
    }

    #[test]
    fn a_plan_that_is_hidden_in_the_score_is_found() {
        let distance = |one: u32, other: u32, cycle: u32| {
            let ahead = (one + cycle - other % cycle) % cycle;
            f64::from(ahead.min(cycle - ahead))
        };
        let plan = middle();
        let leeway = |early, late| Leeway { early, late };
        for (what, [rows, cols], wanted, begins, ends) in [
            ("a checkerboard", [2, 2], [0, 13, 13, 0].map(|by| timing(11, 9, by)).to_vec(), None, Leeway::NONE),
            // A quarter of the cycle of 22 (5, after rounding down) is nearest to 7 steps; the walk does the rest.
            ("a wave", [1, 3], [0, 7, 14].map(|by| timing(8, 8, by)).to_vec(), None, Leeway::NONE),
            ("leeway", [1, 2], [0, 13].map(|by| timing(10, 10, by)).to_vec(), Some(leeway(3, 2)), leeway(1, 3)),
        ] {
            let mut score = |plan: &ClockPlan| {
                let leeway = plan.leeway.early.abs_diff(ends.early) + plan.leeway.late.abs_diff(ends.late);
                let error = plan.timings.iter().zip(&wanted).map(|(timing, wanted)| {
                    let greens = timing.greens().iter().zip(wanted.greens());
                    greens.map(|(one, other)| f64::from(one.abs_diff(*other))).sum::<f64>()
                        + 0.1 * distance(timing.offset(), wanted.offset(), timing.cycle())
                });
                -error.sum::<f64>() - f64::from(leeway)
            };
            let grid = Shape { rows, cols, phases: &plan.phases };
            let (found, _) = find(7, &mut score, |judge| search(grid, begins, judge));
            assert_eq!(found, ClockPlan { timings: wanted, leeway: ends }, "{what}");
        }
    }
}
