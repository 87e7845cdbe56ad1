//! Searches for the best lights that go by the clock, on the same episodes for every candidate.
//!
//! Pure: the caller says what a candidate earns in an episode. A candidate is judged against another one on common
//! random numbers, so small gains show.
//!
//! - [`grid`]: the paper's grids. [`net`]: other nets; `candidate`: its candidates and how they are changed.

mod candidate;
pub(crate) mod grid;
pub(crate) mod net;

use anyhow::Result;

use super::timing::ClockPlan;
use dials_core::base::statistics::mean;

/// Progress of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ranked {
    /// Number of episodes played, and the most that there can be.
    pub(crate) played: usize,
    pub(crate) at_most: usize,
    /// Best mean so far.
    pub(crate) best: f64,
}

/// Plays candidates, with the functions that return what they earn in an episode and that report progress.
pub(crate) struct Judge<'a> {
    pub(crate) episodes: usize,
    pub(crate) score: &'a mut dyn FnMut(&ClockPlan, usize) -> Result<f64>,
    pub(crate) report: &'a mut dyn FnMut(Ranked),
}

impl Judge<'_> {
    /// Returns the number of episodes of a first trial.
    fn some(&self) -> usize {
        self.episodes.div_ceil(3)
    }

    /// Plays more episodes until this number of them is played.
    fn play(&mut self, plan: &ClockPlan, episodes: usize, earned: &mut Vec<f64>, standing: &mut Ranked) -> Result<()> {
        while earned.len() < episodes {
            earned.push((self.score)(plan, earned.len())?);
            standing.played += 1;
            (self.report)(*standing);
        }
        Ok(())
    }

    /// Plays some episodes of each plan. Returns the `finalists` best ones on all episodes, the best first, with what
    /// they earned. Of equals, the first stays first.
    fn rank<T>(
        &mut self,
        candidates: Vec<T>,
        plan: impl Fn(&T) -> ClockPlan,
        finalists: usize,
        standing: &mut Ranked,
    ) -> Result<Vec<(T, Vec<f64>)>> {
        let mut tried = Vec::new();
        for candidate in candidates {
            let mut earned = Vec::new();
            self.play(&plan(&candidate), self.some(), &mut earned, standing)?;
            standing.best = standing.best.max(mean(&earned));
            tried.push((candidate, earned));
        }
        tried.sort_by(|(_, one), (_, other)| mean(other).total_cmp(&mean(one)));
        tried.truncate(finalists);
        for (candidate, earned) in &mut tried {
            self.play(&plan(candidate), self.episodes, earned, standing)?;
        }
        tried.sort_by(|(_, one), (_, other)| mean(other).total_cmp(&mean(one)));
        Ok(tried)
    }

    /// Returns what the challenger earned, if it earns more. It loses early if it does not earn more in the first few
    /// episodes.
    fn challenge(
        &mut self,
        challenger: &ClockPlan,
        champion: &[f64],
        standing: &mut Ranked,
    ) -> Result<Option<Vec<f64>>> {
        let mut earned = Vec::new();
        for episodes in [self.some(), self.episodes] {
            self.play(challenger, episodes, &mut earned, standing)?;
            if mean(&earned) <= mean(&champion[..episodes]) {
                return Ok(None);
            }
        }
        Ok(Some(earned))
    }
}
