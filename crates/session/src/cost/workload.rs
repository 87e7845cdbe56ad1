//! The amounts of work in a run.

use crate::config::RunConfig;
use dials_learn::config::{AipTraining, schedule};

/// Work of a run of `agents` agents. AIPs: approximate influence predictors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Workload {
    pub(crate) agents: usize,
    /// Timesteps per agent.
    pub steps: u64,
    /// Number of steps of an episode.
    pub horizon: usize,
    /// Number of steps of an episode of what the policies train on.
    pub(crate) training_horizon: usize,
    /// Number of simulator rows per agent.
    pub(crate) copies: usize,
    /// Number of periods: stretches of training between two exchanges of the workers.
    pub(crate) periods: usize,
    /// Number of evaluations before and between periods.
    pub evaluations: usize,
    /// Number of episodes of each of them. The evaluation at the end has its own number.
    pub evaluation_episodes: usize,
    pub final_episodes: usize,
    /// Number of trainings of the AIPs, each with a collection before it.
    pub retrainings: usize,
    /// Number of episodes of a collection.
    pub dataset_episodes: usize,
    /// Number of passes of a training of the AIPs over its dataset.
    pub epochs: usize,
}

impl Workload {
    /// Computes the work until the timestep `until` per agent, with the evaluation at the end.
    ///
    /// With `aip.retrain = "drift"` only the certain trainings count, because drift cannot be foreseen.
    pub fn of(config: &RunConfig, agents: usize, until: u64) -> Workload {
        let periods = schedule(&config.learning);
        let begun = || periods.iter().filter(|period| period.start < until);
        let horizon = config.horizon();
        Workload {
            agents,
            steps: until,
            horizon,
            training_horizon: config.training_horizon(),
            copies: config.learning.copies(),
            periods: begun().count(),
            evaluations: begun().filter(|period| period.evaluate).count(),
            evaluation_episodes: config.learning.evaluation.episodes,
            final_episodes: config.learning.evaluation.final_episodes,
            retrainings: begun().filter(|period| period.train_aips == AipTraining::Yes).count(),
            dataset_episodes: config.learning.dataset_episodes(horizon),
            epochs: config.learning.aip.epochs,
        }
    }

    /// Returns the timesteps of all agents in training.
    pub(crate) fn agent_steps(&self) -> f64 {
        self.agents as f64 * self.steps as f64
    }

    /// Returns the timesteps of all agents that simulators replay to continue after a period. The episodes under way at
    /// that point are half over on average.
    pub(crate) fn retraced_steps(&self) -> f64 {
        self.periods.saturating_sub(1) as f64 * (self.agents * self.copies * self.training_horizon) as f64 / 2.0
    }

    /// Returns the timesteps of all agents in this number of episodes on the GS (global simulator).
    pub(crate) fn gs_steps(&self, episodes: usize) -> f64 {
        self.agents as f64 * episodes as f64 * self.horizon as f64
    }

    /// Returns the timesteps of all agents in all evaluations.
    pub(crate) fn evaluated_steps(&self) -> f64 {
        self.gs_steps(self.evaluations * self.evaluation_episodes + self.final_episodes)
    }

    /// Returns the samples of all agents in one training of the AIPs; each epoch counts again.
    pub(crate) fn samples_per_retraining(&self) -> f64 {
        self.gs_steps(self.dataset_episodes) * self.epochs as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_learn::config::ShortForm;

    #[test]
    fn the_work_of_a_run_is_counted_by_hand() {
        // Periods of 100 steps, an evaluation at the beginning of each, AIPs trained at 0 and at 500.
        let config: RunConfig = toml::from_str(
            "total_steps = 1000\nwarehouse = { agents_per_side = 2, horizon = 10 }\nlocal_simulators = { copies = 3 }\n\
             ppo = { memory = 100 }\n\
             aip = { epochs = 7, dataset_steps = 40, retrain_every_steps = 500 }\n\
             evaluation = { every_steps = 100, episodes = 3, final_episodes = 5 }",
        )
        .unwrap();
        let whole = Workload::of(&config, 4, 1000);
        assert_eq!((whole.periods, whole.evaluations, whole.retrainings, whole.dataset_episodes), (10, 10, 2, 4));
        assert_eq!(whole.agent_steps(), 4000.0);
        // Nine periods continue in the middle of 4 x 3 episodes of 10 steps.
        assert_eq!(whole.retraced_steps(), 540.0);
        // 10 x 3 + 5 episodes of 10 steps; 4 episodes of 10 steps in 7 epochs.
        assert_eq!((whole.evaluated_steps(), whole.samples_per_retraining()), (1400.0, 1120.0));
        let half = Workload::of(&config, 4, 500);
        assert_eq!((half.periods, half.evaluations, half.retrainings), (5, 5, 1));
        assert_eq!(half.evaluated_steps(), 800.0);
    }

    #[test]
    fn local_simulators_of_a_scenario_replay_their_own_shorter_episodes() {
        // 720 decisions from begin to end, 120 of them in a local episode.
        let text = "total_steps = 1000\nppo = { memory = 100, rollout_steps = 20, minibatch = 20 }\n\
                    aip = { retrain_every_steps = 500 }\nevaluation = { every_steps = 500 }\n\
                    traffic = { scenario = 's.sumocfg', begin_s = 0, end_s = 3600 }\n";
        let retraced = |simulator: &str| {
            let config: RunConfig =
                toml::from_str(&format!("{}{text}", ShortForm::called(simulator).unwrap().keys())).unwrap();
            let work = Workload::of(&config, 4, 1000);
            (work.horizon, work.retraced_steps())
        };
        // One period continues in the middle of the episodes of 4 agents.
        assert_eq!((retraced("dials"), retraced("gs")), ((720, 240.0), (720, 1440.0)));
    }
}
