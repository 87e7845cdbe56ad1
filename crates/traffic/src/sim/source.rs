//! What a GS (global simulator) loads into SUMO.

use anyhow::{Error, anyhow};

use super::options;
use crate::controllers::actuated;
use crate::network::contents::{self, renamed};
use crate::network::memory_file::MemoryFile;
use crate::scenario::loadable;

/// The files of a whole network, in memory.
pub enum Source {
    /// A grid of ours.
    Grid(contents::Loadable),
    /// A scenario, and actuated programs for its agents, all of the same name.
    Scenario { files: loadable::Loadable, actuated: MemoryFile, program: String },
}

impl Source {
    /// Returns the options that make SUMO load it. `actuated`: also the actuated programs.
    pub fn options(&self, actuated: bool, seed: u32) -> Vec<String> {
        match self {
            Source::Grid(files) => {
                let mut options = options::common(&files.net, &files.routes, seed);
                if actuated {
                    options.extend(["--additional-files".to_owned(), files.actuated.path()]);
                }
                options
            }
            Source::Scenario { files, actuated: programs, .. } => {
                files.options(seed, if actuated { std::slice::from_ref(programs) } else { &[] })
            }
        }
    }

    /// Returns an error of SUMO with the paths that the user knows.
    pub fn explain(&self, error: &libsumo::Error) -> Error {
        match self {
            Source::Grid(files) => files.explain(error),
            Source::Scenario { files, actuated, .. } => {
                anyhow!(renamed(&files.explain(error).to_string(), &actuated.path(), "ACTUATED-PROGRAMS"))
            }
        }
    }

    /// Returns the name of the actuated programs.
    pub fn actuated_program(&self) -> &str {
        match self {
            Source::Grid(_) => actuated::PROGRAM,
            Source::Scenario { program, .. } => program,
        }
    }
}
