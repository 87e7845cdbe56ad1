//! One short function per subcommand: config -> domain -> fleet -> training -> run directory.

mod bench;
mod build;
mod compare;
mod directory;
mod domain;
mod evaluate;
mod experiment;
mod export;
mod findings;
mod info;
mod nets;
mod places;
mod plot;
mod progress;
mod render;
mod replay;
mod report;
mod stop;
mod subject;
pub mod terminal;
mod train;
mod tune;
mod video;
mod worker;

use std::os::unix::process::CommandExt;

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

/// Makes sure that libtorch's BLAS runs in one thread. The libraries read these variables when they are loaded, which is
/// before `main`; so where they are not set, the process starts itself again with them.
///
/// For those who time it. Nothing else of this program computes with BLAS.
fn keep_blas_to_one_thread() {
    const THREADS: [&str; 2] = ["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"];
    if THREADS.iter().any(|name| std::env::var_os(name).is_none_or(|value| value != "1")) {
        let mut again = std::process::Command::new("/proc/self/exe");
        let mut typed = std::env::args_os();
        // The name under which it was called stays, for help and for `run.json`.
        if let Some(name) = typed.next() {
            again.arg0(name);
        }
        again.args(typed).envs(THREADS.map(|name| (name, "1")));
        let error = again.exec();
        terminal::tell(format_args!(
            "warning: could not restart with one BLAS thread ({error}); libtorch's peak may be that of several cores"
        ));
    }
    tch::set_num_threads(1);
}
