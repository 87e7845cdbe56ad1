//! `nets`

use crate::cli;
use crate::error::{Error, Result};
use crate::traffic::grid::Grid;
use crate::traffic::net_file::{write_grid, write_local};

pub fn nets(args: &cli::Nets) -> Result<()> {
    let written = match args {
        cli::Nets::Grid { rows, cols, inflow, out } => {
            Grid::new(*rows, *cols).and_then(|grid| write_grid(grid, *inflow, out))
        }
        cli::Nets::Local { out } => write_local(out),
    };
    let files = written.map_err(Error::Usage)?;
    println!("wrote {}", files.net.display());
    println!("watch it with: sumo-gui -c {}", files.config.display());
    Ok(())
}
