//! `--csv`: files that are written player by player.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::places;
use crate::evaluation::Finding;
use crate::evaluation::csv::{Lines, by_agent, by_episode};
use crate::records::csv::append;

/// The CSV files of `--csv`: they get the lines of a player as soon as it has played.
pub struct CsvFiles {
    episodes: PathBuf,
    agents: PathBuf,
}

impl CsvFiles {
    /// Makes the directory; files that are there already are an error, and so is a place that cannot be written to.
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
