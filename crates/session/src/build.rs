//! The build that computes a run: this program, its libraries and the machine.
//!
//! It is written to `run.json` and compared when the run is resumed, because the same seed gives the same files only
//! with the same build.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};

use super::domains::{self, NO_SUCH_VECTORS};
use crate::config::RunConfig;
use crate::records::run_json::{NO_SUMO, Resumed, RunJson, Versions};
use dials_core::outside::Directory;
use stacknets::{VectorWidth, vector_instructions};

/// The program that stands on this crate, as its own build knows it.
#[derive(Clone, Copy, Debug)]
pub struct Program {
    pub version: &'static str,
    /// Commit that it was built from, with `-dirty` after changes.
    pub git_commit: &'static str,
    /// Version of libtorch, or `none`.
    pub libtorch: &'static str,
}

/// Returns the build of this process for a run with this config. Only a config of traffic needs SUMO.
pub fn here(program: Program, config: &RunConfig) -> Result<Versions> {
    let versions = without_sumo(program, config.numerics.vector_width)?;
    Ok(match domains::sumo(config)? {
        Some(sumo) => Versions { sumo: sumo.name.clone(), sumo_builder: sumo.builder(), ..versions },
        None => versions,
    })
}

/// Returns the build of this process but for SUMO. `width`: width of the vector registers that its networks use.
pub fn without_sumo(program: Program, width: VectorWidth) -> Result<Versions> {
    Ok(Versions {
        dials_traffic: program.version.to_owned(),
        git_commit: program.git_commit.to_owned(),
        sumo: NO_SUMO.to_owned(),
        sumo_builder: NO_SUMO.to_owned(),
        libtorch: program.libtorch.to_owned(),
        libm: dials_traffic::libm(),
        vector_instructions: vector_instructions(width).context(NO_SUCH_VECTORS)?,
        cpu: cpu(),
    })
}

/// Returns this build if another one wrote the run in `dir` last. Unless `accepted`, that is an error that says why.
pub fn other_build(program: Program, dir: &Path, config: &RunConfig, accepted: bool) -> Result<Option<Versions>> {
    let here = here(program, config)?;
    let run = RunJson::read(dir)?;
    let differences = here.differences(run.resumed_with.last().map_or(&run.versions, |last| &last.versions));
    if differences.is_empty() {
        return Ok(None);
    }
    if !accepted {
        bail!(
            "{}: was written by another build or on another machine, so its numbers may change from here on:\n  {}\n  \
             to resume anyway, add --accept-other-build",
            dir.display(),
            differences.join("\n  ")
        );
    }
    Ok(Some(here))
}

/// Records in `run.json` that this build resumes a run, which this process has locked, at this timestep per agent.
pub fn record_resume(directory: &Directory, build: &Versions, steps: u64) -> Result<()> {
    let mut run = RunJson::read(directory.path())?;
    run.resumed_with.push(Resumed { steps, versions: build.clone() });
    run.write(directory)
}

pub fn cpu() -> String {
    let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name =
        text.lines().find_map(|line| Some(line.strip_prefix("model name")?.split_once(':')?.1.trim().to_owned()));
    name.unwrap_or("unknown".to_owned())
}
