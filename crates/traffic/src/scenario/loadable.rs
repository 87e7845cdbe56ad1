//! A scenario as SUMO of this process loads it.

use std::path::PathBuf;

use anyhow::{Error, Result, anyhow};

use super::{File, SumoScenario};
use crate::network::contents::renamed;
use crate::network::memory_file::MemoryFile;

/// A scenario that SUMO of this process can load, any number of times.
pub struct Loadable {
    net: Loaded,
    additional: Vec<Loaded>,
    routes: Vec<Loaded>,
    window_s: (u64, u64),
    options: Vec<(String, String)>,
}

/// A file in memory, and the path that the user knows.
struct Loaded {
    memory: MemoryFile,
    path: PathBuf,
}

impl Loaded {
    fn of(file: &File) -> Result<Loaded> {
        Ok(Loaded { memory: MemoryFile::new(&file.content.text())?, path: file.path.clone() })
    }
}

impl SumoScenario {
    /// Puts the scenario where SUMO of this process can load it.
    pub fn for_sumo(&self) -> Result<Loadable> {
        let all = |files: &[File]| files.iter().map(Loaded::of).collect::<Result<Vec<_>>>();
        Ok(Loadable {
            net: Loaded::of(&self.net)?,
            additional: all(&self.additional)?,
            routes: all(&self.routes)?,
            window_s: self.window_s,
            options: self.options.clone(),
        })
    }
}

impl Loadable {
    /// Returns the options with which SUMO loads the scenario. `more`: further additional files, which come last.
    pub fn options(&self, seed: u32, more: &[MemoryFile]) -> Vec<String> {
        let list = |files: Vec<String>| files.join(",");
        let paths = |files: &[Loaded]| files.iter().map(|file| file.memory.path()).collect::<Vec<_>>();
        let additional = [paths(&self.additional), more.iter().map(|file| file.path()).collect()].concat();
        let (begin, end) = self.window_s;
        let mut options = vec![
            ("net-file", self.net.memory.path()),
            ("route-files", list(paths(&self.routes))),
            ("additional-files", list(additional)),
            ("begin", begin.to_string()),
            ("end", end.to_string()),
            ("step-length", "1".to_owned()),
            ("seed", seed.to_string()),
        ];
        options.retain(|(_, value)| !value.is_empty());
        options.extend(self.options.iter().map(|(name, value)| (&**name, value.clone())));
        options.into_iter().flat_map(|(name, value)| [format!("--{name}"), value]).collect()
    }

    /// Returns an error of SUMO with the paths that the user knows.
    pub fn explain(&self, error: &libsumo::Error) -> Error {
        let files = [&self.net].into_iter().chain(&self.additional).chain(&self.routes);
        anyhow!(files.fold(error.to_string(), |told, Loaded { memory, path }| {
            renamed(&told, &memory.path(), &path.display().to_string())
        }))
    }
}
