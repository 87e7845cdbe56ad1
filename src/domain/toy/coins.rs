//! Two coupled coins: the smallest domain there is, with closed-form answers, for tests and as an example.
//!
//! Each of two agents has a coin and sees the other's through noise. At a step agent `i` lays its coin as its action
//! says, `x_i' = a_i`, and then sees its neighbour's, which is wrong with probability [`NOISE`]: this reading is its
//! influence source, `u_i = a_j xor noise`, and becomes part of its local state, `y_i' = u_i`. The reward is 1 for
//! laying the coin as the neighbour's was last seen, `a_i = y_i`.
//!
//! - Random coins earn half of the horizon, copying what was seen earns all of it.
//! - Where the neighbour lays coins at random, `u_i` is a fair coin: cross-entropy ln 2.
//! - Where the neighbour copies what it sees, `P(u_i = x_i) = (1 - e)^2 + e^2 = 0.68` for `e = 0.2`, because my coin of
//!   now passed its eyes and passes mine again: cross-entropy `H(0.32) = 0.6269`.

use anyhow::bail;
use rand::Rng;

use crate::domain::{
    Action, Baseline, Beginning, Controller, Domain, GlobalSimulator, InfluenceSample, LocalSimulator, Percept,
    RegionSpec, Result, SourceSpec, Transition,
};
use crate::base::{AgentId, Dice, Rows, Seed};

/// Probability that a coin is seen wrongly.
pub const NOISE: f64 = 0.2;
const AGENTS: usize = 2;

/// The domain of two coupled coins.
pub struct Coins {
    spec: RegionSpec,
}

impl Coins {
    pub fn new(horizon: usize) -> Self {
        let sources = SourceSpec::Binary { sources: 1 };
        Coins { spec: RegionSpec { obs_dim: 2, d_set_dim: 2, n_actions: 2, sources, horizon } }
    }
}

impl Domain for Coins {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn agents(&self) -> usize {
        AGENTS
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>> {
        Ok(Box::new(GlobalCoins {
            regions: Regions::new(AGENTS, &self.spec),
            noise: Seed::new(0).dice(),
            d_set: Rows::new(AGENTS, self.spec.d_set_dim),
            sources: Rows::new(AGENTS, 1),
        }))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, _seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        Ok(Box::new(LocalCoins { regions: Regions::new(regions.len() * copies, &self.spec) }))
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

/// The local transition, reward and observation of any number of regions.
struct Regions {
    spec: RegionSpec,
    last: Transition,
}

impl Regions {
    fn new(rows: usize, spec: &RegionSpec) -> Self {
        Regions { spec: spec.clone(), last: Transition::new(rows, spec) }
    }

    fn reset(&mut self, row: usize) {
        self.show(row, [0.0, 0.0]);
    }

    fn step(&mut self, row: usize, action: Action, source: u8) {
        let seen = self.last.percept.obs.row(row)[1];
        self.last.rewards[row] = f32::from(f32::from(action) == seen);
        self.show(row, [f32::from(action), f32::from(source)]);
    }

    fn show(&mut self, row: usize, coins: [f32; 2]) {
        self.last.percept.obs.row_mut(row).copy_from_slice(&coins);
        self.last.percept.d_set.row_mut(row).copy_from_slice(&coins);
    }
}

struct GlobalCoins {
    regions: Regions,
    noise: Dice,
    d_set: Rows<f32>,
    sources: Rows<u8>,
}

impl GlobalSimulator for GlobalCoins {
    fn spec(&self) -> &RegionSpec {
        &self.regions.spec
    }

    fn agents(&self) -> usize {
        AGENTS
    }

    fn reset(&mut self, episode: Seed) -> Result<&Percept> {
        self.noise = episode.fork("noise").dice();
        (0..AGENTS).for_each(|agent| self.regions.reset(agent));
        Ok(&self.regions.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&Transition> {
        self.d_set.copy_from(&self.regions.last.percept.d_set);
        for agent in 0..AGENTS {
            let neighbour = actions[1 - agent];
            let source = neighbour ^ u8::from(self.noise.random_bool(NOISE));
            self.sources.row_mut(agent)[0] = source;
            self.regions.step(agent, actions[agent], source);
        }
        Ok(&self.regions.last)
    }

    fn influence_sample(&self) -> InfluenceSample<'_> {
        InfluenceSample { d_set: &self.d_set, sources: &self.sources }
    }
}

struct LocalCoins {
    regions: Regions,
}

impl LocalSimulator for LocalCoins {
    fn spec(&self) -> &RegionSpec {
        &self.regions.spec
    }

    fn rows(&self) -> usize {
        self.regions.last.rewards.len()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        begin.iter().for_each(|beginning| self.regions.reset(beginning.row));
        Ok(&self.regions.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        for (row, (&action, source)) in actions.iter().zip(sources.iter()).enumerate() {
            self.regions.step(row, action, source[0]);
        }
        Ok(&self.regions.last)
    }
}

struct LayAtRandom {
    dice: Dice,
}

impl Controller for LayAtRandom {
    fn begin(&mut self, episode: Seed) {
        self.dice = episode.fork("acting").dice();
    }

    fn act(&mut self, _percept: &Percept, actions: &mut [Action]) -> Result<()> {
        actions.iter_mut().for_each(|action| *action = self.dice.random_range(0..2));
        Ok(())
    }
}

struct CopyTheNeighbour;

impl Controller for CopyTheNeighbour {
    fn begin(&mut self, _episode: Seed) {}

    fn act(&mut self, percept: &Percept, actions: &mut [Action]) -> Result<()> {
        for (action, obs) in actions.iter_mut().zip(percept.obs.iter()) {
            *action = obs[1] as Action;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::conformance;

    #[test]
    fn the_coins_conform() {
        let measured = conformance::check(&Coins::new(20), Seed::new(1)).unwrap();
        assert_eq!((measured.recall, measured.precision, measured.reward_error), (1.0, 1.0, 0.0), "they are exact");
    }

    #[test]
    fn copying_earns_everything_and_random_coins_half() {
        let total = |name: &str| -> f32 {
            let mut baseline = Coins::new(1000).baseline(name).unwrap();
            let mut percept = baseline.simulator.reset(Seed::new(3)).unwrap().clone();
            baseline.controller.begin(Seed::new(3));
            let mut actions = [0; 2];
            (0..1000)
                .map(|_| {
                    baseline.controller.act(&percept, &mut actions).unwrap();
                    let transition = baseline.simulator.step(&actions).unwrap();
                    percept = transition.percept.clone();
                    transition.rewards.iter().sum::<f32>() / 2.0
                })
                .sum()
        };
        assert_eq!(total("copy"), 1000.0);
        // 2000 fair coins: standard deviation of the mean total 500 is 1000 * 0.5 / sqrt(2000) = 11.
        assert!((total("random") - 500.0).abs() < 45.0);
    }
}
