//! Two coupled coins: the smallest possible domain.
//!
//! Each of two agents has a coin and sees the other's through noise. At a step, agent `i` lays its coin as its action
//! says, `x_i' = a_i`. It then sees its neighbour's coin, wrongly with probability [`NOISE`]. This reading is its
//! influence source, `u_i = a_j xor noise`, and becomes part of its local state, `y_i' = u_i`. The reward is 1 for
//! laying the coin as the neighbour's was last seen, `a_i = y_i`.
//!
//! - Random coins earn half of the horizon; copying what was seen earns all of it.
//! - If the neighbour lays coins at random, `u_i` is a fair coin: cross-entropy ln 2.
//! - If the neighbour copies what it sees, `P(u_i = x_i) = (1 - e)^2 + e^2 = 0.68` for `e = 0.2`. My coin passes first
//!   the neighbour's eyes and then mine. Cross-entropy: `H(0.32) = 0.6269`.

use anyhow::bail;
use rand::Rng;

use dials_core::base::{AgentId, Dice, Ragged, RandomPurpose, Rows, Seed};
use dials_core::domain::{
    Action, Baseline, Beginning, Controller, Domain, GlobalSimulator, InfluenceSample, JointPercept, JointTransition,
    Kinds, LocalSimulator, Percept, RegionSpec, Result, Scenario, SourceSpec, Transition,
};

/// Probability that a coin is seen wrongly.
pub const NOISE: f64 = 0.2;
const AGENTS: usize = 2;

pub struct Coins {
    kinds: Kinds,
}

impl Coins {
    pub fn new(horizon: usize) -> Self {
        let sources = SourceSpec::bits(1);
        let spec = RegionSpec {
            obs_dim: 2,
            d_set_dim: 2,
            n_actions: 2,
            masks: false,
            sources,
            horizon,
            local_horizon: horizon,
        };
        Coins { kinds: Kinds::one(AGENTS, spec) }
    }
}

impl Domain for Coins {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>> {
        Ok(Box::new(GlobalCoins {
            kinds: self.kinds.clone(),
            last: JointTransition::new(&self.kinds),
            noise: Seed::new(0).dice(),
            d_set: Ragged::new([2; AGENTS]),
            sources: Ragged::new([1; AGENTS]),
        }))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, _seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        let spec = self.kinds[0].spec.clone();
        Ok(Box::new(LocalCoins { last: Transition::new(regions.len() * copies, &spec), spec }))
    }

    fn scenario(&self) -> Result<Scenario> {
        Ok(Scenario::new("coins", AGENTS, self.kinds.horizon()))
    }

    fn baselines(&self) -> &'static [&'static str] {
        &["random", "copy"]
    }

    fn baseline(&self, name: &str) -> Result<Baseline> {
        let controller: Box<dyn Controller> = match name {
            "random" => Box::new(LayAtRandom { dice: Seed::new(0).dice() }),
            "copy" => Box::new(CopyTheNeighbour),
            _ => bail!("controller `{name}`: unknown; one of {}", self.baselines().join(", ")),
        };
        Ok(Baseline { simulator: self.global_simulator()?, controller })
    }
}

/// Writes what a region shows to its agent and to its AIP: both coins.
fn show(obs: &mut [f32], d_set: &mut [f32], coins: [f32; 2]) {
    obs.copy_from_slice(&coins);
    d_set.copy_from_slice(&coins);
}

/// Makes the local transition and returns the reward.
fn step(obs: &mut [f32], d_set: &mut [f32], action: Action, source: u8) -> f32 {
    let seen = obs[1];
    show(obs, d_set, [f32::from(action), f32::from(source)]);
    f32::from(f32::from(action) == seen)
}

struct GlobalCoins {
    kinds: Kinds,
    last: JointTransition,
    noise: Dice,
    d_set: Ragged<f32>,
    sources: Ragged<u8>,
}

impl GlobalSimulator for GlobalCoins {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        self.noise = episode.fork(RandomPurpose::Noise).dice();
        self.last.percept.obs.fill(0.0);
        self.last.percept.d_set.fill(0.0);
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        let JointTransition { percept: JointPercept { obs, d_set, .. }, rewards } = &mut self.last;
        self.d_set.copy_from(d_set);
        for agent in 0..AGENTS {
            let neighbour = actions[1 - agent];
            let source = neighbour ^ u8::from(self.noise.random_bool(NOISE));
            self.sources.row_mut(agent)[0] = source;
            rewards[agent] = step(obs.row_mut(agent), d_set.row_mut(agent), actions[agent], source);
        }
        Ok(&self.last)
    }

    fn influence_sample(&self) -> InfluenceSample<'_> {
        InfluenceSample { d_set: &self.d_set, sources: &self.sources }
    }
}

struct LocalCoins {
    spec: RegionSpec,
    last: Transition,
}

impl LocalSimulator for LocalCoins {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn rows(&self) -> usize {
        self.last.rewards.len()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        let Percept { obs, d_set, .. } = &mut self.last.percept;
        begin.iter().for_each(|&Beginning { row, .. }| show(obs.row_mut(row), d_set.row_mut(row), [0.0, 0.0]));
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        let Transition { percept: Percept { obs, d_set, .. }, rewards } = &mut self.last;
        for (row, (&action, source)) in actions.iter().zip(sources.iter()).enumerate() {
            rewards[row] = step(obs.row_mut(row), d_set.row_mut(row), action, source[0]);
        }
        Ok(&self.last)
    }
}

struct LayAtRandom {
    dice: Dice,
}

impl Controller for LayAtRandom {
    fn begin(&mut self, episode: Seed) {
        self.dice = episode.fork(RandomPurpose::Acting).dice();
    }

    fn act(&mut self, _percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        actions.iter_mut().for_each(|action| *action = self.dice.random_range(0..2));
        Ok(())
    }
}

struct CopyTheNeighbour;

impl Controller for CopyTheNeighbour {
    fn begin(&mut self, _episode: Seed) {}

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        for (action, obs) in actions.iter_mut().zip(percept.obs.iter()) {
            *action = obs[1] as Action;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use dials_learn::evaluation::play;

    #[test]
    fn the_coins_conform() {
        let measured = conformance::check(&Coins::new(20), Seed::new(1)).unwrap();
        assert_eq!((measured.recall, measured.precision, measured.reward_error), (1.0, 1.0, 0.0), "they are exact");
    }

    #[test]
    fn copying_earns_everything_and_random_coins_half() {
        let total = |name: &str| {
            let mut baseline = Coins::new(1000).baseline(name).unwrap();
            let report = play(&mut *baseline.simulator, &mut *baseline.controller, Seed::new(3)).unwrap();
            report.returns.iter().sum::<f64>() / 2.0
        };
        assert_eq!(total("copy"), 1000.0);
        // 2000 fair coins: standard deviation of the mean total 500 is 1000 * 0.5 / sqrt(2000) = 11.
        assert!((total("random") - 500.0).abs() < 45.0);
    }
}
