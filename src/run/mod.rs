//! One short function per subcommand: config -> domain -> fleet -> training -> run directory.

mod directory;
mod domain;
mod evaluate;
mod export;
mod info;
mod nets;
mod progress;
mod render;
pub mod terminal;
mod train;
mod worker;

use std::os::unix::process::CommandExt;

use crate::cli::{Cli, Command};
use crate::error::Result;

/// Does what was asked.
pub fn run(cli: Cli) -> Result<()> {
    match cli.command {
        Command::Train(args) => train::train(&args),
        Command::Evaluate(args) => evaluate::evaluate(&args),
        Command::Export(args) => export::export(&args),
        Command::Baseline(args) => evaluate::baseline(&args),
        Command::Nets(args) => nets::nets(&args),
        Command::Info => info::info(),
        Command::Worker => worker::worker(),
    }
}

/// The threads of BLAS and OpenMP, which would fight over the cores with our processes and make sums depend on the
/// machine.
const THREADS: [&str; 2] = ["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"];

/// Makes sure that BLAS runs in one thread. The libraries read these variables when they are loaded, which is before
/// `main`; so where they are not set, the process starts itself again with them.
pub fn keep_to_one_thread() {
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
            "warning: could not restart with one BLAS thread ({error}); results may differ from other machines"
        ));
    }
    tch::set_num_threads(1);
}
