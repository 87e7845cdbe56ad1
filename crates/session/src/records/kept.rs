//! What `run.json` remembers of the domain: the keys of its table and the files in `networks/`. So a change to a run
//! directory can be named.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::files::NETWORKS;
use crate::config::RunConfig;
use crate::config::resume::{Difference, differences, differing, to_json};
use crate::domains::DomainConfig;
use dials_core::outside::{LARGEST_NETWORK, read_bytes};

/// The domain of a run as it was when the run began.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// The domain's table of the config, under its name; paths are empty.
    pub(crate) config: Map<String, Value>,
    /// CRC-32 of each file in `networks/`, by its name.
    pub(crate) networks: BTreeMap<String, String>,
}

impl Kept {
    /// Returns what the run directory `dir` holds. `config`: its config.
    pub(crate) fn of(dir: &Path, config: &RunConfig) -> Result<Kept> {
        let name = config.domain.as_ref().map(DomainConfig::name);
        let table = |name: &str| (name.to_owned(), to_json(config)[name].take());
        Ok(Kept { config: name.map(table).into_iter().collect(), networks: checksums(dir)? })
    }

    pub(crate) fn is_empty(&self) -> bool {
        *self == Kept::default()
    }

    /// Lists the keys of the domain that `config` has other values for.
    pub(crate) fn changed_keys(&self, config: &RunConfig) -> Result<Vec<Difference>> {
        if self.config.is_empty() {
            return Ok(Vec::new());
        }
        let then = serde_json::from_value(json!(self.config)).context("the domain of run.json cannot be read")?;
        let now = RunConfig { domain: config.domain.clone(), ..RunConfig::default() };
        Ok(differences(&then, &now))
    }

    /// Lists the files in `networks/` that are there, but are other ones now. The figures of a run need no networks, so a
    /// copy of it may leave them out.
    pub(crate) fn changed_contents(&self, dir: &Path) -> Result<Vec<Difference>> {
        let mut changed = self.changed_files(dir)?;
        changed.retain(|difference| difference.then.is_some() && difference.now.is_some());
        Ok(changed)
    }

    /// Lists the files in `networks/` that are other ones now, are missing or are new.
    pub(crate) fn changed_files(&self, dir: &Path) -> Result<Vec<Difference>> {
        let of_file = |(name, checksums): (String, [Option<String>; 2])| {
            let [then, now] = checksums.map(|checksum| checksum.map(Value::String));
            Difference { key: format!("{NETWORKS}/{name}"), then, now }
        };
        Ok(differing(&self.networks, &checksums(dir)?).into_iter().map(of_file).collect())
    }
}

/// Returns the CRC-32 of each file in `networks/`, by its name. A domain without files has no such folder.
fn checksums(dir: &Path) -> Result<BTreeMap<String, String>> {
    let folder = dir.join(NETWORKS);
    if !folder.is_dir() {
        return Ok(BTreeMap::new());
    }
    let failed = |path: &Path| format!("{}: cannot be read", path.display());
    let mut checksums = BTreeMap::new();
    for entry in fs::read_dir(&folder).with_context(|| failed(&folder))? {
        let path = entry.with_context(|| failed(&folder))?.path();
        let bytes = read_bytes(&path, LARGEST_NETWORK).with_context(|| failed(&path))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        checksums.insert(name, format!("{:08x}", crc32fast::hash(&bytes)));
    }
    Ok(checksums)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(end_s: u64) -> RunConfig {
        let text = format!("[traffic]\nscenario = 'a/x.sumocfg'\nbegin_s = 0\nend_s = {end_s}\n");
        toml::from_str(&text).unwrap()
    }

    #[test]
    fn keys_and_files_that_changed_are_named_and_others_are_not() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join(NETWORKS)).unwrap();
        let file = |name: &str| dir.path().join(NETWORKS).join(name);
        ["a", "b", "c"].iter().for_each(|name| fs::write(file(name), name).unwrap());
        let kept = Kept::of(dir.path(), &config(600)).unwrap();

        let keys = |differences: Vec<Difference>| -> Vec<String> {
            differences.into_iter().map(|difference| difference.key).collect()
        };
        assert_eq!(keys(kept.changed_keys(&config(600)).unwrap()), [""; 0]);
        assert_eq!(keys(kept.changed_keys(&config(500)).unwrap()), ["traffic.end_s"]);
        assert_eq!(keys(kept.changed_files(dir.path()).unwrap()), [""; 0]);
        fs::write(file("b"), "other").unwrap();
        fs::rename(file("c"), file("d")).unwrap();
        assert_eq!(keys(kept.changed_files(dir.path()).unwrap()), ["networks/b", "networks/c", "networks/d"]);
        assert_eq!(keys(kept.changed_contents(dir.path()).unwrap()), ["networks/b"]);
        fs::remove_dir_all(dir.path().join(NETWORKS)).unwrap();
        assert_eq!(keys(kept.changed_contents(dir.path()).unwrap()), [""; 0]);
    }
}
