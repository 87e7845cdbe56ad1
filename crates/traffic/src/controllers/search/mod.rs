//! Searches for the best lights that go by the clock. Pure: the caller says what a candidate earns in an episode. All
//! candidates play the same episodes, so small gains show.

pub(crate) mod grid;
pub(crate) mod net;

use anyhow::Result;

use super::clock::ClockPlan;
use dials_core::base::statistics::mean;

/// Changes of the leeway that a walk tries: steps early and late.
const LEEWAY_CHANGES: [(i32, i32); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

pub(crate) struct Judge<'a> {
    episodes: usize,
    /// Returns what a plan earns in an episode.
    score: &'a mut dyn FnMut(&ClockPlan, usize) -> Result<f64>,
    /// Takes the number of episodes played, the most that there can be, and the best mean so far.
    report: &'a mut dyn FnMut(usize, usize, f64),
    played: usize,
    at_most: usize,
    best: f64,
}

/// A candidate with what it earned in each episode.
type Played<T> = (T, Vec<f64>);

impl<'a> Judge<'a> {
    pub(crate) fn new(
        episodes: usize,
        score: &'a mut dyn FnMut(&ClockPlan, usize) -> Result<f64>,
        report: &'a mut dyn FnMut(usize, usize, f64),
    ) -> Judge<'a> {
        Judge { episodes, score, report, played: 0, at_most: 0, best: f64::NEG_INFINITY }
    }

    /// Returns the number of episodes of a first trial.
    fn some(&self) -> usize {
        self.episodes.div_ceil(3)
    }

    /// Plays more episodes until this number of them is played.
    fn play(&mut self, plan: &ClockPlan, episodes: usize, earned: &mut Vec<f64>) -> Result<()> {
        while earned.len() < episodes {
            earned.push((self.score)(plan, earned.len())?);
            self.played += 1;
            (self.report)(self.played, self.at_most, self.best);
        }
        Ok(())
    }

    /// Plays some episodes of each candidate, and all episodes of the `finalists` best ones, which it returns.
    fn rank<T>(
        &mut self,
        candidates: Vec<T>,
        plan: impl Fn(&T) -> ClockPlan,
        finalists: usize,
    ) -> Result<Vec<Played<T>>> {
        let mut tried = Vec::new();
        for candidate in candidates {
            let mut earned = Vec::new();
            self.play(&plan(&candidate), self.some(), &mut earned)?;
            self.best = self.best.max(mean(&earned));
            tried.push((candidate, earned));
        }
        best_first(&mut tried);
        tried.truncate(finalists);
        for (candidate, earned) in &mut tried {
            self.play(&plan(candidate), self.episodes, earned)?;
        }
        best_first(&mut tried);
        Ok(tried)
    }

    /// Returns the best of the candidates, the first of equals.
    fn champion<T>(&mut self, mut ranked: Vec<Played<T>>) -> Played<T> {
        best_first(&mut ranked);
        let champion = ranked.swap_remove(0);
        self.best = mean(&champion.1);
        champion
    }

    /// Plays all episodes of the only candidate.
    fn champion_of<T>(&mut self, candidate: T, plan: impl Fn(&T) -> ClockPlan) -> Result<Played<T>> {
        let mut ranked = self.rank(vec![candidate], plan, 1)?;
        Ok(ranked.swap_remove(0))
    }

    /// Returns what the challenger earned, if it earns more, also in the first few episodes.
    fn challenge(&mut self, challenger: &ClockPlan, champion: &[f64]) -> Result<Option<Vec<f64>>> {
        let mut earned = Vec::new();
        for episodes in [self.some(), self.episodes] {
            self.play(challenger, episodes, &mut earned)?;
            if mean(&earned) <= mean(&champion[..episodes]) {
                return Ok(None);
            }
        }
        self.best = mean(&earned);
        Ok(Some(earned))
    }
}

fn best_first<T>(played: &mut [Played<T>]) {
    played.sort_by(|(_, one), (_, other)| mean(other).total_cmp(&mean(one)));
}

/// Lets a search find the plan with the greatest score. Returns it with the number of episodes.
#[cfg(test)]
fn find(
    episodes: usize,
    score: &mut dyn FnMut(&ClockPlan) -> f64,
    search: impl FnOnce(Judge<'_>) -> Result<(ClockPlan, f64)>,
) -> (ClockPlan, usize) {
    let mut reported = 0;
    // Episodes differ by far more than timings do.
    let mut score = |plan: &ClockPlan, episode: usize| Ok(1000.0 * (episode as f64).sin() + score(plan));
    let mut report = |played, at_most, _| {
        assert!(played == reported + 1 && played <= at_most, "{reported}, {played} of {at_most}");
        reported = played;
    };
    let (found, _) = search(Judge::new(episodes, &mut score, &mut report)).unwrap();
    (found, reported)
}
