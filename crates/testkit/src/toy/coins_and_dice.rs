//! Coins and dice: a domain of two kinds of agents, whose numbers interleave.
//!
//! There are two pairs of a coin and a die: agents 0 and 1, and agents 2 and 3. At a step, every agent lays its coin or
//! die as its action says, `x_i' = a_i`. It then sees others: these readings are its influence sources.
//!
//! - A **coin** (two actions) sees its die exactly: one source of three classes. The reward is 1 for laying 1 if the
//!   die last seen showed 0, and for laying 0 if it did not.
//! - A **die** (three actions) sees its coin, wrongly with probability [`NOISE`], and the other die, exactly: one
//!   source of two classes and one of three. It must turn: the face that it shows is masked. The reward is 1 for
//!   turning by one if the coin last seen showed 1, and by two if it showed 0.
//!
//! Known in closed form:
//!
//! - Agents that choose among their allowed actions at random earn half of the horizon; the best ones earn all of it.
//! - A random die shows one of two faces next. Cross-entropy: ln 2 if its face is known, ln 3 for a constant
//!   prediction.
//! - The best die turns by what it saw of the coin. Cross-entropy: `H(0.2) = 0.5004` if coin and die are known.
//! - The best coin shows what its die showed. Cross-entropy: `H(0.2)` for the die, which knows its own face.

use rand::Rng;

use super::NOISE;
use super::game::{self, FACES, Game, Region, Seats};
use dials_core::base::{AgentId, Dice, Ragged, Seed};
use dials_core::domain::{
    Action, Baseline, Domain, GlobalSimulator, Kind, Kinds, LocalSimulator, Measures, RegionSpec, Result, Scenario,
    SourceSpec,
};

const COINS: [usize; 2] = [0, 2];
const DICE: [usize; 2] = [1, 3];

pub struct CoinsAndDice {
    kinds: Kinds,
}

impl CoinsAndDice {
    pub fn new(horizon: usize) -> Self {
        let kind = |name: &str, width, n_actions, masks, classes, agents: [usize; 2]| Kind {
            name: name.to_owned(),
            spec: RegionSpec {
                obs_dim: width,
                d_set_dim: width,
                n_actions,
                sets: None,
                masks,
                sources: SourceSpec { classes, parts: 0 },
                horizon,
                local_horizon: horizon,
            },
            agents: agents.map(AgentId).to_vec(),
        };
        let coins = kind("coin", 4, 2, false, vec![FACES], COINS);
        let dice = kind("die", 7, 3, true, vec![2, FACES], DICE);
        CoinsAndDice { kinds: Kinds::new(vec![coins, dice]).expect("four agents of two kinds") }
    }

    fn region(&self, agent: AgentId) -> Region {
        if self.kinds.place(agent).kind == 0 { Region::COIN } else { Region::DIE }
    }
}

impl Domain for CoinsAndDice {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn scenario(&self) -> Result<Scenario> {
        Ok(Scenario::new("coins-and-dice", self.agents(), self.kinds.horizon()))
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>> {
        let regions = AgentId::all(self.agents()).into_iter().map(|agent| self.region(agent));
        Ok(Box::new(Game::new(&self.kinds, regions.collect(), see)))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, _seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        let spec = &self.kinds.of(regions[0]).spec;
        Ok(Box::new(Seats::new(spec, vec![self.region(regions[0]); regions.len() * copies])))
    }

    /// A coin that always shows side 0 is stuck. A die is never stuck.
    fn stuck(&self, kind: &Kind, measures: &Measures) -> Vec<bool> {
        let (_, shares) = &measures.per_agent[0];
        let is_stuck = |agent: &AgentId| matches!(self.region(*agent), Region::Coin { .. }) && shares[agent.0] > 0.99;
        kind.agents.iter().map(is_stuck).collect()
    }

    fn baselines(&self) -> &'static [&'static str] {
        &["random", "best"]
    }

    fn baseline(&self, name: &str) -> Result<Baseline> {
        game::baseline(self, name)
    }
}

/// Writes what the agents see of each other.
fn see(actions: &[Action], noise: &mut Dice, sources: &mut Ragged<u8>) {
    for pair in 0..2 {
        let (coin, die) = (COINS[pair], DICE[pair]);
        let seen = actions[coin] ^ u8::from(noise.random_bool(NOISE));
        sources.row_mut(coin)[0] = actions[die];
        sources.row_mut(die).copy_from_slice(&[seen, actions[DICE[1 - pair]]]);
    }
}
