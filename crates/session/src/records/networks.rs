//! The files of the networks in a run directory: the newest policies and AIPs (approximate influence predictors).

use std::collections::HashMap;

use anyhow::Result;

use super::checkpoint::Checkpoint;
use super::csv_table::LARGEST_FILE;
use super::files;
use super::joint_layout::{JointLayout, STEPS};
use super::resume_point::ResumePoint;
use crate::config::RunConfig;
use dials_core::base::Ragged;
use dials_core::domain::Kinds;
use dials_core::outside::Directory;
use dials_learn::config::Config;
use dials_learn::state::AgentsState;

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

    pub(super) fn write_policies(&self, directory: &Directory, agents: &AgentsState) -> Result<()> {
        write(&self.policies, directory, files::POLICIES, &agents.policies, agents.steps)
    }

    /// `steps`: timesteps per agent at which these AIPs were trained.
    pub(super) fn write_aips(&self, directory: &Directory, agents: &AgentsState, steps: u64) -> Result<()> {
        write(&self.aips, directory, files::AIPS, &agents.aips, steps)
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
            write(layout, directory, name, networks, steps)
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

/// Returns the timesteps per agent at the last training of the AIPs before a checkpoint. What comes after it in the file
/// may be damaged: it will be cut off.
fn trained_at(directory: &Directory, point: &ResumePoint) -> Result<Option<u64>> {
    let mut bytes = directory.read(files::AIP_LOSS, LARGEST_FILE)?.unwrap_or_default();
    bytes.truncate(point.mark(files::AIP_LOSS).bytes as usize);
    let text = String::from_utf8_lossy(&bytes);
    Ok(text.lines().last().and_then(|line| line.split(',').next()?.parse().ok()))
}

/// `steps`: timesteps per agent that the networks have learnt.
fn write(layout: &JointLayout, directory: &Directory, name: &str, networks: &Ragged<f32>, steps: u64) -> Result<()> {
    let about = HashMap::from([(STEPS.to_owned(), steps.to_string())]);
    directory.write_with(name, |beside| layout.write(networks, &about, beside))
}
