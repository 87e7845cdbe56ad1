//! `--csv`: the CSV files of `evaluate` and `baseline`.

use std::path::Path;

use anyhow::{Result, ensure};

use super::{outputs, places};
use crate::evaluation::Finding;
use crate::evaluation::csv::{Lines, by_agent, by_episode};
use crate::outside::Directory;
use crate::records::csv::block;
use crate::records::growing::{GrowingFile, Mark};

/// The CSV files of `--csv`. The lines of each player are written as soon as it has played.
pub struct CsvFiles {
    directory: Directory,
    episodes: GrowingFile,
    agents: GrowingFile,
}

impl CsvFiles {
    /// Makes the directory. If one of the files exists or cannot be written, this is an error.
    pub fn create(dir: &Path) -> Result<CsvFiles> {
        let names = ["episodes.csv", "agents.csv"];
        for file in names.map(|name| dir.join(name)) {
            outputs::check_not_of_a_run("--csv", &file)?;
            ensure!(
                places::is_free(&file),
                "{}: exists already; move it away or name another directory",
                file.display()
            );
        }
        outputs::check_writable(dir)?;
        let [episodes, agents] = names.map(|name| GrowingFile::new(name, Mark::default()));
        Ok(CsvFiles { directory: Directory::open(dir)?, episodes, agents })
    }

    pub fn append(&mut self, finding: &Finding) -> Result<()> {
        for (file, Lines { header, lines }) in
            [(&mut self.episodes, by_episode(finding)), (&mut self.agents, by_agent(finding))]
        {
            file.append(&self.directory, |new| block(&header, &lines, new))?;
        }
        Ok(())
    }
}
