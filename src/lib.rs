//! The command line of dials-traffic.
//!
//! - [`cli`]: flags and subcommands. `run`: one short file per subcommand.
//! - `film`: a replay as GIF or mp4. `libtorch`: the program beside this one that is linked with libtorch. `features`, `program`: what this build is.

pub mod cli;
mod features;
mod film;
mod libtorch;
mod program;
mod run;

use dials_session::error::Error;
use dials_session::machine::survive_full_files;
use dials_session::terminal::warn;

use crate::cli::Cli;

/// Parses the command line, runs the command and prints its error. Returns the exit code.
pub fn main() -> u8 {
    let cli = Cli::of_this_process();
    match survive_full_files().map_err(Error::Run).and_then(|()| run::run(cli)) {
        Ok(()) => 0,
        Err(error) => {
            warn(&error);
            error.exit_code()
        }
    }
}
