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

use super::{Algorithm, Layout, Learner, Metrics, NumberTable, Tables};
use crate::config::Config;
use crate::environments::Experience;
use crate::policy::{PolicyStack, Reading};
pub use config::{PpoConfig, TimeLimit};
use dials_core::base::{AgentId, Dice, Ragged, RandomPurpose, Seed, Stopwatch};
use dials_core::domain::{Action, Kind, Percept, RegionSpec, Result};
use loss::Losses;
pub use memory::{Memory, Sample};
use rollout::Rollout;
use stacknets::{Adam, Moments, Shape};
use update::{Decayed, Learns, Settings, update};

/// Names of the tables of [`Ppo`], as in checkpoints.
const FIRST_MOMENTS: &str = "first_moments";
const SECOND_MOMENTS: &str = "second_moments";
const STATES: &str = "states";
const ACTING: &str = "acting";
const MINIBATCHES: &str = "minibatches";
const GRADIENT_STEPS: &str = "gradient_steps";

impl Algorithm for PpoConfig {
    fn check(&self, config: &Config) -> Result<()> {
        config::check(config)
    }

    fn updates(&self) -> (&'static str, u64) {
        ("ppo.memory", self.memory as u64)
    }

    fn reading(&self) -> Reading {
        Reading::Probabilities
    }

    fn learner(
        &self,
        config: &Config,
        spec: &RegionSpec,
        agents: &[AgentId],
        policies: PolicyStack,
    ) -> Box<dyn Learner> {
        Box::new(Ppo::new(config, spec, agents, policies))
    }

    fn layout(&self, config: &Config, kind: &Kind, steps: u64) -> Layout {
        let shape = PolicyStack::shape(&kind.spec, &config.policy);
        let moments = NumberTable {
            name: FIRST_MOMENTS,
            width: shape.layout().width(),
            averaged: true,
            squares: false,
            learnt: true,
        };
        let states = NumberTable {
            name: STATES,
            width: config.copies() * shape.state_width(),
            averaged: false,
            squares: false,
            learnt: false,
        };
        Layout {
            numbers: vec![moments, NumberTable { name: SECOND_MOMENTS, squares: true, ..moments }, states],
            dice: vec![(ACTING, config.copies()), (MINIBATCHES, 1)],
            counts: vec![(GRADIENT_STEPS, gradient_steps(steps, config, kind))],
        }
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

/// The learner of some agents of one kind.
pub(crate) struct Ppo {
    config: Config,
    policies: PolicyStack,
    adam: Adam,
    memory: Memory,
    rollout: Rollout,
    /// Dice for the order of the minibatches, one per agent.
    minibatches: Vec<Dice>,
}

impl Ppo {
    fn new(config: &Config, spec: &RegionSpec, agents: &[AgentId], policies: PolicyStack) -> Ppo {
        let dice = |purpose: RandomPurpose, agent: AgentId| Seed::new(config.seed).fork(purpose).for_agent(agent);
        let copies = |&agent: &AgentId| {
            (0..config.copies()).map(move |copy| dice(RandomPurpose::Acting, agent).for_copy(copy).dice())
        };
        let acting: Vec<Dice> = agents.iter().flat_map(copies).collect();
        let states = policies.states(acting.len());
        Ppo {
            adam: Adam::new(policies.parameters()),
            memory: Memory::new(
                agents.len(),
                config.ppo.memory,
                config.sequence_length(),
                spec,
                policies.state_width(),
            ),
            rollout: Rollout::new(&config.ppo, config.shares_policies(), acting, states),
            minibatches: agents.iter().map(|&agent| dice(RandomPurpose::PolicyMinibatches, agent).dice()).collect(),
            policies,
            config: config.clone(),
        }
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
            self.adam.begin_again();
        }
        let settings = Settings { ppo: &self.config.ppo, decayed, learns, shared: self.config.shares_policies() };
        let Ppo { policies, adam, memory, minibatches, .. } = self;
        metrics(&update(policies, adam, memory, minibatches, settings, watch), decayed)
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

    fn act(&mut self, percept: &Percept) -> Vec<Action> {
        self.rollout.act(&self.policies, &mut self.memory, percept)
    }

    fn learn(&mut self, experience: &Experience, next: &Percept, steps: u64, watch: &mut Stopwatch) -> Option<Metrics> {
        let Ppo { policies, memory, rollout, .. } = self;
        let is_full = rollout.take_in(policies, experience, watch) && rollout.finish(policies, memory, next, watch);
        is_full.then(|| self.update(steps - self.config.ppo.memory as u64, watch))
    }

    fn no_metrics(&self) -> Metrics {
        metrics(&vec![Losses::default(); self.policies.agents()], self.decayed(0))
    }

    fn tables(&self) -> Tables {
        let Moments { first, second, steps } = self.adam.moments().clone();
        let agents = self.policies.agents();
        let copies = self.rollout.dice.len() / agents;
        let width = copies * self.policies.state_width();
        let states = Ragged::from_vec(self.rollout.states.as_slice().to_vec(), vec![width; agents]);
        Tables {
            numbers: [
                (FIRST_MOMENTS, first.into()),
                (SECOND_MOMENTS, second.into()),
                (STATES, states.expect("one state per row")),
            ]
            .map(|(name, table)| (name.to_owned(), table))
            .into(),
            dice: [
                (ACTING, self.rollout.dice.chunks(copies).map(<[Dice]>::to_vec).collect()),
                (MINIBATCHES, self.minibatches.iter().map(|dice| vec![dice.clone()]).collect::<Vec<_>>()),
            ]
            .map(|(name, dice)| (name.to_owned(), dice))
            .into(),
            counts: [(GRADIENT_STEPS.to_owned(), u64::from(steps))].into(),
        }
    }

    fn load(&mut self, mut tables: Tables) {
        let steps = tables.counts[GRADIENT_STEPS];
        self.adam.restore(Moments {
            first: tables.take_numbers(FIRST_MOMENTS).into_rows(),
            second: tables.take_numbers(SECOND_MOMENTS).into_rows(),
            steps: u32::try_from(steps).expect("the layout gives this number"),
        });
        let states = tables.take_numbers(STATES);
        let width = self.policies.state_width();
        let rows = states.as_slice().chunks_exact(width.max(1)).enumerate();
        rows.for_each(|(row, state)| self.rollout.states.set_row(row, state));
        self.rollout.dice = tables.take_dice(ACTING).concat();
        self.minibatches = tables.take_dice(MINIBATCHES).concat();
    }
}
