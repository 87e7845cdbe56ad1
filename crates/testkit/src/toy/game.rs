//! What the toys have in common: regions whose state is what an agent laid and what it saw, and their simulators.

use anyhow::bail;
use rand::Rng;

use dials_core::base::{Dice, Ragged, RandomPurpose, Rows, Seed};
use dials_core::domain::{
    Action, Baseline, Beginning, Controller, Domain, GlobalSimulator, InfluenceSample, JointPercept, JointTransition,
    Kinds, LocalSimulator, Measures, Percept, RegionSpec, Result, Transition,
};

/// Number of faces of a die.
pub(super) const FACES: u8 = 3;

/// The local state of an agent: what it laid and what it saw. `Coupled`: one of two coins that see each other.
#[derive(Clone, Copy)]
pub(super) enum Region {
    Coupled { coin: u8, seen: u8 },
    Coin { coin: u8, die: u8 },
    Die { face: u8, coin: u8, other: u8 },
}

impl Region {
    /// State at the beginning of an episode.
    pub(super) const COUPLED: Region = Region::Coupled { coin: 0, seen: 0 };
    pub(super) const COIN: Region = Region::Coin { coin: 0, die: 0 };
    pub(super) const DIE: Region = Region::Die { face: 0, coin: 0, other: 0 };

    fn begin(&mut self) {
        *self = match self {
            Region::Coupled { .. } => Region::COUPLED,
            Region::Coin { .. } => Region::COIN,
            Region::Die { .. } => Region::DIE,
        };
    }

    fn best(self) -> Action {
        match self {
            Region::Coupled { seen, .. } => seen,
            Region::Coin { die, .. } => u8::from(die == 0),
            Region::Die { face, coin, .. } => (face + if coin == 1 { 1 } else { 2 }) % FACES,
        }
    }

    fn step(&mut self, action: Action, sources: &[u8]) -> f32 {
        let reward = f32::from(u8::from(action == self.best()));
        *self = match self {
            Region::Coupled { .. } => Region::Coupled { coin: action, seen: sources[0] },
            Region::Coin { .. } => Region::Coin { coin: action, die: sources[0] },
            Region::Die { .. } => Region::Die { face: action, coin: sources[0], other: sources[1] },
        };
        reward
    }

    /// Writes what the agent sees, which is also its AIP's d-set, and the actions that are allowed.
    fn show(self, obs: &mut [f32], d_set: &mut [f32], mask: &mut [bool]) {
        obs.fill(0.0);
        match self {
            Region::Coupled { coin, seen } => obs.copy_from_slice(&[f32::from(coin), f32::from(seen)]),
            Region::Coin { coin, die } => {
                obs[0] = f32::from(coin);
                obs[1 + usize::from(die)] = 1.0;
            }
            Region::Die { face, coin, other } => {
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

/// Writes what agents see of each other's actions: their influence sources.
type See = fn(actions: &[Action], noise: &mut Dice, sources: &mut Ragged<u8>);

/// The GS.
pub(super) struct Game {
    kinds: Kinds,
    see: See,
    regions: Vec<Region>,
    noise: Dice,
    d_set: Ragged<f32>,
    sources: Ragged<u8>,
    /// Number of steps of the episode in which each agent took action 0.
    firsts: Vec<u32>,
    steps: u32,
    last: JointTransition,
}

impl Game {
    pub(super) fn new(kinds: &Kinds, regions: Vec<Region>, see: See) -> Game {
        let last = JointTransition::new(kinds);
        Game {
            see,
            noise: Seed::new(0).dice(),
            d_set: last.percept.d_set.clone(),
            sources: Ragged::new(kinds.specs().map(|spec| spec.sources.count())),
            firsts: vec![0; regions.len()],
            steps: 0,
            last,
            regions,
            kinds: kinds.clone(),
        }
    }

    fn show(&mut self) {
        let JointPercept { obs, d_set, masks } = &mut self.last.percept;
        for (agent, region) in self.regions.iter().enumerate() {
            region.show(obs.row_mut(agent), d_set.row_mut(agent), masks.row_mut(agent));
        }
    }
}

impl GlobalSimulator for Game {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        self.noise = episode.fork(RandomPurpose::Noise).dice();
        self.regions.iter_mut().for_each(Region::begin);
        self.firsts.fill(0);
        self.steps = 0;
        self.show();
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        self.d_set.copy_from(&self.last.percept.d_set);
        (self.see)(actions, &mut self.noise, &mut self.sources);
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

    /// Coupled coins have none.
    fn measures(&mut self) -> Result<Measures> {
        if let Region::Coupled { .. } = self.regions[0] {
            return Ok(Measures::default());
        }
        let share = |&count: &u32| f64::from(count) / f64::from(self.steps);
        let shares = self.firsts.iter().map(share).collect();
        Ok(Measures { per_agent: vec![("share_of_action_0".to_owned(), shares)], system: Vec::new() })
    }
}

/// The LS of agents of one kind.
pub(super) struct Seats {
    spec: RegionSpec,
    regions: Vec<Region>,
    last: Transition,
}

impl Seats {
    pub(super) fn new(spec: &RegionSpec, regions: Vec<Region>) -> Seats {
        Seats { last: Transition::new(regions.len(), spec), spec: spec.clone(), regions }
    }

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

/// Makes a controller of a toy: of its baselines, the first one acts at random, and the second one is the best.
pub(super) fn baseline(toy: &dyn Domain, name: &str) -> Result<Baseline> {
    let controller: Box<dyn Controller> = match toy.baselines().iter().position(|&known| known == name) {
        Some(0) => Box::new(AtRandom { dice: Seed::new(0).dice() }),
        Some(_) => Box::new(Best),
        None => bail!("controller `{name}`: unknown; one of {}", toy.baselines().join(", ")),
    };
    Ok(Baseline { simulator: toy.global_simulator()?, controller })
}

/// Takes one of the first two actions that are allowed.
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

/// Takes the best actions.
struct Best;

impl Controller for Best {
    fn begin(&mut self, _episode: Seed) {}

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        let class = |one_hot: &[f32]| one_hot.iter().position(|&x| x == 1.0).unwrap_or(0) as u8;
        for (action, obs) in actions.iter_mut().zip(percept.obs.iter()) {
            let region = match obs.len() {
                2 => Region::Coupled { coin: obs[0] as u8, seen: obs[1] as u8 },
                4 => Region::Coin { coin: obs[0] as u8, die: class(&obs[1..]) },
                _ => Region::Die { face: class(&obs[..3]), coin: obs[3] as u8, other: class(&obs[4..]) },
            };
            *action = region.best();
        }
        Ok(())
    }
}
