//! Proximal policy optimisation, the algorithm of the paper.
//!
//! Rollouts fill a memory; a full memory makes an update. Every agent learns as if alone.
//!
//! - `config`: the table `[ppo]`.
//! - `rollout`, `memory`, [`gae`]: decisions, with their advantages.
//! - [`mod@update`], [`loss`]: the gradient steps.
//!
//! Source: Schulman et al. 2017; constants: DIALS paper, appendix "Hyperparameters".

mod config;
pub mod gae;
pub(crate) mod loss;
mod memory;
mod rollout;
pub mod update;

use super::tables::Base;
use super::{Algorithm, Brought, Layout, Learner, Metrics, NumberTable, Tables};
use crate::config::Config;
use crate::policy::{PolicyStack, Reading};
pub use config::{PpoConfig, TimeLimit};
use dials_core::base::{AgentId, Ragged, Stopwatch};
use dials_core::domain::{Action, Kind, Percept, RegionSpec, Result};
use loss::Losses;
pub use memory::{Memory, Sample};
use rollout::{Copies, Rollout};
use stacknets::Shape;
use update::{Decayed, Learns, Settings, update};

/// Name of the table of hidden states, as in checkpoints.
const STATES: &str = "states";

impl Algorithm for PpoConfig {
    fn check(&self, config: &Config) -> Result<()> {
        config::check(config)
    }

    fn updates(&self) -> (&'static str, u64) {
        ("ppo.memory", self.memory as u64)
    }

    fn decisions_in_turn(&self) -> usize {
        self.rollout_steps
    }

    fn reading(&self) -> Reading {
        Reading::Probabilities
    }

    fn learner(&self, config: &Config, spec: &RegionSpec, agents: &[AgentId], stack: PolicyStack) -> Box<dyn Learner> {
        Box::new(Ppo::new(config, spec, agents, stack))
    }

    fn layout(&self, config: &Config, kind: &Kind, steps: u64) -> Layout {
        let shape = PolicyStack::shape(&kind.spec, &config.policy);
        let mut layout = Base::layout(config, shape.layout().width(), gradient_steps(steps, config, kind));
        let width = config.copies() * shape.state_width();
        layout.numbers.push(NumberTable { name: STATES, width, averaged: false, squares: false, learnt: false });
        layout
    }

    fn flops_per_step(&self, config: &Config, shape: &Shape, horizon: usize) -> f64 {
        let acting = shape.forward_flops();
        let update = self.epochs as f64 * (acting + shape.backward_flops(config.sequence_length()));
        // Besides every decision: the value after the last step of a rollout and, if it counts, of an episode.
        let last_values = 1.0 / self.rollout_steps as f64
            + if self.time_limit == TimeLimit::Bootstrap { 1.0 / horizon as f64 } else { 0.0 };
        update + (1.0 + last_values) * acting
    }

    fn learning_rate_key(&self, config: &Config, steps: u64) -> &'static str {
        match learns_at(config, steps.saturating_sub(self.memory as u64)) {
            Learns::Critic => "imitation.learning_rate",
            Learns::Everything => "ppo.learning_rate",
        }
    }
}

/// Returns what learns in the update that begins after this number of timesteps per agent.
fn learns_at(config: &Config, steps: u64) -> Learns {
    if steps < config.critic_steps() { Learns::Critic } else { Learns::Everything }
}

/// Returns how many steps the optimiser of a policy has made after this number of timesteps per agent.
fn gradient_steps(steps: u64, config: &Config, kind: &Kind) -> u64 {
    let memory = config.ppo.memory as u64;
    let updates = steps / memory;
    // When the actor joins the critic, the optimiser begins again.
    let of_critic = config.critic_steps().div_ceil(memory);
    let since = if updates > of_critic { updates - of_critic } else { updates };
    // A shared policy learns from the samples of all agents of its kind.
    let memories = if config.shares_policies() { kind.agents.len() } else { 1 };
    let per_update = config.ppo.epochs * memories * (config.ppo.memory / config.ppo.minibatch);
    since.saturating_mul(per_update as u64)
}

pub(crate) struct Ppo {
    config: Config,
    policies: PolicyStack,
    base: Base,
    memory: Memory,
    /// One per turn.
    rollouts: Vec<Rollout>,
    /// Number of them that have filled their part of the memory.
    full: usize,
}

impl Ppo {
    fn new(config: &Config, spec: &RegionSpec, agents: &[AgentId], policies: PolicyStack) -> Ppo {
        let (length, width) = (config.sequence_length(), policies.state_width());
        let (turns, copies) = (config.turns(), config.copies());
        let rollout = |turn: usize| {
            let copies = Copies { first: turn * copies / turns, count: copies / turns, all: copies };
            let states = policies.states(agents.len() * copies.count);
            Rollout::new(&config.ppo, config.shares_policies(), copies, states)
        };
        Ppo {
            memory: Memory::new(agents.len(), config.ppo.memory, length, spec, width),
            rollouts: (0..turns).map(rollout).collect(),
            full: 0,
            base: Base::new(config, agents, policies.parameters()),
            policies,
            config: config.clone(),
        }
    }

    /// Returns turn and row of all copies, agent by agent.
    fn places(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (agents, turns) = (self.policies.agents(), self.rollouts.len());
        let of_turn = self.base.copies() / turns;
        let rows = move |agent: usize| agent * of_turn..(agent + 1) * of_turn;
        let turns = move |agent: usize| (0..turns).map(move |turn| (agent, turn));
        (0..agents).flat_map(turns).flat_map(move |(agent, turn)| rows(agent).map(move |row| (turn, row)))
    }

    /// Returns learning rate and clip of the update that begins after this number of timesteps per agent.
    fn decayed(&self, steps: u64) -> Decayed {
        let decayed = Decayed::at(&self.config.ppo, steps as f64 / self.config.total_steps as f64);
        match learns_at(&self.config, steps) {
            Learns::Everything => decayed,
            // Alone, a critic that begins at random learns as fast as the policy has imitated.
            Learns::Critic => Decayed { learning_rate: self.config.imitation.learning_rate, ..decayed },
        }
    }

    /// Updates the policies from the full memory. `begun`: timesteps per agent when the memory began to be filled.
    fn update(&mut self, begun: u64, watch: &mut Stopwatch) -> Metrics {
        let decayed = self.decayed(begun);
        let learns = learns_at(&self.config, begun);
        let before = begun.checked_sub(self.config.ppo.memory as u64).map(|begun| learns_at(&self.config, begun));
        if before.is_some_and(|before| before != learns) {
            // The actor's first steps would be far too long with the step count of the critic.
            self.base.adam.begin_again();
        }
        let settings = Settings { ppo: &self.config.ppo, decayed, learns, shared: self.config.shares_policies() };
        let Base { adam, minibatches, .. } = &mut self.base;
        metrics(&update(&mut self.policies, adam, &self.memory, minibatches, settings, watch), decayed)
    }
}

fn metrics(losses: &[Losses], decayed: Decayed) -> Metrics {
    let of_agents = |name: &str, of: fn(&Losses) -> f64| (name.to_owned(), losses.iter().map(of).collect());
    Metrics {
        of_agents: vec![
            of_agents("surrogate", |losses| losses.surrogate),
            of_agents("value_loss", |losses| losses.value),
            of_agents("entropy", |losses| losses.entropy),
            of_agents("kl", |losses| losses.kl),
            of_agents("clipped", |losses| losses.clipped),
        ],
        settings: [("learning_rate", decayed.learning_rate), ("clip", decayed.clip)]
            .map(|(name, value)| (name.to_owned(), value))
            .to_vec(),
    }
}

impl Learner for Ppo {
    fn policies(&self) -> &PolicyStack {
        &self.policies
    }

    fn policies_mut(&mut self) -> &mut PolicyStack {
        &mut self.policies
    }

    fn act(&mut self, turn: usize, percept: &Percept) -> Vec<Action> {
        self.rollouts[turn].act(&self.policies, &mut self.base.acting, &mut self.memory, percept)
    }

    fn learn(&mut self, turn: usize, brought: Brought<'_>, watch: &mut Stopwatch) -> Option<Metrics> {
        let Brought { experience, next, steps } = brought;
        let Ppo { policies, memory, rollouts, full, .. } = self;
        let rollout = &mut rollouts[turn];
        let is_full = rollout.take_in(policies, experience, watch) && rollout.finish(policies, memory, next, watch);
        *full += usize::from(is_full);
        if *full < rollouts.len() {
            return None;
        }
        *full = 0;
        Some(self.update(steps - self.config.ppo.memory as u64, watch))
    }

    fn no_metrics(&self) -> Metrics {
        metrics(&vec![Losses::default(); self.policies.agents()], self.decayed(0))
    }

    fn tables(&self) -> Tables {
        let widths = vec![self.base.copies() * self.policies.state_width(); self.policies.agents()];
        let values = self.places().flat_map(|(turn, row)| self.rollouts[turn].states.row(row));
        let states = Ragged::from_vec(values.copied().collect(), widths).expect("one state per row");
        let mut tables = self.base.tables();
        tables.numbers.insert(STATES.to_owned(), states);
        tables
    }

    fn load(&mut self, mut tables: Tables) {
        self.base.load(&mut tables);
        let states = tables.take_numbers(STATES);
        let width = self.policies.state_width();
        let rows = states.as_slice().chunks_exact(width.max(1));
        self.places().zip(rows).for_each(|((turn, row), state)| self.rollouts[turn].states.set_row(row, state));
    }
}
