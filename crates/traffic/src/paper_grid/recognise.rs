//! Networks of this program recognised by their names, and compared with what it writes.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

use super::grid::{self, Grid};
use super::inflow::Inflow;
use super::{INFLOW, compare, content, expected};
use crate::network::contents::Network;
use crate::network::files::NetworkFiles;
use crate::network::tree::Element;
use crate::network::way_out::{Role, command_for, make_local};
use dials_core::outside::beginning;

const MOST_LETTERS: usize = 600;

pub struct Recognised {
    pub grid: Grid,
    pub(crate) network: Network,
}

/// Reads a network once and compares it with what this program writes for a grid of its size. An error names the file,
/// the element, both values and the way out.
pub fn recognise_grid(files: &NetworkFiles) -> Result<Recognised> {
    let network = Network::read(files, Role::Global)?;
    let grid = shape_of(&files.net, &network.net.root)?;
    compare_all(&network, grid, Some(INFLOW), || way_out(&files.net, grid))?;
    Ok(Recognised { grid, network })
}

/// Reads the local network once. If it is another network: an error with the way out.
pub(crate) fn recognise_local(files: &NetworkFiles) -> Result<Recognised> {
    let network = Network::read(files, Role::Local)?;
    let grid = shape_of(&files.net, &network.net.root)?;
    ensure!(
        grid == Grid::SINGLE,
        "{}: is a grid of {grid}, and a forest is made of the local net; {}",
        files.net.display(),
        make_local()
    );
    compare_all(&network, grid, None, make_local)?;
    Ok(Recognised { grid, network })
}

fn compare_all(network: &Network, grid: Grid, inflow: Option<f64>, way_out: impl Fn() -> String) -> Result<()> {
    let Network { files, net, routes, actuated } = network;
    let inflow = inflow.map(Inflow::from);
    let pairs = [
        (&files.net, &net.root, expected::net(grid)),
        (&files.routes, &routes.root, expected::read(&content::routes(grid, inflow.as_ref()))),
        (&files.actuated, &actuated.root, expected::read(&content::actuated(grid))),
    ];
    for (path, found, expected) in pairs {
        if let Some(difference) = compare::difference(found, &expected, &found.name) {
            bail!("{}: {}; {}", path.display(), beginning(&difference, MOST_LETTERS), way_out());
        }
    }
    Ok(())
}

/// Returns the command that remakes a network in its place, or elsewhere if it has another name.
fn way_out(net: &Path, grid: Grid) -> String {
    if net.file_name().is_some_and(|name| name == format!("grid_{grid}.net.xml").as_str()) {
        return format!("remake it with: {} --force", command_for(net));
    }
    format!("make one with: dials-traffic nets grid --rows {} --cols {} --out DIR", grid.rows(), grid.cols())
}

/// Returns the grid whose intersections and edges have the names in a net.
fn shape_of(net: &Path, root: &Element) -> Result<Grid> {
    let junctions = names(root, "junction");
    let grid = shape(&junctions).with_context(|| format!("{}: is too large", net.display()))?;
    let expected = grid.nodes().iter().map(ToString::to_string).collect();
    let edges = grid.edges().into_iter().map(|(from, to)| grid::edge(from, to)).collect();
    let difference = first_difference("junction", &junctions, &expected)
        .or_else(|| first_difference("edge", &names(root, "edge"), &edges));
    if let Some(difference) = difference {
        let way_out = "make one with: dials-traffic nets grid --rows R --cols C --out DIR";
        bail!("{}: is not one of our grids: {}; {way_out}", net.display(), beginning(&difference, MOST_LETTERS));
    }
    Ok(grid)
}

/// Returns the ids of one kind of element, without those inside of intersections.
fn names(root: &Element, kind: &str) -> BTreeSet<String> {
    let ids = root.all(kind).filter_map(|element| element.attribute("id"));
    ids.filter(|id| !id.starts_with(':')).map(str::to_owned).collect()
}

fn shape(junctions: &BTreeSet<String>) -> Result<Grid> {
    let places = junctions.iter().filter_map(|name| {
        let (row, col) = name.strip_prefix('r')?.split_once('c')?;
        Some((row.parse::<usize>().ok()?, col.parse::<usize>().ok()?))
    });
    // A grid has fewer rows and columns than its net has junctions. A larger number is the name of something else.
    let places = places.filter(|&(row, col)| row.max(col) < junctions.len());
    let (rows, cols) = places.fold((1, 1), |(rows, cols), (row, col)| (rows.max(row + 1), cols.max(col + 1)));
    Grid::new(rows, cols)
}

fn first_difference(kind: &str, found: &BTreeSet<String>, expected: &BTreeSet<String>) -> Option<String> {
    let unexpected = found.difference(expected).next().map(|name| format!("it has the {kind} '{name}'"));
    unexpected.or_else(|| expected.difference(found).next().map(|name| format!("it lacks the {kind} '{name}'")))
}
