//! Proximal policy optimisation, the algorithm of the paper.
//!
//! Rollouts fill a memory; a full memory makes an update. Every agent learns as if alone.
//!
//! - `config`: the table `[ppo]`.
//! - `rollout`, `memory`, [`gae`]: decisions, with their advantages.
//! - [`mod@update`], [`loss`]: the gradient steps. `value_unit`: the unit of the critic.
//!
//! Source: Schulman et al. 2017; constants: DIALS paper, appendix "Hyperparameters".

mod config;
pub mod gae;
pub(crate) mod loss;
mod memory;
mod rollout;
pub mod update;
mod value_unit;

use super::tables::Base;
use super::{Actor, Algorithm, Layout, Learner, Metrics, NumberTable, Tables};
use crate::config::Config;
use crate::policy::{PolicyStack, Reading};
use crate::state::stream::Part;
pub use config::{NormaliseAdvantages, PpoConfig, TimeLimit};
use dials_core::base::{AgentId, Phase, Ragged, Stopwatch};
use dials_core::domain::{Kind, RegionSpec, Result};
use loss::Losses;
pub use memory::{Memory, Sample};
use rollout::{Critics, Rollout, RolloutActor};
use stacknets::{Adam, Shape, Threads};
use update::{Decayed, Learns, Settings, update};
pub use value_unit::{ValueUnit, ValueUnits};

/// Name of the table of hidden states, as in checkpoints.
const STATES: &str = "states";

/// Name of the table of the units of values. It is not there if all of them are the reward's.
const VALUE_UNITS: &str = "value_units";

impl Algorithm for PpoConfig {
    fn check(&self, config: &Config) -> Result<()> {
        config::check(config)
    }

    fn updates(&self) -> (&'static str, u64) {
        ("ppo.memory", self.memory as u64)
    }

    fn decisions_in_a_round(&self) -> usize {
        self.rollout_steps
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
        Box::new(Ppo::new(config, spec, agents, stack, parts))
    }

    fn layout(&self, config: &Config, kind: &Kind, steps: u64) -> Layout {
        let shape = PolicyStack::shape(&kind.spec, &config.policy);
        let mut layout = Base::layout(config, shape.layout().width(), gradient_steps(steps, config, kind));
        let width = config.copies() * shape.state_width();
        layout.numbers.push(NumberTable { name: STATES, width, averaged: false, squares: false, learnt: false });
        if self.value_unit != ValueUnit::Reward {
            // The mean of units goes with the mean of what networks say in them. It is a little narrow, until the next memories.
            layout.numbers.push(NumberTable {
                name: VALUE_UNITS,
                width: ValueUnits::WIDTH,
                averaged: true,
                squares: false,
                learnt: true,
            });
        }
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
    units: ValueUnits,
    base: Base,
    memory: Memory,
    /// One per lane.
    rollouts: Vec<Rollout>,
    /// Number of rollouts in the memory.
    in_memory: usize,
}

impl Ppo {
    fn new(config: &Config, spec: &RegionSpec, agents: &[AgentId], policies: PolicyStack, parts: &[Part]) -> Ppo {
        let (length, width) = (config.sequence_length(), policies.state_width());
        let rollout = |part: &Part| {
            let samples = part.copies.len() * config.ppo.rollout_steps;
            let memory = Memory::new(part.agents.len(), samples, length, spec, width);
            let states = policies.states(part.rows());
            Rollout::new(&config.ppo, config.bootstraps_with_last(), part, memory, states)
        };
        let adam = Adam::new(policies.parameters()).with_epsilon(config.ppo.adam_epsilon);
        Ppo {
            memory: Memory::new(agents.len(), config.ppo.memory, length, spec, width),
            rollouts: parts.iter().map(rollout).collect(),
            in_memory: 0,
            base: Base { adam, ..Base::new(config, agents, policies.parameters(), parts) },
            units: ValueUnits::new(config.ppo.value_unit, agents.len()),
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
            self.base.adam.begin_again();
        }
        let shared = self.config.shares_policies();
        self.units.follow(&self.memory, shared);
        let settings = Settings { ppo: &self.config.ppo, units: &self.units, decayed, learns, shared };
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

    fn actors<'a>(&'a mut self, threads: &'a Threads) -> Vec<Box<dyn Actor + 'a>> {
        let Ppo { policies, units, rollouts, base, .. } = self;
        let critics = Critics { policies, units, threads };
        let actor = |(rollout, dice)| Box::new(RolloutActor { critics, rollout, dice }) as Box<dyn Actor + 'a>;
        rollouts.iter_mut().zip(base.acting.iter_mut().map(|dice| &mut dice[..])).map(actor).collect()
    }

    /// After a round every lane has a whole rollout.
    fn learn(&mut self, steps: u64, watch: &mut Stopwatch) -> Result<Option<Metrics>> {
        let Ppo { memory, rollouts, in_memory, config, .. } = self;
        let copies = config.copies();
        watch.time(Phase::Bookkeeping, || {
            for rollout in &*rollouts {
                memory.take_rollout(*in_memory, rollout.part(), copies, rollout.memory());
            }
        });
        *in_memory += 1;
        if *in_memory * copies * config.ppo.rollout_steps < config.ppo.memory {
            return Ok(None);
        }
        *in_memory = 0;
        Ok(Some(self.update(steps - self.config.ppo.memory as u64, watch)))
    }

    fn no_metrics(&self) -> Metrics {
        metrics(&vec![Losses::default(); self.policies.agents()], self.decayed(0))
    }

    fn tables(&self) -> Tables {
        let widths = vec![self.config.copies() * self.policies.state_width(); self.policies.agents()];
        let values = self.base.places().flat_map(|(part, row)| self.rollouts[part].states.row(row));
        let states = Ragged::from_vec(values.copied().collect(), widths).expect("one state per row");
        let mut tables = self.base.tables();
        tables.numbers.insert(STATES.to_owned(), states);
        if self.config.ppo.value_unit != ValueUnit::Reward {
            tables.numbers.insert(VALUE_UNITS.to_owned(), self.units.table());
        }
        tables
    }

    fn load(&mut self, mut tables: Tables) {
        self.base.load(&mut tables);
        if self.config.ppo.value_unit != ValueUnit::Reward {
            self.units.load(&tables.take_numbers(VALUE_UNITS));
        }
        let states = tables.take_numbers(STATES);
        let width = self.policies.state_width();
        let rows = states.as_slice().chunks_exact(width.max(1));
        self.base.places().zip(rows).for_each(|((part, row), state)| self.rollouts[part].states.set_row(row, state));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Bootstrap, PolicyConfig, Share, Simulator};
    use crate::environments::Experience;
    use crate::fixtures::region;
    use dials_core::base::{Rows, Seed};
    use dials_core::domain::{Percept, SourceSpec};

    /// Trains one policy for two lights on the GS, of which the first one is jammed: it gets -0.019 in each step, so its value
    /// is -1.9. Returns both values.
    fn values_of_two_lights(bootstrap: Bootstrap) -> [f32; 2] {
        let spec = region(1, 1, SourceSpec::bits(1), 1000);
        let mut config = Config { simulator: Simulator::Global, total_steps: 1_000_000, ..Config::default() };
        config.policy = PolicyConfig { share: Share::Kind, hidden: vec![16], ..PolicyConfig::default() };
        config.gs.bootstrap = bootstrap;
        config.ppo = PpoConfig {
            value_unit: ValueUnit::Returns,
            clip_value: false,
            learning_rate: 1e-3,
            time_limit: TimeLimit::Bootstrap,
            ..config.ppo
        };
        let agents = AgentId::all(2);
        let stack = PolicyStack::new(&[agents[0]; 2], &spec, &config.policy, &[0.0; 2], Seed::new(1));
        let parts = config.parts(2, 1);
        let mut ppo = Ppo::new(&config, &spec, &agents, stack, &parts);
        let (threads, watch) = (Threads::one(), &mut Stopwatch::default());
        let percept = Percept { obs: Rows::from_vec(vec![1.0, 0.0], 1), ..Percept::new(2, &spec) };
        let experience = Experience { rewards: vec![-0.019, 0.0], ..Experience::new(2, &spec) };
        for round in 1..=1600 {
            for _ in 0..config.ppo.rollout_steps {
                let mut actors = ppo.actors(&threads);
                actors[0].act(&percept);
                actors[0].take_in(&experience, &percept, watch);
            }
            ppo.learn(round * config.ppo.rollout_steps as u64, watch).unwrap();
        }
        let judgement = ppo.policies.judge(0..2, &threads, &percept.obs, &mut ppo.policies.states(2));
        let outputs: Vec<f32> = judgement.rows().map(|(_, output)| output).collect();
        [0, 1].map(|agent| ppo.units.of(agent).value_of(outputs[agent]))
    }

    #[test]
    fn lights_with_one_policy_bootstrap_each_with_its_own_value() {
        let [jammed, free] = values_of_two_lights(Bootstrap::Own);
        assert!((jammed + 1.9).abs() < 0.19 && free.abs() < 0.19, "{jammed} {free}");
        // In the authors' way the last light speaks for both.
        let [jammed, _] = values_of_two_lights(Bootstrap::Last);
        assert!((jammed + 1.9).abs() > 0.5, "{jammed}");
    }
}
