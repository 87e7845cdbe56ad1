//! One file per subcommand: config -> domain -> fleet -> training -> run directory.
//!
//! - `train`: trains policies and writes a run directory. `team`: where its workers are. `run_name`: its default name.
//! - `evaluate`: plays and measures saved policies; also `baseline`, which does so with hand-coded controllers.
//!   `subject`: what both play. `lights`: their figures of each light. `robustness`: the same on variants of the traffic.
//!   `events`: the event log of their episodes.
//! - `plan`: a plan of all lights that plain SUMO loads. `plan_files`: what it writes.
//! - `replay`: an episode for sumo-gui, and films of it. `plot`: pictures of an episode.
//! - `experiment`: makes all runs of a file. `benchmark`: makes those of a benchmark that others report.
//!   `report`, `compare`: summarise runs; `watch`: shows them live.
//! - `bench`: measures training speed. `check`: local simulators beside the global one. `export`: policies as TorchScript.
//! - `describe`: the agents of a config, what a run of it will do, and what that costs.
//! - `nets`: SUMO networks, made and inspected (`inspect`). `demand`: routes that fit traffic counts. `listing`: lists of names as text.
//! - `info`: versions. `doctor`: what is missing; `sumo_data`: of SUMO's data. `complete`: completions, manual pages, and the schema
//!   of a config.

mod bench;
mod benchmark;
mod check;
mod compare;
mod complete;
mod demand;
mod describe;
mod doctor;
mod evaluate;
mod events;
mod experiment;
mod export;
mod info;
mod inspect;
mod lights;
mod listing;
mod nets;
mod plan;
mod plan_files;
mod plot;
pub(crate) mod replay;
mod report;
mod robustness;
mod run_name;
mod subject;
mod sumo_data;
mod team;
mod train;
mod watch;

use crate::cli::{BenchmarkCommand, Cli, Command};
use dials_session::domains;
use dials_session::error::{Error, Result};
use dials_session::fleet::apart::serve_a_worker;
use dials_session::fleet::children::serve_the_parent;
use dials_session::machine::note_option_for_processes;
use dials_session::parent::end_with;
use dials_session::terminal::{Talk, talk};

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
        Command::Experiment(_) | Command::Benchmark(_) => note_option_for_processes("--cores"),
        _ => (),
    }
    match cli.command {
        Command::Train(args) => train::train(&args),
        Command::Evaluate(args) => evaluate::evaluate(&args),
        Command::Export(args) => export::export(&args),
        Command::Baseline(args) => evaluate::baseline(&args),
        Command::Plan(args) => plan::plan(&args),
        Command::Check(args) => check::check(&args),
        Command::Bench(args) => bench::bench(&args),
        Command::Experiment(args) => team::check_alone("experiment").and_then(|()| experiment::experiment(&args)),
        Command::Benchmark(BenchmarkCommand::Resco(args)) => {
            team::check_alone("benchmark").and_then(|()| benchmark::resco(&args))
        }
        Command::Report(args) => report::report(&args),
        Command::Watch(args) => watch::watch(&args),
        Command::Compare(args) => compare::compare(&args),
        Command::Replay(args) => replay::replay(&args),
        Command::Describe(args) => describe::describe(&args),
        Command::Nets(args) => nets::nets(&args),
        Command::Demand(args) => demand::demand(&args),
        Command::Info => info::info(),
        Command::Doctor => doctor::doctor(),
        Command::Completions { shell } => complete::completions(shell),
        Command::Man { out, force } => complete::man(&out, force),
        Command::Schema => complete::print_schema(),
        Command::Worker => serve_the_parent(domains::open_untried).map_err(Error::Run),
        Command::Simulator => serve_a_worker(domains::open_untried).map_err(Error::Run),
        Command::MapPlayer { run } => watch::play_for_the_map(&run),
        Command::TryOut => dials_session::trial::try_out(),
    }
}
