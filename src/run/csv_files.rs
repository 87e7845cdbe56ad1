//! `--csv`: the CSV files of `evaluate` and `baseline`.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::places;
use crate::evaluation::Finding;
use crate::evaluation::csv::{Lines, by_agent, by_episode};
use crate::records::csv::append;

/// The CSV files of `--csv`. The lines of each player are written as soon as it has played.
pub struct CsvFiles {
    episodes: PathBuf,
    agents: PathBuf,
}

impl CsvFiles {
    /// Makes the directory. If one of the files exists or cannot be written, this is an error.
    pub fn create(dir: &Path) -> Result<CsvFiles> {
        let files = CsvFiles { episodes: dir.join("episodes.csv"), agents: dir.join("agents.csv") };
        for file in [&files.episodes, &files.agents] {
            ensure!(!file.exists(), "{}: exists already; move it away or name another directory", file.display());
        }
        places::check_writable(dir)?;
        Ok(files)
    }

    pub fn append(&self, finding: &Finding) -> Result<()> {
        for (file, Lines { header, lines }) in
            [(&self.episodes, by_episode(finding)), (&self.agents, by_agent(finding))]
        {
            append(file, &header, &lines)?;
        }
        Ok(())
    }
}
