//! Randomness by name: every draw comes from the stream of its (run, purpose, agent, copy, episode).
//!
//! A stream depends only on its name, never on what other streams drew. So the numbers of a run do not change with the
//! number of workers, the order of the agents or a feature that draws more.

use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

use super::{AgentId, RandomPurpose};

/// Generator of every random number: small (32 bytes) and fast, and its state can be saved.
pub type Dice = Xoshiro256PlusPlus;

/// Name in the tree of random streams; the root is the seed of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seed(u64);

impl Seed {
    /// Makes the root of a run's streams.
    pub fn new(run: u64) -> Self {
        Seed(mix(run))
    }

    pub fn fork(self, purpose: RandomPurpose) -> Self {
        self.fork_named(purpose.name())
    }

    /// Returns the stream of a purpose that is not in the list: for domains and controllers of other crates, and for
    /// tests.
    pub fn fork_named(self, purpose: &str) -> Self {
        // FNV-1a: the standard library's hasher is not stable between Rust versions, and runs must repeat.
        let name = purpose
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
        self.child(name)
    }

    pub fn for_agent(self, agent: AgentId) -> Self {
        self.fork(RandomPurpose::Agent).child(agent.0 as u64)
    }

    /// Returns the generators of some agents, each from the agent's own stream.
    pub fn for_agents(self, agents: &[AgentId]) -> impl ExactSizeIterator<Item = Dice> {
        agents.iter().map(move |&agent| self.for_agent(agent).dice())
    }

    pub fn for_copy(self, copy: usize) -> Self {
        self.fork(RandomPurpose::Copy).child(copy as u64)
    }

    pub fn for_episode(self, episode: usize) -> Self {
        self.fork(RandomPurpose::Episode).child(episode as u64)
    }

    /// Returns the stream of an event at this number of timesteps per agent.
    pub fn for_steps(self, steps: u64) -> Self {
        self.fork(RandomPurpose::Steps).child(steps)
    }

    pub fn dice(self) -> Dice {
        Dice::seed_from_u64(self.0)
    }

    /// Returns the seed for a generator of another crate.
    pub fn bits(self) -> u64 {
        self.0
    }

    /// Returns a seed for SUMO, which takes a non-negative 31-bit integer.
    pub fn for_sumo(self) -> u32 {
        (self.0 >> 33) as u32
    }

    fn child(self, name: u64) -> Self {
        Seed(mix(self.0 ^ mix(name)))
    }
}

fn mix(value: u64) -> u64 {
    scramble(value.wrapping_add(0x9e37_79b9_7f4a_7c15))
}

/// Returns whether dice are in the one state that they never leave. No seed leads to it.
pub fn is_stuck(dice: &Dice) -> bool {
    // All other states are in one cycle, so no other is its own successor.
    let mut next = dice.clone();
    next.next_u64();
    next == *dice
}

/// Applies the finaliser of SplitMix64 (Steele et al. 2014): a bijection in which every input bit reaches every output
/// bit.
pub fn scramble(bits: u64) -> u64 {
    let z = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn agents_copies_episodes_steps_and_purposes_have_streams_of_their_own() {
        let run = Seed::new(1);
        let mut seeds = vec![run.fork_named("a"), run.fork_named("b"), Seed::new(2)];
        for i in 0..100 {
            seeds.extend([run.for_agent(AgentId(i)), run.for_copy(i), run.for_episode(i), run.for_steps(i as u64)]);
        }
        let different: HashSet<u64> = seeds.iter().map(|seed| seed.0).collect();
        assert_eq!(different.len(), seeds.len());
    }
}
