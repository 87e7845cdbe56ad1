//! The one model of what a run costs. Everything that predicts a cost is in its terms: `bench` from short orders to a real
//! fleet, an experiment from measured runs, a report from the CPU time of runs, and the model of a cluster.
//!
//! - [`Workload`]: the amounts of work in a run, from its schedule.
//! - [`Prices`]: the cost of one unit of each kind of work, in any unit: seconds, or microseconds with their parts.
//!   [`RunCost`]: the cost of the run.
//! - [`Sharing`]: how much of a time any number of cores can share.

use std::ops::{Add, Mul};

use crate::config::RunConfig;
use dials_learn::config::{AipTraining, schedule};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Workload {
    pub(crate) agents: usize,
    /// Timesteps per agent.
    pub steps: u64,
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
    pub dataset_episodes: usize,
    /// Number of episodes of the first dataset.
    pub first_dataset_episodes: usize,
    /// Number of passes of a training of the AIPs over its dataset.
    pub epochs: usize,
}

impl Workload {
    /// Computes the work until the timestep `until` per agent, with the evaluation at the end.
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
            first_dataset_episodes: config.learning.first_dataset_episodes(horizon),
            epochs: config.learning.aip.epochs,
        }
    }

    /// Returns the work of all trainings of the AIPs, in trainings on a whole dataset: the first may be on another one.
    pub(crate) fn whole_retrainings(&self) -> f64 {
        match self.retrainings {
            0 => 0.0,
            all => (all - 1) as f64 + self.first_dataset_episodes as f64 / self.dataset_episodes as f64,
        }
    }

    pub(crate) fn agent_steps(&self) -> f64 {
        self.agents as f64 * self.steps as f64
    }

    /// Returns the timesteps of all agents that are replayed after periods: half an episode of every row on average.
    pub(crate) fn retraced_steps(&self) -> f64 {
        self.periods.saturating_sub(1) as f64 * (self.agents * self.copies * self.training_horizon) as f64 / 2.0
    }

    /// Returns the timesteps of all agents in this number of episodes on the GS.
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

/// Price of each kind of work. `T`: a number, or several numbers that are added up separately.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Prices<T> {
    /// A timestep of an agent in training.
    pub(crate) step: T,
    /// A timestep of an agent that is replayed to continue after a period.
    pub(crate) retraced_step: T,
    pub(crate) period: T,
    pub(crate) evaluation: T,
    pub(crate) final_evaluation: T,
    pub(crate) collection: T,
    pub(crate) aip_training: T,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RunCost<T> {
    pub(crate) training: T,
    pub(crate) evaluation: T,
    pub(crate) collection: T,
    pub(crate) aip_training: T,
}

impl<T: Copy + Add<Output = T> + Mul<f64, Output = T>> Prices<T> {
    pub(crate) fn of_run(&self, work: &Workload) -> RunCost<T> {
        let retrainings = work.whole_retrainings();
        RunCost {
            training: self.step * work.agent_steps()
                + self.retraced_step * work.retraced_steps()
                + self.period * work.periods as f64,
            evaluation: self.evaluation * work.evaluations as f64 + self.final_evaluation,
            collection: self.collection * retrainings,
            aip_training: self.aip_training * retrainings,
        }
    }
}

impl<T: Add<Output = T>> RunCost<T> {
    pub(crate) fn sum(self) -> T {
        self.training + self.evaluation + self.collection + self.aip_training
    }
}

/// Time of some work on one core, by how many cores can share it.
/// A core has whole agents, so more cores than agents do not train faster, and more than episodes do not evaluate faster.
/// There is no waiting and no message in it, and no core is slower when its neighbours work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sharing {
    /// Seconds of work for one core only.
    pub alone_s: f64,
    /// Seconds of work that cores share.
    pub shared_s: f64,
    /// Largest number of cores that can share it.
    pub most: usize,
}

impl Sharing {
    pub fn seconds(&self, cores: usize) -> f64 {
        self.alone_s + self.shared_s / cores_at_work(cores, self.most)
    }

    /// Returns the smallest number of cores on which this takes less time than `other`; `None` if there is none.
    pub fn faster_from(&self, other: &Sharing) -> Option<usize> {
        (1..=self.most).find(|&cores| self.seconds(cores) < other.seconds(cores))
    }
}

/// Returns how many of `cores` work if at most `most` can.
pub(crate) fn cores_at_work(cores: usize, most: usize) -> f64 {
    cores.min(most).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_learn::config::ShortForm;

    #[test]
    fn the_work_and_the_cost_of_a_run_are_counted_by_hand() {
        // Periods of 100 steps, an evaluation at the beginning of each, AIPs trained at 0 and at 500.
        let config: RunConfig = toml::from_str(
            "total_steps = 1000\nwarehouse = { agents_per_side = 2, horizon = 10 }\nlocal_simulators = { copies = 3 }\n\
             ppo = { memory = 100 }\n\
             aip = { epochs = 7, batch = 8, dataset_steps = 40, first_dataset_share = 0.5, retrain_every_steps = 500 }\n\
             evaluation = { every_steps = 100, episodes = 3, final_episodes = 5 }",
        )
        .unwrap();
        let whole = Workload::of(&config, 4, 1000);
        assert_eq!((whole.periods, whole.evaluations), (10, 10));
        assert_eq!((whole.retrainings, whole.first_dataset_episodes, whole.dataset_episodes), (2, 2, 4));
        assert_eq!(whole.whole_retrainings(), 1.5);
        assert_eq!(whole.agent_steps(), 4000.0);
        // Nine periods continue in the middle of 4 x 3 episodes of 10 steps.
        assert_eq!(whole.retraced_steps(), 540.0);
        // 10 x 3 + 5 episodes of 10 steps; 4 episodes of 10 steps in 7 epochs.
        assert_eq!((whole.evaluated_steps(), whole.samples_per_retraining()), (1400.0, 1120.0));
        let prices = Prices {
            step: 1.0,
            retraced_step: 10.0,
            period: 1000.0,
            evaluation: 2.0,
            final_evaluation: 0.5,
            collection: 3.0,
            aip_training: 5.0,
        };
        let cost = prices.of_run(&whole);
        assert_eq!(cost, RunCost { training: 19_400.0, evaluation: 20.5, collection: 4.5, aip_training: 7.5 });
        assert_eq!(cost.sum(), 19_432.5);
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

    #[test]
    fn cores_share_agents_and_on_the_gs_only_updates() {
        let local = Sharing { alone_s: 0.0, shared_s: 100.0, most: 4 };
        let global = Sharing { alone_s: 30.0, shared_s: 8.0, most: 4 };
        assert_eq!([1, 2, 4, 128].map(|cores| local.seconds(cores)), [100.0, 50.0, 25.0, 25.0]);
        assert_eq!([1, 2, 4, 128].map(|cores| global.seconds(cores)), [38.0, 34.0, 32.0, 32.0]);
        assert_eq!(local.faster_from(&global), Some(4));
        assert_eq!(Sharing { shared_s: 200.0, ..local }.faster_from(&global), None);
    }
}
