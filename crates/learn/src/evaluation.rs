//! Evaluation: plays episodes on the GS under a controller, and summarises them.
//!
//! - `table`: one player, as text. `comparison`: several players, as text. `variants`: the same on several variants of the
//!   traffic.
//! - [`json`], [`csv`]: the same figures for programs.

mod comparison;
pub mod csv;
pub mod json;
mod table;
mod variants;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::policy::Selection;
use dials_core::base::statistics::{Interval, mean, median, std_error};
use dials_core::base::{RandomPurpose, Rows, Seed};
use dials_core::domain::{Controller, Domain, GlobalSimulator, Measures, Result};

pub use comparison::{cell, comparison, signed};
pub use table::table;
pub use variants::of_variants;

/// Name of the return among the [`figures`] of an episode.
pub(crate) const RETURN: &str = "return";

/// Returns the seed of an evaluation episode. `evaluation`: `evaluation.seed` of the config. By default it is the same
/// for all runs, so that policies and controllers are compared on the same traffic.
pub fn episode_seed(evaluation: Seed, episode: usize) -> Seed {
    evaluation.fork(RandomPurpose::Evaluation).for_episode(episode)
}

/// The results of one episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeReport {
    /// Sum of rewards, per agent.
    pub returns: Vec<f64>,
    pub measures: Measures,
}

/// Plays one episode of `horizon` steps.
pub fn play(
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    episode: Seed,
) -> Result<EpisodeReport> {
    play_watched(simulator, controller, episode, &mut |_| Ok(()))
}

/// Plays one episode like [`play`]. `watch` gets the simulator at the beginning and after every step.
pub fn play_watched(
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    episode: Seed,
    watch: &mut dyn FnMut(&mut dyn GlobalSimulator) -> Result<()>,
) -> Result<EpisodeReport> {
    let (agents, horizon) = (simulator.agents(), simulator.kinds().horizon());
    let mut returns = vec![0.0; agents];
    let mut actions = vec![0; agents];
    controller.begin(episode);
    let mut percept = simulator.reset(episode)?.clone();
    watch(simulator)?;
    for _ in 0..horizon {
        controller.act(&percept, &mut actions)?;
        let transition = simulator.step(&actions)?;
        returns.iter_mut().zip(&transition.rewards).for_each(|(sum, &reward)| *sum += f64::from(reward));
        percept.clone_from(&transition.percept);
        watch(simulator)?;
    }
    Ok(EpisodeReport { returns, measures: simulator.measures()? })
}

/// A controller or policies, with their name in tables and files.
#[derive(Clone, Debug, PartialEq)]
pub struct Player {
    pub label: String,
    /// Keys and values that identify the player in JSON.
    pub keys: Vec<(&'static str, Value)>,
    /// How its policies choose actions; `None` for a controller.
    pub policies: Option<Selection>,
    /// Which agents follow them and what the others do, in words; `None`: all agents do.
    pub others: Option<String>,
}

/// A player and its episodes. All players of a command play the same episodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    pub player: Player,
    pub episodes: Vec<EpisodeReport>,
}

impl Finding {
    /// Returns the mean return of one agent, with its 95 % interval.
    pub(crate) fn of_agent(&self, agent: usize) -> Interval {
        Interval::of(&self.episodes.iter().map(|episode| episode.returns[agent]).collect::<Vec<_>>())
    }
}

/// Several episodes of one controller.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// `[episodes, agents]`
    pub returns: Rows<f64>,
    /// Means over the episodes.
    pub measures: Measures,
    /// Whether each agent is stuck; the glossary says when.
    pub stuck: Vec<bool>,
}

/// Mean, median and standard error of a return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    pub mean: f64,
    /// Median. For one agent: over episodes. For all agents: over their means, so that one bad agent does not hide the
    /// others.
    pub median: f64,
    /// Standard error of the mean over episodes. 0 for a single episode, which has no spread.
    pub std_error: f64,
}

impl Evaluation {
    pub fn new(domain: &dyn Domain, episodes: &[EpisodeReport]) -> Self {
        let mut returns = Rows::new(0, domain.agents());
        episodes.iter().for_each(|episode| returns.push(&episode.returns));
        let measures = mean_measures(episodes);
        let mut stuck = vec![false; domain.agents()];
        for kind in domain.kinds().iter() {
            let of_kind = domain.stuck(kind, &measures);
            kind.agents.iter().zip(of_kind).for_each(|(agent, is_stuck)| stuck[agent.0] = is_stuck);
        }
        Evaluation { returns, measures, stuck }
    }

    pub fn episodes(&self) -> usize {
        self.returns.len()
    }

    pub fn agents(&self) -> usize {
        self.returns.width()
    }

    pub fn of_agent(&self, agent: usize) -> Summary {
        let returns: Vec<f64> = self.returns.iter().map(|episode| episode[agent]).collect();
        Summary { mean: mean(&returns), median: median(&returns), std_error: std_error(&returns).unwrap_or(0.0) }
    }

    /// Summarises the mean return of all agents.
    pub fn of_all(&self) -> Summary {
        let episodes: Vec<f64> = self.returns.iter().map(mean).collect();
        let agents: Vec<f64> = (0..self.agents()).map(|agent| self.of_agent(agent).mean).collect();
        Summary { mean: mean(&episodes), median: median(&agents), std_error: std_error(&episodes).unwrap_or(0.0) }
    }
}

/// Plays the episodes `0..episodes` of an evaluation seed; `progress` is called with the number of finished episodes.
pub fn play_episodes(
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    evaluation: Seed,
    episodes: usize,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<EpisodeReport>> {
    let mut reports = Vec::with_capacity(episodes);
    for episode in 0..episodes {
        reports.push(play(simulator, controller, episode_seed(evaluation, episode))?);
        progress(episode + 1);
    }
    Ok(reports)
}

/// Returns the figures of the whole system, by name, with one value per episode.
///
/// The mean return of the agents comes first, then the measures of the system.
pub fn figures(episodes: &[EpisodeReport]) -> Vec<(String, Vec<f64>)> {
    let returns = episodes.iter().map(|episode| mean(&episode.returns)).collect();
    let measures = episodes[0].measures.system.iter().enumerate().map(|(index, (name, _))| {
        (name.clone(), episodes.iter().map(|episode| episode.measures.system[index].1).collect())
    });
    [(RETURN.to_owned(), returns)].into_iter().chain(measures).collect()
}

fn mean_measures(episodes: &[EpisodeReport]) -> Measures {
    let mut means = episodes[0].measures.clone();
    let over_episodes = |value: &dyn Fn(&Measures) -> f64| {
        mean(&episodes.iter().map(|episode| value(&episode.measures)).collect::<Vec<_>>())
    };
    for (index, (_, values)) in means.per_agent.iter_mut().enumerate() {
        for (agent, value) in values.iter_mut().enumerate() {
            *value = over_episodes(&|measures| measures.per_agent[index].1[agent]);
        }
    }
    for (index, (_, value)) in means.system.iter_mut().enumerate() {
        *value = over_episodes(&|measures| measures.system[index].1);
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::domain::BuiltInControl;
    use dials_testkit::toy::{Coins, CoinsAndDice};

    fn report(returns: [f64; 2]) -> EpisodeReport {
        EpisodeReport { returns: returns.to_vec(), measures: Measures::default() }
    }

    #[test]
    fn summaries_are_worked_out_by_hand() {
        let evaluation =
            Evaluation::new(&Coins::new(1), &[report([1.0, 10.0]), report([2.0, 20.0]), report([6.0, 0.0])]);
        // All: episode means 5.5, 11, 3: mean 6.5, deviation sqrt((1 + 20.25 + 12.25) / 2) = 4.0927, error 2.3629;
        // the median of the agents' means 3 and 10 is 6.5.
        let all = evaluation.of_all();
        assert_eq!((all.mean, all.median), (6.5, 6.5));
        assert!((all.std_error - 2.362_908).abs() < 1e-6);
    }

    #[test]
    fn each_kind_has_its_own_test_for_stuck_agents() {
        let domain = CoinsAndDice::new(20);
        let mut simulator = domain.global_simulator().unwrap();
        // All agents always take action 0. That is degenerate for the coins 0 and 2, and not for the dice 1 and 3.
        let episodes = play_episodes(&mut *simulator, &mut BuiltInControl, Seed::new(1), 2, &mut |_| ()).unwrap();
        assert_eq!(Evaluation::new(&domain, &episodes).stuck, [true, false, true, false]);
        let mut best = domain.baseline("best").unwrap();
        let episodes = play_episodes(&mut *best.simulator, &mut *best.controller, Seed::new(1), 2, &mut |_| ());
        assert_eq!(Evaluation::new(&domain, &episodes.unwrap()).stuck, [false; 4]);
    }
}
