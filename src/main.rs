//! The program: parse the command line, run, print the error, exit.

use dials_traffic::cli::Cli;
use dials_traffic::machine::{Allocator, end_now, survive_full_files};
use dials_traffic::run;
use dials_traffic::terminal::warn;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

fn main() {
    let cli = Cli::of_this_process();
    let outcome = survive_full_files().map_err(dials_traffic::error::Error::Run).and_then(|()| run::run(cli));
    end_now(match outcome {
        Ok(()) => 0,
        Err(error) => {
            warn(&error);
            error.exit_code()
        }
    })
}
