//! `--csv`: the CSV files of `evaluate` and `baseline`.

use std::path::Path;

use anyhow::Result;

use dials_core::outside::Directory;
use dials_learn::evaluation::Finding;
use dials_learn::evaluation::csv::{by_agent, by_episode};
use dials_session::outputs;
use dials_session::places::{self, Existing};
use dials_session::records::growing::{GrowingFile, Mark};

/// The CSV files of `--csv`. The lines of each player are written as soon as it has played.
pub(super) struct CsvFiles {
    directory: Directory,
    episodes: GrowingFile,
    agents: GrowingFile,
}

impl CsvFiles {
    /// Makes the directory. If one of the files exists, `existing` says what becomes of it.
    pub(super) fn create(dir: &Path, existing: Existing) -> Result<CsvFiles> {
        let names = ["episodes.csv", "agents.csv"];
        let paths = names.map(|name| dir.join(name));
        paths.iter().try_for_each(|file| outputs::check_free(file, "--csv", existing))?;
        outputs::check_writable(dir)?;
        paths.iter().try_for_each(|file| places::clear(file, existing))?;
        let [episodes, agents] = names.map(|name| GrowingFile::new(name, Mark::default()));
        Ok(CsvFiles { directory: Directory::open(dir)?, episodes, agents })
    }

    pub(super) fn append(&mut self, finding: &Finding) -> Result<()> {
        self.episodes.append_lines(&self.directory, &by_episode(finding))?;
        self.agents.append_lines(&self.directory, &by_agent(finding))
    }
}
