//! One file per subcommand: config -> domain -> fleet -> training -> run directory.
//!
//! - `train`: trains policies and writes a run directory. `other_end`: of a run that is resumed. `team`: where its workers
//!   are. `worker`: its worker processes.
//! - `evaluate`: plays and measures saved policies; also `baseline`, which does so with hand-coded controllers.
//! - `experiment`: makes all runs of a file. `report`, `compare`: summarise runs; `watch`: shows them live. `bench`: measures training speed.
//! - `export`: policies as TorchScript; `python`: paths in lines of Python. `replay`: an episode for sumo-gui.
//! - `describe`: the agents of a config, what a run of it will do, and what that costs.
//! - `nets`: SUMO networks, made and inspected (`inspect`). `check`: local simulators beside the global one.
//!   `info`: versions. `doctor`: what is missing.
//! - `complete`: completions, manual pages, and the schema of a config. `listing`: lists of names as text.
//! - `trial`: files that might crash a simulator, tried in a child process; also the hidden command of that child.
//! - `domain`: finds the domain that a config names. Only this file knows all domains.
//! - `directory`: makes and opens run directories. `run_name`: their default names. `places`: makes any directory whole
//!   or not at all. `outputs`: checks output paths.
//! - `build`: the program, libraries and machine that compute a run.
//! - `subject`: what `evaluate` and `baseline` play. `cast`: the players of the episode that `replay` records.
//! - One flag each: `csv_files` (`--csv`), `plot` and `render` (pictures), `tune` (lights that go by the clock), `video` (films).

mod bench;

mod cast;
mod check;
mod compare;
mod complete;
mod csv_files;
mod describe;

mod doctor;

mod evaluate;
mod experiment;
mod export;
mod info;
mod inspect;
mod listing;
mod nets;
mod other_end;

mod plot;
mod python;
mod render;
pub(crate) mod replay;
mod report;
mod run_name;
mod subject;
mod team;
mod train;

mod tune;
mod video;
mod watch;
mod worker;

use crate::cli::{Cli, Command};
use dials_session::error::{Error, Result};
use dials_session::machine::note_option_for_processes;
use dials_session::parent::end_with;
use dials_session::terminal::{Talk, talk};

/// Runs one command.
pub(crate) fn run(cli: Cli) -> Result<()> {
    if let Some(parent) = cli.end_with {
        end_with(parent).map_err(Error::Run)?;
    }
    talk(match (cli.quiet, cli.verbose) {
        (true, _) => Talk::Quiet,
        (_, true) => Talk::Verbose,
        _ => Talk::Normal,
    });
    match &cli.command {
        Command::Train(_) | Command::Bench(_) | Command::Worker => note_option_for_processes("--workers"),
        Command::Experiment(_) => note_option_for_processes("--cores"),
        _ => (),
    }
    match cli.command {
        Command::Train(args) => train::train(&args),
        Command::Evaluate(args) => evaluate::evaluate(&args),
        Command::Export(args) => export::export(&args),
        Command::Baseline(args) => evaluate::baseline(&args),
        Command::Check(args) => check::check(&args),
        Command::Bench(args) => bench::bench(&args),
        Command::Experiment(args) => team::check_alone("experiment").and_then(|()| experiment::experiment(&args)),
        Command::Report(args) => report::report(&args),
        Command::Watch(args) => watch::watch(&args),
        Command::Compare(args) => compare::compare(&args),
        Command::Replay(args) => replay::replay(&args),
        Command::Describe(args) => describe::describe(&args),
        Command::Nets(args) => nets::nets(&args),
        Command::Info => info::info(),
        Command::Doctor => doctor::doctor(),
        Command::Completions { shell } => complete::completions(shell),
        Command::Man { out, force } => complete::man(&out, force),
        Command::Schema => complete::print_schema(),
        Command::Worker => worker::worker(),
        Command::TryOut => dials_session::trial::try_out(),
    }
}
