//! The files of networks in a run directory: the newest policies and AIPs of all agents.
//!
//! A file has one stack of networks per kind of agents. If there are several kinds, the names of the tensors begin with the
//! kind's name.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, Result};

use super::checkpoint::Checkpoint;
use super::csv_table;
use super::files;
use super::resume_point::ResumePoint;
use crate::config::RunConfig;
use dials_core::base::{AgentId, Ragged};
use dials_core::domain::{Kind, Kinds, RegionSpec};
use dials_core::outside::{Directory, read_bytes};
use dials_learn::config::{AipConfig, Config, PolicyConfig, Predictor};
use dials_learn::policy::PolicyStack;
use stacknets::{Layout, StackToWrite, about_stacks, check_tensors, read_stack, write_stacks};

/// Largest file: 10 000 agents with 100 000 parameters each.
const LARGEST_FILE: u64 = 4 << 30;
/// Key of the timesteps per agent at which a file was written.
const STEPS: &str = "steps";

pub struct JointLayout {
    kinds: Vec<KindLayout>,
}

struct KindLayout {
    prefix: String,
    agents: Vec<AgentId>,
    layout: Layout,
}

impl JointLayout {
    /// Makes the layouts. `layout`: returns the layout of an agent's network.
    pub(crate) fn new(kinds: &Kinds, layout: impl Fn(&RegionSpec) -> Layout) -> JointLayout {
        let of_kind = |kind: &Kind| {
            let (prefix, agents) = (kinds.prefix(kind), kind.agents.clone());
            KindLayout { prefix, agents, layout: layout(&kind.spec) }
        };
        JointLayout { kinds: kinds.iter().map(of_kind).collect() }
    }

    pub fn of_policies(kinds: &Kinds, config: &PolicyConfig) -> JointLayout {
        JointLayout::new(kinds, |spec| PolicyStack::shape(spec, config).layout())
    }

    pub fn of_aips(kinds: &Kinds, choice: Predictor, config: &AipConfig) -> JointLayout {
        JointLayout::new(kinds, |spec| choice.kind().layout(spec, config))
    }

    /// Writes a file of networks, one row of parameters per agent, that have learnt for `steps` timesteps.
    pub(super) fn write(&self, directory: &Directory, name: &str, networks: &Ragged<f32>, steps: u64) -> Result<()> {
        let stacks = self.kinds.iter().map(|KindLayout { prefix, layout, agents }| {
            let rows = agents.iter().map(|agent| networks.row(agent.0)).collect();
            StackToWrite { prefix, layout, rows }
        });
        let about = HashMap::from([(STEPS.to_owned(), steps.to_string())]);
        directory.write_with(name, |beside| write_stacks(&stacks.collect::<Vec<_>>(), &about, beside))
    }

    /// Reads the networks of such a file, one row of parameters per agent.
    pub fn read(&self, path: &Path) -> Result<Ragged<f32>> {
        Ok(self.read_with_steps(path)?.0)
    }

    /// Reads the networks of such a file, and the timesteps per agent at which it was written, if it says so.
    /// The file is read once: a run that is being trained replaces it at any moment.
    pub(crate) fn read_with_steps(&self, path: &Path) -> Result<(Ragged<f32>, Option<u64>)> {
        let bytes = read_bytes(path, LARGEST_FILE).with_context(|| format!("{}: cannot be read", path.display()))?;
        check_tensors(&bytes, path, self.kinds.iter().map(|kind| (&*kind.prefix, &kind.layout)))?;
        let mut widths = vec![0; self.kinds.iter().map(|kind| kind.agents.len()).sum()];
        let of_agents =
            self.kinds.iter().flat_map(|kind| kind.agents.iter().map(|agent| (agent.0, kind.layout.width())));
        of_agents.for_each(|(agent, width)| widths[agent] = width);
        let mut networks = Ragged::new(widths);
        for KindLayout { prefix, agents, layout } in &self.kinds {
            let names: Vec<String> = agents.iter().map(|agent| format!("agent {agent}")).collect();
            let rows = read_stack(&bytes, path, prefix, layout, &names)?;
            agents.iter().zip(rows.iter()).for_each(|(agent, row)| networks.row_mut(agent.0).copy_from_slice(row));
        }
        let steps = about_stacks(&bytes).remove(STEPS).map(|steps| {
            let whole = steps.parse().ok();
            whole.with_context(|| {
                format!("{}: its metadata `{STEPS}` is {steps:?} instead of a whole number", path.display())
            })
        });
        Ok((networks, steps.transpose()?))
    }
}

/// Places of weights and biases in the networks that are saved.
pub struct Layouts {
    pub(crate) policies: JointLayout,
    pub(crate) aips: JointLayout,
}

impl Layouts {
    pub fn of(config: &Config, kinds: &Kinds) -> Layouts {
        Layouts {
            policies: JointLayout::of_policies(kinds, &config.policy),
            aips: JointLayout::of_aips(kinds, config.predictor(), &config.aip),
        }
    }

    /// Makes the files hold what the run had at the checkpoint of `point`. Returns the names of those that were lost or
    /// damaged. A file that is only newer, because the run was killed after it, is no loss.
    pub fn restore(&self, directory: &Directory, config: &RunConfig, point: &ResumePoint) -> Result<Vec<&'static str>> {
        let mut restored = Vec::new();
        let Some(Checkpoint { agents, .. }) = &point.checkpoint else { return Ok(restored) };
        let mut restore = |name, layout: &JointLayout, networks: &Ragged<f32>, steps| {
            let found = layout.read_with_steps(&directory.path_of(name)).ok();
            if found.as_ref().is_some_and(|(found, _)| found == networks) {
                return Ok(());
            }
            let is_newer = found.and_then(|(_, at)| at).is_some_and(|at| at > steps);
            if !is_newer {
                restored.push(name);
            }
            layout.write(directory, name, networks, steps)
        };
        restore(files::POLICIES, &self.policies, &agents.policies, agents.steps)?;
        if config.learning.predictor_in_use().is_some_and(|predictor| predictor.kind().learns())
            && let Some(steps) = trained_at(directory, point)?
        {
            restore(files::AIPS, &self.aips, &agents.aips, steps)?;
        }
        Ok(restored)
    }
}

/// Returns the timestep of the last AIP training before a checkpoint. What the file has after it will be cut off.
fn trained_at(directory: &Directory, point: &ResumePoint) -> Result<Option<u64>> {
    let mut bytes = directory.read(files::AIP_LOSS, csv_table::LARGEST_FILE)?.unwrap_or_default();
    bytes.truncate(point.mark(files::AIP_LOSS).bytes as usize);
    let text = String::from_utf8_lossy(&bytes);
    Ok(text.lines().last().and_then(|line| line.split(',').next()?.parse().ok()))
}
