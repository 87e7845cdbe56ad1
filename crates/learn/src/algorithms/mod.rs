//! The algorithms that train policies: one folder each.
//!
//! A [`Learner`] trains the policies of some agents of one kind, from what they experience decision by decision. It
//! sees no simulator, and nothing outside its folder knows which algorithm it is: what it keeps between periods are
//! named [`Tables`], and what it reports are [`Metrics`] by name.
//!
//! - [`ppo`]: proximal policy optimisation, as in the paper. [`dqn`]: deep Q-learning. [`outside`]: a learner in Python.
//! - [`imitation`]: policies that begin by imitating a hand-coded controller.
//! - [`averaging`]: agents that get the mean of their policies.
//! - `tables`: what a learner keeps, and what it reports.
//!
//! A new algorithm is a folder with its [`Algorithm`] and its [`Learner`], and a line in the list below.

pub(crate) mod averaging;
pub(crate) mod dqn;
pub mod imitation;
pub mod outside;
pub mod ppo;
mod tables;

use std::fmt::Debug;

use crate::config::Config;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::environments::Experience;
use crate::policy::{PolicyStack, Reading};
use crate::state::stream::Part;
use dials_core::base::{AgentId, Stopwatch};
use dials_core::domain::{Action, Kind, Percept, RegionSpec, Result};
use stacknets::{Shape, Threads};

pub(crate) use tables::check_finite;
pub use tables::{Layout, Metrics, NumberTable, Tables};

/// Settings of an algorithm: its table in a config.
pub trait Algorithm: Debug {
    /// Returns an error that names the key if a value makes no sense, alone or with the rest of the config.
    fn check(&self, config: &Config) -> Result<()>;

    /// Returns the timesteps per agent between two updates of the policies. Periods end at multiples of it.
    fn steps_per_update(&self) -> usize {
        self.updates().1 as usize
    }

    /// Returns the key that says how many timesteps per agent there are between two updates, and its value.
    fn updates(&self) -> (&'static str, u64);

    /// Returns after how many decisions of every row the learner looks at them: a divisor of those between two updates.
    /// Until then lanes are played side by side.
    fn decisions_in_a_round(&self) -> usize {
        1
    }

    fn reading(&self) -> Reading;

    /// Makes the learner of some agents of one kind. `stack`: their policies, one row per agent; `parts`: the rows of
    /// each lane, together all of theirs.
    fn learner(
        &self,
        config: &Config,
        spec: &RegionSpec,
        agents: &[AgentId],
        stack: PolicyStack,
        parts: &[Part],
    ) -> Box<dyn Learner>;

    /// Returns which tables its learner keeps, and how large they are for an agent of this kind after this number of
    /// timesteps.
    fn layout(&self, config: &Config, kind: &Kind, steps: u64) -> Layout;

    /// Returns the key of the learning rate of the update before this timestep per agent, for advice.
    fn learning_rate_key(&self, config: &Config, steps: u64) -> &'static str;

    /// Returns the floating-point operations in matrix products that an agent needs per timestep, to act and to learn.
    /// `shape`: that of its network; `horizon`: steps of an episode.
    fn flops_per_step(&self, config: &Config, shape: &Shape, horizon: usize) -> f64;
}

/// Makes the list of algorithms: the name in configs, and the table with its settings.
macro_rules! algorithms {
    ($($(#[$about:meta])* $Name:ident = $table:ident),* $(,)?) => {
        /// An algorithm, as a config names it.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
        #[serde(rename_all = "kebab-case")]
        pub enum AlgorithmName {
            $($(#[$about])* $Name,)*
        }

        pub fn of(config: &Config) -> &dyn Algorithm {
            match config.algorithm {
                $(AlgorithmName::$Name => &config.$table,)*
            }
        }

        /// Returns the name of the table of the config's algorithm, and those of all others.
        pub fn tables(config: &Config) -> (&'static str, Vec<&'static str>) {
            let own = match config.algorithm {
                $(AlgorithmName::$Name => stringify!($table),)*
            };
            (own, [$(stringify!($table)),*].into_iter().filter(|table| *table != own).collect())
        }
    };
}

// A new algorithm is a folder, a line here, and its table in `Config`.
algorithms! {
    /// Proximal policy optimisation, as in the paper.
    #[default]
    Ppo = ppo,
    /// Deep Q-learning from a replay.
    Dqn = dqn,
    /// A learner in Python: `dials_traffic.dials`.
    Outside = outside,
}

/// Acts in one lane, and writes down what that brings. Nothing that it does depends on another lane.
pub trait Actor: Send {
    fn act(&mut self, percept: &Percept) -> Vec<Action>;

    /// Takes in what the last actions brought. `next`: what the rows show now.
    fn take_in(&mut self, experience: &Experience, next: &Percept, watch: &mut Stopwatch);
}

/// Trains the policies of some agents of one kind. Agents never learn from each other's experience unless the config
/// says so, and every draw comes from dice of its agent: how agents are grouped changes no number.
///
/// Rows are ordered by agent, then by copy. Those of a lane are a [`Part`] of them.
pub trait Learner {
    fn policies(&self) -> &PolicyStack;

    /// Returns the policies, to be changed: by an imitation, or by a state.
    fn policies_mut(&mut self) -> &mut PolicyStack;

    /// Looks at what every lane shows before a round, after this number of timesteps per agent. For learners that decide for all
    /// lanes at once.
    fn look(&mut self, _lanes: &[&Percept], _steps: u64, _watch: &mut Stopwatch) -> Result<()> {
        Ok(())
    }

    /// Returns who acts in each lane for a round. `threads`: those that one lane may use.
    fn actors<'a>(&'a mut self, threads: &'a Threads) -> Vec<Box<dyn Actor + 'a>>;

    /// Takes in what all lanes brought in a round, and updates the policies if that is due. `steps`: timesteps per agent, with
    /// those of the round. Returns the metrics of the update, if there was one.
    fn learn(&mut self, steps: u64, watch: &mut Stopwatch) -> Result<Option<Metrics>>;

    /// Returns the metrics that its updates have, with values of 0.
    fn no_metrics(&self) -> Metrics;

    /// Ends a period: gets ready to say what it keeps.
    fn leave(&mut self) -> Result<()> {
        Ok(())
    }

    /// Returns what it keeps from one period to the next, beside the policies. It is called between two updates only.
    fn tables(&self) -> Tables;

    fn load(&mut self, tables: Tables);
}
