//! Checkpoints: the state of all agents in a file from which a run continues as if it had not stopped.
//!
//! A safetensors file (little-endian, like all machines on which Debian's libtorch runs). It has one table each for
//! policies, moments and AIPs (approximate influence predictors), one agent after another. Its metadata holds the
//! number of values of each agent, the other state, and a checksum. A checkpoint is written after every period; the
//! last [`KEPT`] are kept.

use std::collections::{BTreeMap, HashMap};

use anyhow::{Context, Result, bail, ensure};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::growing::Mark;
use crate::base::Ragged;
use crate::outside::Directory;
use crate::training::drift::Drift;
use crate::training::standing::Standing;
use crate::training::state::{AgentsState, JointMoments};
use crate::training::stream::AgentStream;

/// Number of checkpoints that are kept, the newest ones.
pub const KEPT: usize = 3;
/// Bump when older checkpoints can no longer be read.
const FORMAT: u32 = 4;
/// Beginning and end of the name of a checkpoint. Its step stands between them.
const BEGINNING: &str = "step_";
const ENDING: &str = ".safetensors";
const DIGITS: usize = 12;

/// State of a run after a period.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    pub agents: AgentsState,
    pub progress: RunProgress,
}

/// State of the schedule and of the files of the run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunProgress {
    pub periods_done: usize,
    /// How far every growing file has come.
    pub growing: BTreeMap<String, Mark>,
    /// Wall time of the run so far.
    pub elapsed_s: f64,
    /// Drift of the AIPs since their last training.
    #[serde(default)]
    pub drift: Drift,
}

impl RunProgress {
    /// Returns where Algorithm 1 continues.
    pub fn standing(&self) -> Standing {
        Standing { periods_done: self.periods_done, drift: self.drift }
    }
}

#[derive(Serialize, Deserialize)]
struct Metadata {
    format: u32,
    steps: u64,
    optimiser_steps: u32,
    /// Number of parameters of every agent's policy and AIP: agents of different kinds have different networks.
    policy_widths: Vec<usize>,
    aip_widths: Vec<usize>,
    progress: RunProgress,
    /// Checksum of the tables' bytes, one after another.
    crc32: u32,
}

/// Key of the bytes of all agents' streams, in postcard's format.
const STREAMS: &str = "streams";
const TABLES: [&str; 4] = ["policies", "first_moments", "second_moments", "aips"];

fn tables_of(agents: &AgentsState) -> [&Ragged<f32>; 4] {
    [&agents.policies, &agents.moments.first, &agents.moments.second, &agents.aips]
}

/// Writes a checkpoint into `folder` and removes those that are no longer kept.
pub fn write(folder: &Directory, agents: &AgentsState, progress: RunProgress) -> Result<()> {
    let tables = tables_of(agents);
    let bytes = tables.map(|table| bytemuck::cast_slice::<f32, u8>(table.as_slice()));
    let streams = postcard::to_stdvec(&agents.streams).context("the state of training cannot be encoded")?;
    let about = Metadata {
        format: FORMAT,
        steps: agents.steps,
        optimiser_steps: agents.moments.steps,
        policy_widths: agents.policies.widths().collect(),
        aip_widths: agents.aips.widths().collect(),
        progress,
        crc32: checksum(bytes.into_iter().chain([&streams[..]])),
    };
    let mut views = Vec::new();
    for ((name, table), bytes) in TABLES.iter().zip(tables).zip(bytes) {
        views.push((*name, TensorView::new(Dtype::F32, vec![table.as_slice().len()], bytes)?));
    }
    views.push((STREAMS, TensorView::new(Dtype::U8, vec![streams.len()], &streams)?));
    let metadata = HashMap::from([("checkpoint".to_owned(), serde_json::to_string(&about)?)]);
    let name = format!("{BEGINNING}{:0DIGITS$}{ENDING}", agents.steps);
    // Directly to the file: the tables of a hundred agents need no second copy in memory.
    folder.write_with(&name, |beside, _| Ok(safetensors::serialize_to_file(views, Some(metadata), beside)?))?;
    let all = list(folder)?;
    all[..all.len().saturating_sub(KEPT)].iter().try_for_each(|old| folder.remove(old))
}

impl Checkpoint {
    /// Reads a checkpoint. The error about a damaged one says what to do.
    pub fn read(folder: &Directory, name: &str) -> Result<Checkpoint> {
        let bytes = folder.read(name, u64::MAX)?.unwrap_or_default();
        decode(&bytes).with_context(|| {
            let path = folder.path_of(name);
            format!("{}: cannot be resumed from; remove it to continue from the checkpoint before it", path.display())
        })
    }
}

fn decode(bytes: &[u8]) -> Result<Checkpoint> {
    let file = SafeTensors::deserialize(bytes).context("it is cut short, or not a safetensors file")?;
    let (_, header) = SafeTensors::read_metadata(bytes)?;
    let about = header.metadata().as_ref().and_then(|metadata| metadata.get("checkpoint"));
    let about: serde_json::Value = serde_json::from_str(about.context("it is not a checkpoint")?)?;
    ensure!(
        about["format"] == FORMAT,
        "it has format {}, and this program reads format {FORMAT}: continue with the version that wrote it",
        about["format"]
    );
    let about: Metadata = serde_json::from_value(about)?;
    let tensors = TABLES.iter().map(|name| file.tensor(name)).collect::<Result<Vec<_>, _>>()?;
    let streams = file.tensor(STREAMS)?;
    ensure!(
        checksum(tensors.iter().chain([&streams]).map(|tensor| tensor.data())) == about.crc32,
        "its checksum is wrong: it is damaged"
    );
    let widths = [&about.policy_widths, &about.policy_widths, &about.policy_widths, &about.aip_widths];
    let tables = tensors.iter().zip(widths).map(|(tensor, widths)| rows_of(tensor, widths));
    let tables: Vec<Ragged<f32>> = tables.collect::<Result<_>>()?;
    TABLES.iter().zip(&tables).try_for_each(|(name, table)| check_finite(name, table))?;
    let [policies, first, second, aips] = tables.try_into().expect("there are four tables");
    let moments = JointMoments { first, second, steps: about.optimiser_steps };
    let streams: Vec<AgentStream> =
        postcard::from_bytes(streams.data()).context("the state of training cannot be read")?;
    ensure!(streams.len() == policies.len(), "it has {} policies and {} streams", policies.len(), streams.len());
    let agents = AgentsState { steps: about.steps, policies, moments, aips, streams };
    Ok(Checkpoint { agents, progress: about.progress })
}

fn rows_of(tensor: &TensorView<'_>, widths: &[usize]) -> Result<Ragged<f32>> {
    let values = tensor.data().as_chunks::<4>().0.iter().map(|&value| f32::from_le_bytes(value));
    let rows = Ragged::from_vec(values.collect(), widths.iter().copied());
    rows.with_context(|| format!("a table of shape {:?} for {} agents", tensor.shape(), widths.len()))
}

/// Returns an error that names the first agent whose row holds a value that is not a finite number.
fn check_finite(name: &str, table: &Ragged<f32>) -> Result<()> {
    for (agent, row) in table.iter().enumerate() {
        if let Some(bad) = row.iter().find(|value| !value.is_finite()) {
            bail!("its table `{name}` holds {bad} for agent {agent}, which is not a finite number");
        }
    }
    Ok(())
}

fn checksum<'a>(parts: impl Iterator<Item = &'a [u8]>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    parts.for_each(|part| hasher.update(part));
    hasher.finalize()
}

/// Returns whether a file has the name of a checkpoint.
pub fn is_checkpoint(name: &str) -> bool {
    let steps = name.strip_prefix(BEGINNING).and_then(|rest| rest.strip_suffix(ENDING));
    steps.is_some_and(|steps| steps.len() == DIGITS && steps.bytes().all(|byte| byte.is_ascii_digit()))
}

/// Lists the checkpoints of a folder, oldest first.
pub fn list(folder: &Directory) -> Result<Vec<String>> {
    let names = folder.names()?.into_iter().filter_map(|name| name.into_string().ok());
    Ok(names.filter(|name| is_checkpoint(name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    use crate::base::Seed;
    use crate::training::stream::{RowStream, Trail};

    fn checkpoint(steps: u64) -> Checkpoint {
        let rows = |from: u8, widths| Ragged::from_vec((from..from + 6).map(f32::from).collect(), widths).unwrap();
        // The second agent is of another kind.
        let (policies, aips) = ([1, 4, 1], [2, 2, 2]);
        let moments = JointMoments { first: rows(10, policies), second: rows(20, policies), steps: 12 };
        let row = RowStream {
            trail: Trail { episode: 5, actions: vec![0, 1], sources: vec![1, 0, 0, 1], shown: 77 },
            rewards: 1.25,
            ..RowStream::begin(Seed::new(1).dice(), Seed::new(2).dice(), &[0.5])
        };
        let streams = vec![AgentStream { minibatches: Seed::new(3).dice(), rows: vec![row] }; 3];
        let agents = AgentsState { steps, policies: rows(0, policies), moments, aips: rows(30, aips), streams };
        let growing = BTreeMap::from([("returns.csv".to_owned(), Mark { bytes: 77, crc32c: 5 })]);
        Checkpoint {
            agents,
            progress: RunProgress { periods_done: 2, growing, elapsed_s: 1.5, drift: Drift::default() },
        }
    }

    fn save(steps: u64, folder: &Path) {
        let Checkpoint { agents, progress } = checkpoint(steps);
        write(&Directory::open(folder).unwrap(), &agents, progress).unwrap();
    }

    fn newest(folder: &Path) -> Result<Checkpoint> {
        let folder = Directory::open(folder)?;
        Checkpoint::read(&folder, list(&folder)?.last().unwrap())
    }

    fn error_of(folder: &Path) -> String {
        format!("{:#}", newest(folder).unwrap_err())
    }

    #[test]
    fn the_newest_comes_back_and_the_last_three_are_kept() {
        let dir = tempfile::tempdir().unwrap();
        for other in ["best.safetensors", "step_old_copy.safetensors", "step_0000000001280.safetensors"] {
            std::fs::write(dir.path().join(other), "precious").unwrap();
        }
        for steps in [900, 1_000, 20_000, 300_000, 4_000_000] {
            save(steps, dir.path());
        }
        assert_eq!(newest(dir.path()).unwrap(), checkpoint(4_000_000));
        assert_eq!(list(&Directory::open(dir.path()).unwrap()).unwrap().len(), KEPT);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), KEPT + 3, "other files stay");
    }

    #[test]
    fn what_is_no_finite_number_is_refused_with_its_table_and_its_agent() {
        let dir = tempfile::tempdir().unwrap();
        type Pick = fn(&mut AgentsState) -> &mut Ragged<f32>;
        let tables: [(&str, Pick); 4] = [
            ("policies", |agents| &mut agents.policies),
            ("first_moments", |agents| &mut agents.moments.first),
            ("second_moments", |agents| &mut agents.moments.second),
            ("aips", |agents| &mut agents.aips),
        ];
        for (name, table) in tables {
            for (bad, word) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf")] {
                let Checkpoint { mut agents, progress } = checkpoint(128);
                table(&mut agents).row_mut(2)[0] = bad;
                write(&Directory::open(dir.path()).unwrap(), &agents, progress).unwrap();
                let error = error_of(dir.path());
                assert!(error.contains("step_000000000128.safetensors: cannot be resumed from; remove it"), "{error}");
                assert!(error.contains(&format!("`{name}` holds {word} for agent 2")), "{error}");
            }
        }
    }

    #[test]
    fn damage_is_found_and_the_file_is_named() {
        let dir = tempfile::tempdir().unwrap();
        save(128, dir.path());
        let path = dir.path().join("step_000000000128.safetensors");
        let whole = std::fs::read(&path).unwrap();

        std::fs::write(&path, &whole[..whole.len() - 9]).unwrap();
        let error = error_of(dir.path());
        assert!(error.contains("step_000000000128.safetensors") && error.contains("cut short"), "{error}");
        assert!(error.contains("remove it to continue from the checkpoint before it"), "{error}");

        let mut flipped = whole.clone();
        *flipped.last_mut().unwrap() ^= 1;
        std::fs::write(&path, flipped).unwrap();
        assert!(error_of(dir.path()).contains("checksum"), "{}", error_of(dir.path()));

        let place = whole.windows(10).position(|bytes| bytes == b"format\\\":4").unwrap();
        let mut newer = whole.clone();
        newer[place + 9] = b'7';
        std::fs::write(&path, newer).unwrap();
        assert!(error_of(dir.path()).contains("it has format 7"), "{}", error_of(dir.path()));
    }
}
