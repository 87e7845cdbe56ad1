//! A grid written as the files of a network. SUMO's `netconvert` makes roads and lights from our plain XML.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use super::content;
use super::grid::Grid;
use super::inflow::Inflow;
use crate::network::files::{NetworkFiles, config};
use crate::sumo_program;
use dials_core::outside::{cannot_write_temporary, temporary_dir, write_together};

/// Writes the network `grid_{rows}x{cols}` into `dir`. `inflow` is 0.1 in the authors' setup.
pub fn write_grid(grid: Grid, inflow: impl Into<Inflow>, dir: &Path) -> Result<NetworkFiles> {
    let inflow = inflow.into();
    inflow.check(grid)?;
    write_network(&format!("grid_{grid}"), grid, Some(&inflow), dir)
}

pub fn write_local(dir: &Path) -> Result<NetworkFiles> {
    write_network("local", Grid::SINGLE, None, dir)
}

/// Writes a network. Everything is made in a temporary directory first, so an error leaves `dir` unchanged.
fn write_network(name: &str, grid: Grid, inflow: Option<&Inflow>, dir: &Path) -> Result<NetworkFiles> {
    let files = NetworkFiles::of(&dir.join(name));
    files.check_paths()?;
    let net = convert(grid).with_context(|| format!("{}: could not be made", files.net.display()))?;
    let contents = [
        (files.net.clone(), net.into_bytes()),
        (files.routes.clone(), content::routes(grid, inflow).into_bytes()),
        (files.actuated.clone(), content::actuated(grid).into_bytes()),
        (files.config.clone(), config(name).into_bytes()),
    ];
    write_together(dir, &contents)?;
    Ok(files)
}

fn convert(grid: Grid) -> Result<String> {
    let room = temporary_dir()?;
    let inputs = [
        ("--node-files", "nod.xml", content::nodes(grid)),
        ("--edge-files", "edg.xml", content::edges(grid)),
        ("--connection-files", "con.xml", content::connections(grid)),
        ("--tllogic-files", "tll.xml", content::lights(grid)),
    ];
    let program = sumo_program("netconvert")
        .context("netconvert was not found: install SUMO (pip install eclipse-sumo, or on Debian apt install sumo)")?;
    let mut command = Command::new(program);
    command.current_dir(room.path()).stdin(Stdio::null());
    for (option, file, text) in inputs {
        fs::write(room.path().join(file), text).map_err(|error| cannot_write_temporary(&error))?;
        command.args([option, file]);
    }
    // Normalisation would move the south-west corner of the bounding box, which is that of a dead end, to (0, 0).
    command.args(["--offset.disable-normalization", "--no-turnarounds", "--xml-validation", "never"]);
    command.args(["--output-file", "net.xml"]);
    let output = command.output().context("netconvert could not be started")?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "netconvert failed ({}): {}", output.status, said.trim());
    let net = fs::read_to_string(room.path().join("net.xml")).context("netconvert wrote no net")?;
    Ok(without_comment(&net))
}

/// Returns the net without netconvert's comment at the beginning, which has the date.
fn without_comment(net: &str) -> String {
    let comment = net.find("<!--").filter(|&begin| net.find("<net").is_none_or(|root| begin < root));
    let end = comment.and_then(|begin| net[begin..].find("-->").map(|length| begin + length + "-->".len()));
    match (comment, end) {
        (Some(begin), Some(end)) => [&net[..begin], net[end..].trim_start()].concat(),
        _ => net.to_owned(),
    }
}
