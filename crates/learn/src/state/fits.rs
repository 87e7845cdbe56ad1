//! Whether the state of agents, from a file or a worker, is one that training under a config leads to: training indexes
//! by its actions, and replays its trails. Almost everything about it follows from the number of timesteps.

use std::ops::Range;

use anyhow::{Context, ensure};

use crate::algorithms::{self, Layout, Tables, check_finite};
use crate::config::{Config, Simulator};
use crate::environments::ials::head_start;
use crate::policy::PolicyStack;
use crate::state::AgentsState;
use crate::state::stream::{AgentStream, RowStream};
use crate::worker::block::episode_steps;
use dials_core::base::{AgentId, Ragged, is_stuck};
use dials_core::domain::{Kinds, RegionSpec, Result};

/// Number of parameters of every agent's policy and influence predictor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Widths {
    pub policies: Vec<usize>,
    pub aips: Vec<usize>,
}

impl Widths {
    pub fn of(config: &Config, kinds: &Kinds) -> Widths {
        let policy = |spec: &RegionSpec| PolicyStack::shape(spec, &config.policy).layout().width();
        let aip = |spec: &RegionSpec| config.predictor().kind().layout(spec, &config.aip).width();
        // Once for each kind: a layout is a list of names.
        let of_kinds: Vec<[usize; 2]> = kinds.iter().map(|kind| [policy(&kind.spec), aip(&kind.spec)]).collect();
        let of_agents = |which: usize| {
            let agents = AgentId::all(kinds.agents()).into_iter();
            agents.map(|agent| of_kinds[kinds.place(agent).kind][which]).collect()
        };
        Widths { policies: of_agents(0), aips: of_agents(1) }
    }
}

/// Some agents of a run, next to each other: what a state of them must be like.
pub struct Fit<'a> {
    pub config: &'a Config,
    pub kinds: &'a Kinds,
    pub widths: &'a Widths,
    pub agents: Range<usize>,
}

impl Fit<'_> {
    pub(crate) fn specs(&self) -> impl Iterator<Item = &RegionSpec> {
        self.agents.clone().map(|agent| &self.kinds.of(AgentId(agent)).spec)
    }

    pub(crate) fn check_policies(&self, table: &Ragged<f32>) -> Result<()> {
        self.check_widths("policies", table, &self.widths.policies)
    }

    pub(crate) fn check_aips(&self, table: &Ragged<f32>) -> Result<()> {
        self.check_widths("aips", table, &self.widths.aips)
    }

    /// Returns an error that names the first agent whose state does not fit, and how.
    ///
    /// Networks and hidden states may hold any number: a policy that has diverged is not a damaged state. See
    /// [`Fit::check_numbers`].
    pub fn check(&self, state: &AgentsState) -> Result<()> {
        let AgentsState { steps, policies, learners, aips, streams, outside_aips: _ } = state;
        self.check_policies(policies)?;
        self.check_aips(aips)?;
        ensure!(
            streams.len() == self.agents.len(),
            "it has {} streams for {} agents",
            streams.len(),
            self.agents.len()
        );
        let per_update = algorithms::of(self.config).steps_per_update() as u64;
        ensure!(steps.is_multiple_of(per_update), "its step {steps} is not a multiple of {per_update}");
        let layouts = self.layouts(*steps);
        for layout in &layouts {
            self.check_learners(learners, layout)?;
        }
        for ((index, agent), (stream, spec)) in self.agents.clone().enumerate().zip(streams.iter().zip(self.specs())) {
            learners.check_agent(index, &layouts[self.kind_of(agent)]).with_context(|| format!("agent {agent}"))?;
            check_stream(stream, *steps, self.config, spec).with_context(|| format!("agent {agent}"))?;
        }
        Ok(())
    }

    fn kind_of(&self, agent: usize) -> usize {
        self.kinds.place(AgentId(agent)).kind
    }

    /// Returns the layouts of the learners' tables, one per kind, after this number of timesteps per agent.
    fn layouts(&self, steps: u64) -> Vec<Layout> {
        self.kinds.iter().map(|kind| algorithms::of(self.config).layout(self.config, kind, steps)).collect()
    }

    /// Checks names, numbers of rows and counts of the learners' tables.
    fn check_learners(&self, learners: &Tables, layout: &Layout) -> Result<()> {
        learners.check_names(layout)?;
        let count = self.agents.len();
        let numbers = learners.numbers.iter().map(|(name, table)| (name, table.len()));
        for (name, rows) in numbers.chain(learners.dice.iter().map(|(name, dice)| (name, dice.len()))) {
            ensure!(rows == count, "its table `{name}` is of {rows} agents, not of {count}");
        }
        for (name, expected) in &layout.counts {
            let found = learners.counts[*name];
            ensure!(found == *expected, "its count `{name}` is {found}, but {expected} at this step");
        }
        Ok(())
    }

    /// Returns an error that names the first agent with a number that training cannot continue from. The state fits.
    pub fn check_numbers(&self, state: &AgentsState) -> Result<()> {
        let layouts = self.layouts(state.steps);
        for (index, (agent, spec)) in self.agents.clone().zip(self.specs()).enumerate() {
            let check = || {
                check_finite("policies", state.policies.row(index))?;
                check_finite("aips", state.aips.row(index))?;
                state.learners.check_numbers(index, &layouts[self.kind_of(agent)])?;
                self.config.predictor().kind().check_values(spec, &self.config.aip, state.aips.row(index))?;
                let bad = state.streams[index].rows.iter().position(|row| !row.rewards.is_finite());
                let copy = bad.unwrap_or(0);
                ensure!(bad.is_none(), "copy {copy} of its region: its sum of rewards is not a finite number");
                Ok(())
            };
            check().with_context(|| format!("agent {agent}"))?;
        }
        Ok(())
    }

    fn check_widths(&self, name: &str, table: &Ragged<f32>, widths: &[usize]) -> Result<()> {
        let count = self.agents.len();
        ensure!(table.len() == count, "its table `{name}` is of {} agents, not of {count}", table.len());
        for (agent, found) in self.agents.clone().zip(table.widths()) {
            let expected = widths[agent];
            ensure!(found == expected, "its table `{name}` has {found} values of agent {agent}, not {expected}");
        }
        Ok(())
    }
}

fn check_stream(stream: &AgentStream, steps: u64, config: &Config, spec: &RegionSpec) -> Result<()> {
    let copies = config.copies();
    ensure!(stream.rows.len() == copies, "it has {} copies of its region, not {copies}", stream.rows.len());
    for (copy, row) in stream.rows.iter().enumerate() {
        check_row(row, copy, steps, config, spec).with_context(|| format!("copy {copy} of its region"))?;
    }
    Ok(())
}

fn check_row(row: &RowStream, copy: usize, steps: u64, config: &Config, spec: &RegionSpec) -> Result<()> {
    let (on_gs, copies) = (config.simulator == Simulator::Global, config.copies());
    let RowStream { trail, influence, rewards: _ } = row;
    ensure!(
        !is_stuck(influence),
        "the dice of its influence sources are all zeros, and would show the same number for ever"
    );
    let horizon = episode_steps(spec, config);
    let head_start = if config.local_simulators.stagger { head_start(copy, copies, horizon) as u64 } else { 0 };
    // Episodes are cut by the horizon alone, so the number of steps says where each one stands.
    let played = steps / copies as u64 + head_start;
    let (episode, of_episode) = (played / horizon as u64, played % horizon as u64);
    let expected = if episode == 0 { of_episode - head_start } else { of_episode };
    ensure!(
        (trail.episode, trail.steps() as u64) == (episode, expected),
        "it is {} steps into episode {}, but at step {steps} of training {expected} steps into episode {episode}",
        trail.steps(),
        trail.episode
    );
    if let Some(bad) = trail.actions.iter().find(|&&action| usize::from(action) >= spec.n_actions) {
        anyhow::bail!("it took action {bad}, but there are {} actions", spec.n_actions);
    }
    let sources = if on_gs { 0 } else { spec.sources.count() };
    ensure!(
        trail.sources.len() == trail.steps() * sources,
        "it has {} values of influence sources in {} steps, not {sources} in each",
        trail.sources.len(),
        trail.steps()
    );
    if sources > 0 {
        let with_classes = trail.sources.iter().zip(spec.sources.classes.iter().cycle());
        if let Some((bad, classes)) = with_classes.into_iter().find(|(value, classes)| value >= classes) {
            anyhow::bail!("an influence source has the value {bad}, but it has {classes} classes");
        }
    }
    Ok(())
}
