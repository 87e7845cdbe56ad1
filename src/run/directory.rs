//! Run directories: made, described, and opened again.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use serde_json::json;

use super::domain;
use super::info::versions;
use crate::base::AgentId;
use crate::config::{self, Config};
use crate::domain::Domain;
use crate::nn::read_stack;
use crate::policy::{JointPolicy, PolicyStack};
use crate::training::block::initial_policies;
use crate::training::run_log::{files, write_atomically};

/// A directory that one run writes. Self-contained: it holds the networks it was trained on.
pub struct RunDirectory {
    path: PathBuf,
}

impl RunDirectory {
    /// Makes a new one; an error where something is there already.
    pub fn create(path: &Path) -> Result<Self> {
        if path.exists() {
            bail!("{}: exists already; name another one with --out, or move it aside with --force", path.display());
        }
        std::fs::create_dir_all(path).with_context(|| format!("{}: cannot be made", path.display()))?;
        Ok(RunDirectory { path: path.to_owned() })
    }

    /// Makes a new one and moves what is there aside, to the first free of `path.old-1`, `path.old-2`, ...
    pub fn replace(path: &Path) -> Result<Self> {
        if path.exists() {
            let aside = first_free(path, "old");
            std::fs::rename(path, &aside).with_context(|| format!("{}: cannot be moved aside", path.display()))?;
            eprintln!("moved {} to {}", path.display(), aside.display());
        }
        Self::create(path)
    }

    /// Makes the first free of `path`, `path-2`, `path-3`, ...
    pub fn create_numbered(path: &Path) -> Result<Self> {
        let mut free = path.to_owned();
        for number in 2.. {
            if !free.exists() {
                break;
            }
            free = with_suffix(path, &format!("-{number}"));
        }
        Self::create(&free)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes config, networks and circumstances.
    pub fn describe(&self, config: &Config) -> Result<()> {
        let kept = domain::keep_files(config, &self.path.join(files::NETWORKS), &self.path)?;
        write_atomically(&self.path.join(files::CONFIG), config::to_toml(&kept)?.as_bytes())?;
        let run = json!({
            "seed": config.seed,
            "command": std::env::args().collect::<Vec<_>>(),
            "versions": versions()?,
        });
        write_atomically(&self.path.join(files::RUN), format!("{run:#}\n").as_bytes())
    }
}

/// What [`open`] finds: a run that can be evaluated.
pub struct TrainedRun {
    pub config: Config,
    pub domain: Arc<dyn Domain>,
    /// Policies of the right shape for [`crate::policy::JointPolicyController`].
    pub stack: PolicyStack,
    pub policies: JointPolicy,
}

/// Reads the config of a run directory and opens its domain.
pub fn open_config(path: &Path) -> Result<(Config, Arc<dyn Domain>)> {
    let config_path = path.join(files::CONFIG);
    ensure!(
        config_path.is_file(),
        "{}: not a run directory: it has no {}; `dials-traffic train` makes one",
        path.display(),
        files::CONFIG
    );
    let config = config::load(&config_path, &[])?;
    let domain = domain::open(&config)?;
    Ok((config, domain))
}

/// Reads a run directory with its policies.
pub fn open(path: &Path) -> Result<TrainedRun> {
    let (config, domain) = open_config(path)?;
    let stack = initial_policies(&*domain, &config, &AgentId::all(domain.agents()));
    let saved = path.join(files::POLICIES);
    ensure!(saved.is_file(), "{}: has no policies yet; they are written after the first period", path.display());
    let policies = read_stack(&saved, stack.parameters().layout(), domain.agents())?;
    Ok(TrainedRun { config, domain, stack, policies })
}

fn first_free(path: &Path, word: &str) -> PathBuf {
    (1..)
        .map(|number| with_suffix(path, &format!(".{word}-{number}")))
        .find(|free| !free.exists())
        .expect("numbers go on")
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(suffix);
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_existing_directory_is_refused_numbered_or_moved_aside() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.b");
        RunDirectory::create(&path).unwrap();
        std::fs::write(path.join("precious"), "x").unwrap();
        let error = RunDirectory::create(&path).err().unwrap().to_string();
        assert!(error.contains("exists already") && error.contains("--force"), "{error}");
        assert_eq!(RunDirectory::create_numbered(&path).unwrap().path(), dir.path().join("a.b-2"));
        assert_eq!(RunDirectory::create_numbered(&path).unwrap().path(), dir.path().join("a.b-3"));
        RunDirectory::replace(&path).unwrap();
        assert!(!path.join("precious").exists());
        assert!(dir.path().join("a.b.old-1/precious").exists());
    }
}
