//! `nets`: writes SUMO networks.

use super::outputs::check_not_of_a_run;
use crate::cli;
use crate::error::{Error, Result};
use crate::outside::quoted;
use crate::terminal::answer;
use crate::traffic::paper_grid::grid::Grid;
use crate::traffic::paper_grid::make::{write_grid, write_local};

pub fn nets(args: &cli::NetsCommand) -> Result<()> {
    let (cli::NetsCommand::Grid { out, .. } | cli::NetsCommand::Local { out }) = args;
    check_not_of_a_run("--out", out).map_err(Error::Usage)?;
    let written = match args {
        cli::NetsCommand::Grid { rows, cols, inflow, out } => {
            Grid::new(*rows, *cols).and_then(|grid| write_grid(grid, *inflow, out))
        }
        cli::NetsCommand::Local { out } => write_local(out),
    };
    let files = written.map_err(Error::Usage)?;
    let (net, config) = (files.net.display(), quoted(&files.config));
    answer(format_args!("wrote {net}\nwatch it with: sumo-gui -c {config}")).map_err(Error::Run)
}
