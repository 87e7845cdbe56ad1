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

use anyhow::bail;
use rand::Rng;

use super::NOISE;
use dials_core::base::{AgentId, Dice, Ragged, RandomPurpose, Rows, Seed};
use dials_core::domain::{
    Action, Baseline, Beginning, Controller, Domain, GlobalSimulator, InfluenceSample, JointPercept, JointTransition,
    Kind, Kinds, LocalSimulator, Measures, Percept, RegionSpec, Result, Scenario, SourceSpec, Transition,
};

const FACES: u8 = 3;
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

    fn region(&self, agent: AgentId) -> CoinOrDie {
        if self.kinds.place(agent).kind == 0 { CoinOrDie::COIN } else { CoinOrDie::DIE }
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
        let last = JointTransition::new(&self.kinds);
        Ok(Box::new(TableGame {
            regions: AgentId::all(self.agents()).into_iter().map(|agent| self.region(agent)).collect(),
            noise: Seed::new(0).dice(),
            d_set: last.percept.d_set.clone(),
            sources: Ragged::new(self.kinds.specs().map(|spec| spec.sources.count())),
            firsts: vec![0; self.agents()],
            steps: 0,
            last,
            kinds: self.kinds.clone(),
        }))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, _seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        let kind = self.kinds.of(regions[0]);
        Ok(Box::new(Seats {
            regions: vec![self.region(regions[0]); regions.len() * copies],
            last: Transition::new(regions.len() * copies, &kind.spec),
            spec: kind.spec.clone(),
        }))
    }

    /// A coin that always shows side 0 is stuck. A die is never stuck.
    fn stuck(&self, kind: &Kind, measures: &Measures) -> Vec<bool> {
        let (_, shares) = &measures.per_agent[0];
        let is_stuck =
            |agent: &AgentId| matches!(self.region(*agent), CoinOrDie::Coin { .. }) && shares[agent.0] > 0.99;
        kind.agents.iter().map(is_stuck).collect()
    }

    fn baselines(&self) -> &'static [&'static str] {
        &["random", "best"]
    }

    fn baseline(&self, name: &str) -> Result<Baseline> {
        let controller: Box<dyn Controller> = match name {
            "random" => Box::new(AtRandom { dice: Seed::new(0).dice() }),
            "best" => Box::new(Best),
            _ => bail!("controller `{name}`: unknown; one of {}", self.baselines().join(", ")),
        };
        Ok(Baseline { simulator: self.global_simulator()?, controller })
    }
}

/// The local state of an agent: what it laid and what it saw.
#[derive(Clone, Copy)]
enum CoinOrDie {
    Coin { coin: u8, die: u8 },
    Die { face: u8, coin: u8, other: u8 },
}

impl CoinOrDie {
    /// State at the beginning of an episode.
    const COIN: CoinOrDie = CoinOrDie::Coin { coin: 0, die: 0 };
    const DIE: CoinOrDie = CoinOrDie::Die { face: 0, coin: 0, other: 0 };

    fn begin(&mut self) {
        *self = match self {
            CoinOrDie::Coin { .. } => CoinOrDie::COIN,
            CoinOrDie::Die { .. } => CoinOrDie::DIE,
        };
    }

    fn best(self) -> Action {
        match self {
            CoinOrDie::Coin { die, .. } => u8::from(die == 0),
            CoinOrDie::Die { face, coin, .. } => (face + if coin == 1 { 1 } else { 2 }) % FACES,
        }
    }

    fn step(&mut self, action: Action, sources: &[u8]) -> f32 {
        let reward = f32::from(u8::from(action == self.best()));
        *self = match self {
            CoinOrDie::Coin { .. } => CoinOrDie::Coin { coin: action, die: sources[0] },
            CoinOrDie::Die { .. } => CoinOrDie::Die { face: action, coin: sources[0], other: sources[1] },
        };
        reward
    }

    /// Writes what the agent sees, which is also its AIP's d-set, and the actions that are allowed.
    fn show(self, obs: &mut [f32], d_set: &mut [f32], mask: &mut [bool]) {
        obs.fill(0.0);
        match self {
            CoinOrDie::Coin { coin, die } => {
                obs[0] = f32::from(coin);
                obs[1 + usize::from(die)] = 1.0;
            }
            CoinOrDie::Die { face, coin, other } => {
                obs[usize::from(face)] = 1.0;
                obs[3] = f32::from(coin);
                obs[4 + usize::from(other)] = 1.0;
                mask.fill(true);
                mask[usize::from(face)] = false;
            }
        }
        d_set.copy_from_slice(obs);
    }
}

struct TableGame {
    kinds: Kinds,
    regions: Vec<CoinOrDie>,
    noise: Dice,
    d_set: Ragged<f32>,
    sources: Ragged<u8>,
    /// Number of steps of the episode in which each agent took action 0.
    firsts: Vec<u32>,
    steps: u32,
    last: JointTransition,
}

impl TableGame {
    fn show(&mut self) {
        let JointPercept { obs, d_set, masks } = &mut self.last.percept;
        for (agent, region) in self.regions.iter().enumerate() {
            region.show(obs.row_mut(agent), d_set.row_mut(agent), masks.row_mut(agent));
        }
    }
}

impl GlobalSimulator for TableGame {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        self.noise = episode.fork(RandomPurpose::Noise).dice();
        self.regions.iter_mut().for_each(CoinOrDie::begin);
        self.firsts.fill(0);
        self.steps = 0;
        self.show();
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        self.d_set.copy_from(&self.last.percept.d_set);
        for pair in 0..2 {
            let (coin, die) = (COINS[pair], DICE[pair]);
            let seen = actions[coin] ^ u8::from(self.noise.random_bool(NOISE));
            self.sources.row_mut(coin)[0] = actions[die];
            self.sources.row_mut(die).copy_from_slice(&[seen, actions[DICE[1 - pair]]]);
        }
        self.steps += 1;
        self.firsts.iter_mut().zip(actions).for_each(|(count, &action)| *count += u32::from(action == 0));
        for (agent, region) in self.regions.iter_mut().enumerate() {
            self.last.rewards[agent] = region.step(actions[agent], self.sources.row(agent));
        }
        self.show();
        Ok(&self.last)
    }

    fn influence_sample(&self) -> InfluenceSample<'_> {
        InfluenceSample { d_set: &self.d_set, sources: &self.sources }
    }

    fn measures(&mut self) -> Result<Measures> {
        let share = |&count: &u32| f64::from(count) / f64::from(self.steps);
        let shares = self.firsts.iter().map(share).collect();
        Ok(Measures { per_agent: vec![("share_of_action_0".to_owned(), shares)], system: Vec::new() })
    }
}

struct Seats {
    spec: RegionSpec,
    regions: Vec<CoinOrDie>,
    last: Transition,
}

impl Seats {
    fn show(&mut self, row: usize) {
        let Percept { obs, d_set, masks } = &mut self.last.percept;
        let mask = masks.as_mut().map_or(&mut [][..], |masks| masks.row_mut(row));
        self.regions[row].show(obs.row_mut(row), d_set.row_mut(row), mask);
    }
}

impl LocalSimulator for Seats {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn rows(&self) -> usize {
        self.regions.len()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        for beginning in begin {
            self.regions[beginning.row].begin();
            self.show(beginning.row);
        }
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        for (row, &action) in actions.iter().enumerate() {
            self.last.rewards[row] = self.regions[row].step(action, sources.row(row));
            self.show(row);
        }
        Ok(&self.last)
    }
}

struct AtRandom {
    dice: Dice,
}

impl Controller for AtRandom {
    fn begin(&mut self, episode: Seed) {
        self.dice = episode.fork(RandomPurpose::Acting).dice();
    }

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        for (action, mask) in actions.iter_mut().zip(percept.masks.iter()) {
            *action = self.dice.random_range(0..2);
            // Among a die's faces: the first or the second one that is allowed.
            if let Some(masked) = mask.iter().position(|&allowed| !allowed) {
                *action += u8::from(usize::from(*action) >= masked);
            }
        }
        Ok(())
    }
}

struct Best;

impl Controller for Best {
    fn begin(&mut self, _episode: Seed) {}

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        let class = |one_hot: &[f32]| one_hot.iter().position(|&x| x == 1.0).unwrap_or(0) as u8;
        for (action, obs) in actions.iter_mut().zip(percept.obs.iter()) {
            let region = match obs.len() {
                4 => CoinOrDie::Coin { coin: obs[0] as u8, die: class(&obs[1..]) },
                _ => CoinOrDie::Die { face: class(&obs[..3]), coin: obs[3] as u8, other: class(&obs[4..]) },
            };
            *action = region.best();
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
    fn coins_and_dice_conform() {
        let measured = conformance::check(&CoinsAndDice::new(20), Seed::new(1)).unwrap();
        assert_eq!((measured.recall, measured.precision, measured.reward_error), (1.0, 1.0, 0.0), "they are exact");
    }

    #[test]
    fn the_best_earn_everything_and_random_ones_half() {
        let returns = |name: &str| {
            let mut baseline = CoinsAndDice::new(1000).baseline(name).unwrap();
            play(&mut *baseline.simulator, &mut *baseline.controller, Seed::new(3)).unwrap().returns
        };
        assert_eq!(returns("best"), [1000.0; 4]);
        // 1000 fair coins: standard deviation sqrt(250) = 16.
        assert!(returns("random").iter().all(|total| (total - 500.0).abs() < 64.0), "{:?}", returns("random"));
    }
}
