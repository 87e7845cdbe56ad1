//! A learner outside of this program: it decides and learns in a Python process, and everything else is as for PPO.
//!
//! - `config`: the table `[outside]`. [`OutsideLearner`]: what the other process does. [`install`] makes it known.
//! - `controller`: the same learner on the GS, in evaluations and in datasets.
//!
//! One learner has all agents, so one worker owns them. A decision asks for the rows of all lanes at once. Each row brings
//! a number of its own dice, the dice with which PPO would draw its action. So a learner that draws with them needs no
//! dice, and neither evaluations nor a kill of the run change what it learns.
//!
//! The stack of policies that every learner has is here of no use. Its networks are never read.

mod config;
pub(crate) mod controller;

use std::sync::{Mutex, MutexGuard, OnceLock};

use anyhow::{Context, bail, ensure};
use rand::Rng;

use super::{Actor, Algorithm, Layout, Learner, Metrics, Tables};
use crate::config::Config;
use crate::environments::Experience;
use crate::policy::{PolicyStack, Reading};
use crate::state::stream::Part;
pub use config::OutsideConfig;
use dials_core::base::{AgentId, Dice, Phase, RandomPurpose, Rows, Seed, Stopwatch};
use dials_core::domain::{Action, Kind, Percept, RegionSpec, Result};
use stacknets::{Shape, Threads};

/// Name of its dice, as in checkpoints.
const ACTING: &str = "acting";

/// Rows that wait for an action.
pub struct Waiting<'a> {
    /// Agent and copy of each row.
    pub agents: &'a [u32],
    pub copies: &'a [u32],
    /// `[rows, obs_dim]`
    pub obs: &'a Rows<f32>,
    /// Actions that are allowed, `[rows, n_actions]`.
    pub masks: &'a Rows<bool>,
    /// A number from 0 to 1 for each row, of its own dice.
    pub uniform: &'a [f32],
    /// Timesteps per agent so far, in training. `None`: an episode on the GS in which nothing is learnt.
    pub training_steps: Option<u64>,
}

/// What some decisions of the same rows brought, one after another.
pub struct Rollout<'a> {
    /// Agent and copy of each row, `[rows]`.
    pub agents: &'a [u32],
    pub copies: &'a [u32],
    pub decisions: &'a Decisions,
    /// Timesteps per agent so far, with these.
    pub steps: u64,
}

/// Decisions since the last update: tables of `[decisions * rows]`.
pub struct Decisions {
    pub obs: Rows<f32>,
    pub masks: Rows<bool>,
    pub actions: Vec<Action>,
    pub rewards: Vec<f32>,
    /// Whether the episode ended with the decision.
    pub ends: Vec<bool>,
    /// What the decision led to. If the episode ended there: its last observation, not the first one of the next episode.
    pub next_obs: Rows<f32>,
    pub next_masks: Rows<bool>,
}

impl Decisions {
    fn new(obs_dim: usize, n_actions: usize) -> Decisions {
        Decisions {
            obs: Rows::new(0, obs_dim),
            masks: Rows::new(0, n_actions),
            actions: Vec::new(),
            rewards: Vec::new(),
            ends: Vec::new(),
            next_obs: Rows::new(0, obs_dim),
            next_masks: Rows::new(0, n_actions),
        }
    }
}

/// What the other process does. Errors are those of its code, or say that it has ended.
pub trait OutsideLearner: Send {
    /// Returns an action for each row.
    fn act(&mut self, waiting: &Waiting<'_>) -> Result<Vec<Action>>;

    /// Learns. Returns the values of its metrics, one for each row's agent in the order of `agents`, or `None` if it has not
    /// learnt yet.
    fn learn(&mut self, rollout: &Rollout<'_>) -> Result<Option<Vec<Vec<f64>>>>;

    /// Returns the names of its metrics.
    fn metrics(&self) -> &[String];

    /// Returns what it must keep. Only it can read it.
    fn state(&mut self) -> Result<Vec<u8>>;

    /// Takes back what [`OutsideLearner::state`] has returned.
    fn load(&mut self, state: &[u8]) -> Result<()>;
}

/// The learner of this process, and its state between two periods.
struct Installed {
    learner: Box<dyn OutsideLearner>,
    /// What the learner had to keep when the last period ended; empty before the first period.
    state: Vec<u8>,
    /// Whether the learner does not have this state yet.
    is_to_be_loaded: bool,
}

/// A process has one, because one Python process started it.
static INSTALLED: OnceLock<Mutex<Installed>> = OnceLock::new();

/// Makes the learner of this process known. Only the first call counts.
pub fn install(learner: Box<dyn OutsideLearner>) {
    INSTALLED.get_or_init(|| Mutex::new(Installed { learner, state: Vec::new(), is_to_be_loaded: false }));
}

/// Returns whether there is a learner in this process.
pub fn is_installed() -> bool {
    INSTALLED.get().is_some()
}

fn installed() -> Result<MutexGuard<'static, Installed>> {
    let installed = INSTALLED.get().context(
        "algorithm = \"outside\": its policies are in a Python process; only dials_traffic.dials(...) can let them act",
    )?;
    // What a panic has left is of no use, and the run ends with that panic.
    Ok(installed.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

/// Does something with the learner, which has its state by then.
fn with<T>(work: impl FnOnce(&mut dyn OutsideLearner) -> Result<T>) -> Result<T> {
    let mut installed = installed()?;
    let Installed { learner, state, is_to_be_loaded } = &mut *installed;
    if *is_to_be_loaded {
        learner.load(state)?;
        *is_to_be_loaded = false;
    }
    work(&mut **learner)
}

impl Algorithm for OutsideConfig {
    fn check(&self, config: &Config) -> Result<()> {
        OutsideConfig::check(self, config)
    }

    fn updates(&self) -> (&'static str, u64) {
        ("outside.update_every_steps", self.update_every_steps as u64)
    }

    fn reading(&self) -> Reading {
        Reading::Probabilities
    }

    fn learner(
        &self,
        config: &Config,
        spec: &RegionSpec,
        agents: &[AgentId],
        stack: PolicyStack,
        parts: &[Part],
    ) -> Box<dyn Learner> {
        Box::new(Outside::new(self, config, spec, agents, stack, parts))
    }

    fn layout(&self, config: &Config, _kind: &Kind, _steps: u64) -> Layout {
        Layout { dice: vec![(ACTING, config.copies())], bytes: true, ..Layout::default() }
    }

    fn learning_rate_key(&self, _config: &Config, _steps: u64) -> &'static str {
        "the learning rate in Python"
    }

    fn flops_per_step(&self, _config: &Config, _shape: &Shape, _horizon: usize) -> f64 {
        0.0
    }
}

/// Some agents of one kind, as the learner outside sees them. Rows are ordered by agent, then by copy.
struct Outside {
    policies: PolicyStack,
    update_every_steps: u64,
    /// For each lane, the rows of the kind that are in it.
    places: Vec<Vec<usize>>,
    agents: Vec<u32>,
    copies: Vec<u32>,
    dice: Vec<Dice>,
    /// The actions of each lane in this round.
    chosen: Vec<Vec<Action>>,
    /// What each lane brought in this round.
    brought: Vec<Option<(Experience, Percept)>>,
    decisions: Decisions,
}

/// Returns the mask of a row, in which everything is allowed if the kind has no masks.
fn mask<'a>(masks: Option<&'a Rows<bool>>, row: usize, all: &'a [bool]) -> &'a [bool] {
    masks.map_or(all, |masks| masks.row(row))
}

impl Outside {
    fn new(
        own: &OutsideConfig,
        config: &Config,
        spec: &RegionSpec,
        agents: &[AgentId],
        policies: PolicyStack,
        parts: &[Part],
    ) -> Outside {
        let copies = config.copies();
        let seed = Seed::new(config.seed).fork(RandomPurpose::Acting);
        let rows = || agents.iter().flat_map(|&agent| (0..copies).map(move |copy| (agent, copy)));
        let places = |part: &Part| {
            let row = |row: usize| part.place(row);
            (0..part.rows()).map(row).map(|(agent, copy)| agent * copies + copy).collect()
        };
        Outside {
            policies,
            update_every_steps: own.update_every_steps as u64,
            places: parts.iter().map(places).collect(),
            agents: rows().map(|(agent, _)| agent.0 as u32).collect(),
            copies: rows().map(|(_, copy)| copy as u32).collect(),
            dice: rows().map(|(agent, copy)| seed.for_agent(agent).for_copy(copy).dice()).collect(),
            chosen: vec![Vec::new(); parts.len()],
            brought: vec![None; parts.len()],
            decisions: Decisions::new(spec.obs_dim, spec.n_actions),
        }
    }

    fn rows(&self) -> usize {
        self.agents.len()
    }

    /// Adds what all lanes have brought to the decisions.
    fn remember(&mut self) {
        let (rows, width, n_actions) = (self.rows(), self.decisions.obs.width(), self.decisions.masks.width());
        let all = vec![true; n_actions];
        let mut rewards = vec![0.0; rows];
        let mut ends = vec![false; rows];
        let mut next_obs = Rows::new(rows, width);
        let mut next_masks = Rows::new(rows, n_actions);
        for (places, brought) in self.places.iter().zip(&mut self.brought) {
            let (experience, next) = brought.take().expect("every lane was played");
            for (row, &place) in places.iter().enumerate() {
                (rewards[place], ends[place]) = (experience.rewards[row], experience.ends[row]);
                let (obs, masks) = match ends[place] {
                    true => (&experience.last_obs, experience.last_masks.as_ref()),
                    false => (&next.obs, next.masks.as_ref()),
                };
                next_obs.row_mut(place).copy_from_slice(obs.row(row));
                next_masks.row_mut(place).copy_from_slice(mask(masks, row, &all));
            }
        }
        self.decisions.rewards.extend(rewards);
        self.decisions.ends.extend(ends);
        self.decisions.next_obs.extend(&next_obs);
        self.decisions.next_masks.extend(&next_masks);
    }
}

/// Acts in a lane as the learner has decided for all of them.
struct OutsideActor<'a> {
    chosen: &'a [Action],
    brought: &'a mut Option<(Experience, Percept)>,
}

impl Actor for OutsideActor<'_> {
    fn act(&mut self, _percept: &Percept) -> Vec<Action> {
        self.chosen.to_vec()
    }

    fn take_in(&mut self, experience: &Experience, next: &Percept, watch: &mut Stopwatch) {
        watch.time(Phase::Bookkeeping, || *self.brought = Some((experience.clone(), next.clone())));
    }
}

impl Learner for Outside {
    fn policies(&self) -> &PolicyStack {
        &self.policies
    }

    fn policies_mut(&mut self) -> &mut PolicyStack {
        &mut self.policies
    }

    fn look(&mut self, lanes: &[&Percept], steps: u64, watch: &mut Stopwatch) -> Result<()> {
        let (width, n_actions) = (self.decisions.obs.width(), self.decisions.masks.width());
        let all = vec![true; n_actions];
        let mut obs = Rows::new(self.rows(), width);
        let mut masks = Rows::new(self.rows(), n_actions);
        for (places, shown) in self.places.iter().zip(lanes) {
            for (row, &place) in places.iter().enumerate() {
                obs.row_mut(place).copy_from_slice(shown.obs.row(row));
                masks.row_mut(place).copy_from_slice(mask(shown.masks.as_ref(), row, &all));
            }
        }
        let uniform: Vec<f32> = self.dice.iter_mut().map(Rng::random).collect();
        let waiting = Waiting {
            agents: &self.agents,
            copies: &self.copies,
            obs: &obs,
            masks: &masks,
            uniform: &uniform,
            training_steps: Some(steps),
        };
        let actions = watch.time(Phase::Acting, || with(|learner| learner.act(&waiting)))?;
        check_actions(&actions, &masks)?;
        for (places, chosen) in self.places.iter().zip(&mut self.chosen) {
            *chosen = places.iter().map(|&place| actions[place]).collect();
        }
        self.decisions.obs.extend(&obs);
        self.decisions.masks.extend(&masks);
        self.decisions.actions.extend(actions);
        Ok(())
    }

    fn actors<'a>(&'a mut self, _threads: &'a Threads) -> Vec<Box<dyn Actor + 'a>> {
        let lanes = self.chosen.iter().zip(&mut self.brought);
        lanes.map(|(chosen, brought)| Box::new(OutsideActor { chosen, brought }) as Box<dyn Actor + 'a>).collect()
    }

    fn learn(&mut self, steps: u64, watch: &mut Stopwatch) -> Result<Option<Metrics>> {
        watch.time(Phase::Bookkeeping, || self.remember());
        if !steps.is_multiple_of(self.update_every_steps) {
            return Ok(None);
        }
        let none = Decisions::new(self.decisions.obs.width(), self.decisions.masks.width());
        let decisions = &std::mem::replace(&mut self.decisions, none);
        let rollout = Rollout { agents: &self.agents, copies: &self.copies, decisions, steps };
        let learn = |learner: &mut dyn OutsideLearner| Ok((learner.learn(&rollout)?, learner.metrics().to_vec()));
        let (learnt, names) = watch.time(Phase::Backward, || with(learn))?;
        let Some(values) = learnt else { return Ok(None) };
        // The copies of an agent have one value.
        let copies = self.rows() / self.policies.agents();
        let of_agents = |values: Vec<f64>| values.into_iter().step_by(copies).collect();
        let of_agents = names.into_iter().zip(values).map(|(name, values)| (name, of_agents(values))).collect();
        Ok(Some(Metrics { of_agents, settings: Vec::new() }))
    }

    fn no_metrics(&self) -> Metrics {
        let names = installed().map(|installed| installed.learner.metrics().to_vec()).unwrap_or_default();
        let none = vec![0.0; self.policies.agents()];
        Metrics { of_agents: names.into_iter().map(|name| (name, none.clone())).collect(), settings: Vec::new() }
    }

    fn leave(&mut self) -> Result<()> {
        let state = with(|learner| learner.state())?;
        installed()?.state = state;
        Ok(())
    }

    fn tables(&self) -> Tables {
        let copies = self.rows() / self.policies.agents();
        let dice = self.dice.chunks(copies).map(<[Dice]>::to_vec).collect();
        let bytes = installed().map(|installed| installed.state.clone()).unwrap_or_default();
        Tables { dice: [(ACTING.to_owned(), dice)].into(), bytes, ..Tables::default() }
    }

    fn load(&mut self, mut tables: Tables) {
        self.dice = tables.dice.remove(ACTING).expect("the layout names these dice").concat();
        if let Ok(mut installed) = installed() {
            installed.is_to_be_loaded = !tables.bytes.is_empty();
            installed.state = tables.bytes;
        }
    }
}

/// Returns an error that names the first row with an action that does not exist. The other process refuses those that are not
/// allowed.
fn check_actions(actions: &[Action], masks: &Rows<bool>) -> Result<()> {
    ensure!(actions.len() == masks.len(), "the learner returned {} actions for {} rows", actions.len(), masks.len());
    let n_actions = masks.width();
    if let Some((row, action)) = actions.iter().enumerate().find(|(_, action)| usize::from(**action) >= n_actions) {
        bail!("the learner returned action {action} for row {row}; its actions are 0 to {}", n_actions - 1);
    }
    Ok(())
}
