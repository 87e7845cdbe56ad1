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

use rand::Rng;

use super::game::{self, Game, Region, Seats};
use dials_core::base::{AgentId, Dice, Ragged, Seed};
use dials_core::domain::{
    Action, Baseline, Domain, GlobalSimulator, Kinds, LocalSimulator, RegionSpec, Result, Scenario, SourceSpec,
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
            sets: None,
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
        Ok(Box::new(Game::new(&self.kinds, vec![Region::COUPLED; AGENTS], see)))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, _seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        Ok(Box::new(Seats::new(&self.kinds[0].spec, vec![Region::COUPLED; regions.len() * copies])))
    }

    fn scenario(&self) -> Result<Scenario> {
        Ok(Scenario::new("coins", AGENTS, self.kinds.horizon()))
    }

    fn baselines(&self) -> &'static [&'static str] {
        &["random", "copy"]
    }

    fn baseline(&self, name: &str) -> Result<Baseline> {
        game::baseline(self, name)
    }
}

/// Writes what both agents see of each other's coin.
fn see(actions: &[Action], noise: &mut Dice, sources: &mut Ragged<u8>) {
    for agent in 0..AGENTS {
        sources.row_mut(agent)[0] = actions[1 - agent] ^ u8::from(noise.random_bool(NOISE));
    }
}
