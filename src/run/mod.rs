//! One file per subcommand: config -> domain -> fleet -> training -> run directory.
//!
//! - `train` and `worker`; `evaluate` (with `baseline`), `export`, `bench`, `experiment`, `report`, `compare`, `replay`, `nets`, `info`.
//! - `domain`: which domain a config names. `directory`: run directories, and making any directory whole or not at all. `build`:
//!   what a run is computed with.
//! - `subject`, `cast`: what is evaluated, and who plays the episode that is replayed.
//! - What belongs to one flag: `render`, `plot`, `video`, `tune`, and `csv_files` for `--csv`.
//! - `places`: directories of files, made whole or not at all.
//! - `blas`: one thread for libtorch, which `bench` times.

mod bench;
#[cfg(feature = "torch")]
mod blas;
mod build;
mod cast;
mod compare;
mod csv_files;
mod directory;
mod domain;
mod evaluate;
mod experiment;
mod export;
mod info;
mod nets;
mod places;
mod plot;
mod render;
mod replay;
mod report;
mod subject;
mod train;
mod tune;
mod video;
mod worker;

use anyhow::{Context, ensure};
use rustix::process::{Signal, getppid, set_parent_process_death_signal};

use crate::cli::{Cli, Command};
use crate::error::{Error, Result};

/// Does what was asked.
pub fn run(cli: Cli) -> Result<()> {
    if let Some(parent) = cli.end_with {
        end_with(parent).map_err(Error::Run)?;
    }
    match cli.command {
        Command::Train(args) => train::train(&args),
        Command::Evaluate(args) => evaluate::evaluate(&args),
        Command::Export(args) => export::export(&args),
        Command::Baseline(args) => evaluate::baseline(&args),
        Command::Bench(args) => bench::bench(&args),
        Command::Experiment(args) => experiment::experiment(&args),
        Command::Report(args) => report::report(&args),
        Command::Compare(args) => compare::compare(&args),
        Command::Replay(args) => replay::replay(&args),
        Command::Nets(args) => nets::nets(&args),
        Command::Info => info::info(),
        Command::Worker => worker::worker(),
    }
}

/// The flag that names the process whose end is the end of this one.
const END_WITH: &str = "--end-with";

/// Ties the life of this process to that of the one that started it, however that ends.
fn end_with(parent: u32) -> anyhow::Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL)).context("cannot be tied to the life of its parent")?;
    // It may have ended before.
    let lives = getppid().is_some_and(|pid| pid.as_raw_nonzero().get() as u32 == parent);
    ensure!(lives, "the process that started this one has ended");
    Ok(())
}
