//! The program: parse the command line, run, print the error, exit.

use std::process::ExitCode;

use clap::Parser;
use dials_traffic::cli::Cli;
use dials_traffic::run;
use dials_traffic::terminal::tell;

fn main() -> ExitCode {
    match run::run(Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tell(&error);
            error.exit_code()
        }
    }
}
