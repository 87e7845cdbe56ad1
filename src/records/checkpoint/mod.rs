//! Checkpoints: the state of all agents in a file from which a run continues as if it had not stopped.
//!
//! A safetensors file (little-endian, like all machines on which Debian's libtorch runs). It has one table each for
//! policies, moments and AIPs (approximate influence predictors), one agent after another, and the bytes of all agents'
//! streams. Its metadata holds the other state, and the config and the scenario that it was trained with. A checkpoint
//! is written after every period; the last [`KEPT`] are kept.
//!
//! Nothing is restored from a file that does not fit the run in every way:
//!
//! - [`content`]: the bytes of the file, under one digest.
//! - [`owner`]: the run that it belongs to: what of the config and of the scenario may have changed since.
//! - [`fits`](crate::training::fits): sizes, actions, trails and counts, each of which follows from the config.

pub mod content;
pub mod owner;

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use safetensors::tensor::{Dtype, TensorView};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::atomic::write_beside;
use super::files;
use crate::base::Ragged;
use crate::config::resume::{from_json, to_json};
use crate::outside::read_bytes;
use crate::training::fits::{Widths, check_standing, check_state};
use crate::training::standing::Standing;
use crate::training::state::{AgentsState, JointMoments};
use crate::training::stream::AgentStream;
use content::{Part, seal, unseal};
use owner::{NotOfThisRun, Owner};

/// Number of checkpoints that are kept, the newest ones.
pub const KEPT: usize = 3;
/// Bump when older checkpoints can no longer be read.
const FORMAT: u32 = 4;

/// State of a run after a period.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    pub agents: AgentsState,
    pub progress: RunProgress,
}

/// State of the schedule and of the files of the run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunProgress {
    /// Where Algorithm 1 continues.
    pub standing: Standing,
    /// Length of every CSV file in bytes.
    pub file_lengths: BTreeMap<String, u64>,
    /// Wall time of the run so far.
    pub elapsed_s: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Metadata {
    format: u32,
    /// Version of this program that wrote the file.
    version: String,
    steps: u64,
    optimiser_steps: u32,
    /// The config and the scenario that the run had.
    config: Value,
    scenario: Value,
    progress: RunProgress,
}

/// Key of the bytes of all agents' streams, in postcard's format.
const STREAMS: &str = "streams";
const TABLES: [&str; 4] = ["policies", "first_moments", "second_moments", "aips"];

fn tables_of(agents: &AgentsState) -> [&Ragged<f32>; 4] {
    [&agents.policies, &agents.moments.first, &agents.moments.second, &agents.aips]
}

/// Writes a checkpoint of a run into `folder` and removes those that are no longer kept.
pub fn write(folder: &Path, owner: &Owner, agents: &AgentsState, progress: RunProgress) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    let path = folder.join(name_of(agents.steps));
    sealed(owner, agents, progress, |views, metadata| {
        // Directly to the file: the tables of a hundred agents need no second copy in memory.
        write_beside(&path, |beside| Ok(safetensors::serialize_to_file(views, Some(metadata), beside)?))
    })?;
    let all = list(folder)?;
    for (_, old) in &all[..all.len().saturating_sub(KEPT)] {
        std::fs::remove_file(old).with_context(|| format!("{}: cannot be removed", old.display()))?;
    }
    Ok(())
}

/// Makes the tensors and the metadata of a checkpoint, and hands them to `write`.
fn sealed<T>(
    owner: &Owner,
    agents: &AgentsState,
    progress: RunProgress,
    write: impl FnOnce(Vec<(&str, TensorView<'_>)>, HashMap<String, String>) -> Result<T>,
) -> Result<T> {
    let streams = postcard::to_stdvec(&agents.streams).context("the state of training cannot be encoded")?;
    let about = Metadata {
        format: FORMAT,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        steps: agents.steps,
        optimiser_steps: agents.moments.steps,
        config: to_json(&owner.config),
        scenario: owner.scenario.clone(),
        progress,
    };
    let tables = TABLES.iter().zip(tables_of(agents));
    let mut parts: Vec<Part<'_>> =
        tables.map(|(name, table)| Part::flat(name, Dtype::F32, bytemuck::cast_slice(table.as_slice()))).collect();
    parts.push(Part::flat(STREAMS, Dtype::U8, &streams));
    let (views, metadata) = seal(serde_json::to_string(&about)?, &parts)?;
    write(views, metadata)
}

impl Checkpoint {
    /// Reads the newest checkpoint of `folder`, if there is one. The error about a damaged one says what to do. One that
    /// is not of this run is a [`NotOfThisRun`].
    pub fn read_newest(folder: &Path, owner: &Owner) -> Result<Option<Checkpoint>> {
        let Some((steps, newest)) = list(folder)?.pop() else { return Ok(None) };
        let name = newest.display();
        let checkpoint = read(&newest, owner).and_then(|checkpoint| {
            let within = checkpoint.agents.steps;
            ensure!(within == steps, "its name says step {steps}, but it holds step {within}");
            Ok(checkpoint)
        });
        match checkpoint {
            Ok(checkpoint) => Ok(Some(checkpoint)),
            Err(error) => match error.downcast::<NotOfThisRun>() {
                Ok(NotOfThisRun(reason)) => Err(NotOfThisRun(format!("{name}: {reason}")).into()),
                Err(error) => Err(error.context(format!(
                    "{name}: cannot be resumed from; remove it to continue from the checkpoint before it"
                ))),
            },
        }
    }

    /// Reads a checkpoint of a run from the bytes of its file.
    pub fn from_bytes(bytes: &[u8], owner: &Owner) -> Result<Checkpoint> {
        let tables = TABLES.map(|name| (name, Dtype::F32));
        let [first, second, third, fourth] = tables;
        let (about, parts) = unseal(bytes, [first, second, third, fourth, (STREAMS, Dtype::U8)])?;
        let about: Metadata = serde_json::from_value(about).context("its metadata cannot be read")?;
        let Metadata { version, steps, optimiser_steps, config, scenario, progress, .. } = about;
        let config = from_json(config).with_context(|| {
            format!("its config cannot be read; if dials-traffic {version} wrote it, continue with that")
        })?;
        owner.check(&config, &scenario, progress.standing.until)?;

        let Widths { policies, aips } = Widths::of(&owner.config, &owner.kinds);
        let table = |index: usize, widths: &[usize]| rows_of(TABLES[index], parts[index], widths);
        let moments =
            JointMoments { first: table(1, &policies)?, second: table(2, &policies)?, steps: optimiser_steps };
        let (streams, rest) = postcard::take_from_bytes::<Vec<AgentStream>>(parts[TABLES.len()])
            .context("the state of training cannot be read")?;
        ensure!(rest.is_empty(), "it has {} bytes after the state of training", rest.len());
        let agents = AgentsState { steps, policies: table(0, &policies)?, moments, aips: table(3, &aips)?, streams };
        check_standing(&progress.standing, &agents, progress.elapsed_s, &config)?;
        check_state(&agents, &config, &owner.kinds)?;
        let unknown = progress.file_lengths.keys().find(|name| !files::GROWING.contains(&name.as_str()));
        ensure!(unknown.is_none(), "it counts the bytes of a file that no run has");
        Ok(Checkpoint { agents, progress })
    }
}

fn read(path: &Path, owner: &Owner) -> Result<Checkpoint> {
    let bytes = read_bytes(path, owner.most_bytes()).context("not a checkpoint of this run, or it cannot be read")?;
    Checkpoint::from_bytes(&bytes, owner)
}

fn rows_of(name: &str, bytes: &[u8], widths: &[usize]) -> Result<Ragged<f32>> {
    let values = bytes.as_chunks::<4>().0;
    let expected: usize = widths.iter().sum();
    ensure!(
        values.len() == expected,
        "its table `{name}` has {} values, and the {} agents of this run have {expected}",
        values.len(),
        widths.len()
    );
    let values = values.iter().map(|&value| f32::from_le_bytes(value)).collect();
    Ok(Ragged::from_vec(values, widths.iter().copied()).expect("their number was compared"))
}

/// Returns the name of the checkpoint at this number of timesteps per agent.
fn name_of(steps: u64) -> String {
    format!("step_{steps:012}.safetensors")
}

/// Returns the timesteps of a file with exactly such a name. All other files are somebody else's.
fn steps_of(name: &str) -> Option<u64> {
    let steps = name.strip_prefix("step_")?.strip_suffix(".safetensors")?.parse().ok()?;
    (name_of(steps) == name).then_some(steps)
}

/// Lists the checkpoints of a folder with their timesteps, oldest first. Without a folder the list is empty.
fn list(folder: &Path) -> Result<Vec<(u64, PathBuf)>> {
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let cannot = || format!("{}: cannot be read", folder.display());
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(cannot)? {
        let entry = entry.with_context(cannot)?;
        found.extend(entry.file_name().to_str().and_then(steps_of).map(|steps| (steps, entry.path())));
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::toy::Coins;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn the_newest_three_are_kept_and_files_of_other_names_are_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let owner = Owner::of(&crate::config::Config::default(), &Coins::new(4)).unwrap();
        assert_eq!(Checkpoint::read_newest(&dir.path().join("none"), &owner).unwrap(), None);
        let strangers = ["best.safetensors", "step_1.safetensors", "step_old_copy.safetensors"];
        strangers.iter().for_each(|name| std::fs::write(dir.path().join(name), "mine").unwrap());
        assert_eq!(Checkpoint::read_newest(dir.path(), &owner).unwrap(), None);
        // The last name is longer than the others: names are compared as numbers.
        for steps in [900, 1_000, 20_000, 999_999_999_999, 1_000_000_000_000] {
            let agents = AgentsState { steps, ..AgentsState::nobody() };
            write(dir.path(), &owner, &agents, RunProgress::default()).unwrap();
        }
        let mut expected: Vec<String> = strangers.map(str::to_owned).to_vec();
        expected.extend([20_000, 999_999_999_999, 1_000_000_000_000].map(name_of));
        expected.sort();
        assert_eq!(names(dir.path()), expected);
        let listed: Vec<u64> = list(dir.path()).unwrap().into_iter().map(|(steps, _)| steps).collect();
        assert_eq!(listed, [20_000, 999_999_999_999, 1_000_000_000_000]);
    }

    #[test]
    fn a_name_counts_only_as_it_is_written() {
        assert_eq!(steps_of("step_000000000128.safetensors"), Some(128));
        assert_eq!(steps_of("step_1000000000000.safetensors"), Some(1_000_000_000_000));
        for other in [
            "step_128.safetensors",
            "step_0000000000128.safetensors",
            "step_+00000000128.safetensors",
            "step_000000000128.safetensors.bak",
            ".new-step_000000000128.safetensors",
            "step_000000000128 copy.safetensors",
            "step_99999999999999999999.safetensors",
            "Step_000000000128.safetensors",
        ] {
            assert_eq!(steps_of(other), None, "{other}");
        }
    }

    #[test]
    fn the_limit_of_a_file_leaves_room_for_all_that_a_run_can_hold() {
        let config: crate::config::Config = toml::from_str("local_simulators.copies = 4\n").unwrap();
        let owner = Owner::of(&config, &Coins::new(300)).unwrap();
        let Widths { policies, aips } = Widths::of(&config, &owner.kinds);
        let values: usize = 3 * policies.iter().sum::<usize>() + aips.iter().sum::<usize>();
        let streams = owner.kinds.agents() * 4 * 300;
        assert!(owner.most_bytes() > (4 * values + streams) as u64);
        assert!(owner.most_bytes() < (4 * values + 4 * streams + (2 << 20)) as u64, "and not for much more");
    }
}
