//! The unit in which a critic learns: a value is `mean + spread x output of the network`.
//!
//! Values of different domains differ by orders of magnitude, and a network that begins near 0 needs many small steps to
//! large ones. Until it is there, advantages are mostly its error. So mean and spread follow the returns of an agent,
//! and the network learns what is left: numbers of about 1.
//!
//! # Why not otherwise
//!
//! **Why do values change when mean and spread do?** PopArt (van Hasselt et al. 2016) changes the last layer with them, so that
//! no value changes. But then the critic still has to climb. With four lights and 20K steps, PopArt came to a return of 192,
//! a spread alone to 191, and mean and spread to 206 (n = 3; docs/ppo.md).

use std::ops::Range;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::memory::Memory;
use dials_core::base::Ragged;

/// Unit in which values are learnt, clipped and weighed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ValueUnit {
    /// That of the reward.
    #[default]
    Reward,
    /// The spread of an agent's returns, counted from their mean. Both follow the returns.
    Returns,
}

/// Share of the newest memory in the running mean and variance of returns. The first memories count more.
const NEWEST: f32 = 0.1;

/// Smallest spread, for agents whose returns never differ.
const SMALLEST_SPREAD: f32 = 1e-4;

/// The unit of one agent's critic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Unit {
    /// What an output of 0 stands for.
    mean: f32,
    /// What an output of 1 stands for, beyond the mean.
    pub(super) spread: f32,
}

impl Unit {
    pub(super) fn value_of(self, output: f32) -> f32 {
        self.mean + self.spread * output
    }

    pub(super) fn output_of(self, value: f32) -> f32 {
        (value - self.mean) / self.spread
    }
}

/// Running mean and variance of an agent's returns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Running {
    mean: f32,
    variance: f32,
    /// Weight of all memories so far; it grows from 0 to 1.
    weight: f32,
}

/// The units of all agents of a learner.
#[derive(Clone, Debug, PartialEq)]
pub struct ValueUnits {
    choice: ValueUnit,
    running: Vec<Running>,
}

impl ValueUnits {
    /// Number of values per agent in a table.
    pub(super) const WIDTH: usize = 3;

    pub fn new(choice: ValueUnit, agents: usize) -> ValueUnits {
        ValueUnits { choice, running: vec![Running::default(); agents] }
    }

    pub(super) fn of(&self, agent: usize) -> Unit {
        let Running { mean, variance, weight } = self.running[agent];
        if weight == 0.0 {
            return Unit { mean: 0.0, spread: 1.0 };
        }
        Unit { mean, spread: variance.sqrt().max(SMALLEST_SPREAD) }
    }

    /// Takes in the returns of a full memory. `shared`: whether those of all agents count for each.
    pub(super) fn follow(&mut self, memory: &Memory, shared: bool) {
        if self.choice == ValueUnit::Reward {
            return;
        }
        let agents = self.running.len();
        if shared {
            self.running[0].take_in(memory, 0..agents);
            self.running = vec![self.running[0]; agents];
        } else {
            self.running.iter_mut().enumerate().for_each(|(agent, running)| running.take_in(memory, agent..agent + 1));
        }
    }

    /// Returns a row of [`ValueUnits::WIDTH`] values per agent.
    pub(super) fn table(&self) -> Ragged<f32> {
        let values = self.running.iter().flat_map(|of| [of.mean, of.variance, of.weight]).collect();
        Ragged::from_vec(values, vec![Self::WIDTH; self.running.len()]).expect("as many values as there are")
    }

    pub(super) fn load(&mut self, table: &Ragged<f32>) {
        for (running, row) in self.running.iter_mut().zip(table.iter()) {
            *running = Running { mean: row[0], variance: row[1], weight: row[2] };
        }
    }
}

impl Running {
    /// Takes in the returns of some agents in a memory.
    fn take_in(&mut self, memory: &Memory, agents: Range<usize>) {
        let returns = || agents.clone().flat_map(|agent| memory.samples(agent)).map(|sample| f64::from(sample.ret));
        let count = returns().count() as f64;
        let exact_mean = returns().sum::<f64>() / count;
        let variance = (returns().map(|ret| (ret - exact_mean).powi(2)).sum::<f64>() / count) as f32;
        let mean = exact_mean as f32;
        self.weight += NEWEST * (1.0 - self.weight);
        let share = NEWEST / self.weight;
        let apart = mean - self.mean;
        self.mean += share * apart;
        self.variance = (1.0 - share) * (self.variance + share * apart * apart) + share * variance;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algorithms::ppo::Sample;
    use crate::fixtures::region;
    use dials_core::domain::SourceSpec;

    /// Returns a memory of two agents whose samples have these returns.
    fn memory(returns: [[f32; 2]; 2]) -> Memory {
        let mut memory = Memory::new(2, 2, 1, &region(1, 1, SourceSpec::bits(1), 4), 0);
        for (agent, returns) in returns.iter().enumerate() {
            for (slot, &ret) in returns.iter().enumerate() {
                memory.remember(agent, slot, (&[0.0], &[]), &[], Sample { ret, ..Sample::default() });
            }
        }
        memory
    }

    #[test]
    fn mean_and_spread_follow_the_returns_of_an_agent_and_the_first_memory_counts_in_full() {
        let mut units = ValueUnits::new(ValueUnit::Returns, 2);
        assert_eq!(units.of(0).value_of(0.5), 0.5);
        units.follow(&memory([[4.0, 8.0], [-1.0, -1.0]]), false);
        assert_eq!(units.of(0), Unit { mean: 6.0, spread: 2.0 });
        assert_eq!([units.of(0).value_of(-1.5), units.of(0).output_of(3.0)], [3.0, -1.5]);
        assert_eq!(units.of(1), Unit { mean: -1.0, spread: SMALLEST_SPREAD }, "returns that do not differ");
        units.follow(&memory([[16.0, 16.0], [0.0, 0.0]]), false);
        // Weights .9 and 1 of 1.9: the newer one has 1 / 1.9 = .52632. Mean 6 + .52632 * 10 = 11.2632; variance
        // .47368 * (4 + .52632 * 100) + .52632 * 0 = 26.8255.
        let Unit { mean, spread } = units.of(0);
        assert!((mean - 11.2632).abs() < 1e-3 && (spread - 26.8255_f32.sqrt()).abs() < 1e-3, "{mean} {spread}");
        let mut other = ValueUnits::new(ValueUnit::Returns, 2);
        other.load(&units.table());
        assert_eq!(other, units);
    }

    #[test]
    fn agents_that_share_a_policy_have_one_unit_and_without_a_choice_it_is_the_rewards() {
        let returns = memory([[4.0, 8.0], [0.0, 0.0]]);
        let mut units = ValueUnits::new(ValueUnit::Returns, 2);
        units.follow(&returns, true);
        assert_eq!(units.of(0), units.of(1));
        assert_eq!(units.of(0).mean, 3.0);
        let mut none = ValueUnits::new(ValueUnit::Reward, 2);
        none.follow(&returns, false);
        assert_eq!(none.of(0), Unit { mean: 0.0, spread: 1.0 });
    }
}
