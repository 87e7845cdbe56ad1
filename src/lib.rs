//! The command line of dials-traffic.
//!
//! - [`cli`]: flags and subcommands. `run`: one short file per subcommand.
//! - `film`: a replay as GIF or mp4. `libtorch`: the program beside this one that is linked with libtorch. `program`: what
//!   this build is.

pub mod cli;
mod film;
mod libtorch;
mod program;
mod run;

use clap::{Command, CommandFactory, FromArgMatches};

use dials_session::error::Error;
use dials_session::machine::survive_full_files;
use dials_session::terminal::warn;

use crate::cli::Cli;

/// Parses the command line, runs the command and prints its error. Returns the exit code.
pub fn main() -> u8 {
    let matches = with_negative_numbers(Cli::command()).get_matches();
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    match survive_full_files().map_err(Error::Run).and_then(|()| run::run(cli)) {
        Ok(()) => 0,
        Err(error) => {
            warn(&error);
            error.exit_code()
        }
    }
}

/// Lets all values be negative numbers: clap would take one for an option, and their own checks refuse it.
fn with_negative_numbers(command: Command) -> Command {
    let command = command.mut_args(|arg| {
        let takes_values = arg.get_action().takes_values();
        arg.allow_negative_numbers(takes_values)
    });
    command.mut_subcommands(with_negative_numbers)
}
