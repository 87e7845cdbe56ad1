//! Networks of this program recognised by their names, and compared with what it writes.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

use super::grid::{self, Grid};
use super::{INFLOW, compare, expected};
use crate::traffic::network::files::NetworkFiles;
use crate::traffic::network::tree::{Element, read};
use crate::traffic::network::way_out::{cannot_be_simulated, command_for, no_such_network};

/// Returns the shape of one of our grids, from the names in its `net.xml`. [`read_grid`] compares the rest.
pub fn read_shape(net: &Path) -> Result<Grid> {
    shape_of(net, &read_net(net)?)
}

/// Returns the grid that a network is made for. First compares its net, its routes and its actuated lights with what
/// this program writes for a grid of that size. An error names the file, the element, both values and the way out.
pub fn read_grid(files: &NetworkFiles) -> Result<Grid> {
    let net = read_net(&files.net)?;
    let grid = shape_of(&files.net, &net)?;
    let way_out = || way_out(&files.net, grid);
    check_content(&files.net, &net, &expected::net(grid), way_out)?;
    let (routes, actuated) = (read_beside(files, &files.routes)?, read_beside(files, &files.actuated)?);
    check_content(&files.routes, &routes, &expected::routes(grid, Some(INFLOW)), way_out)?;
    check_content(&files.actuated, &actuated, &expected::actuated(grid), way_out)?;
    Ok(grid)
}

/// Reads the net and the routes of the local network. If they are of another network: an error with the way out.
pub(in crate::traffic) fn read_local(files: &NetworkFiles) -> Result<[Element; 2]> {
    let net = read_net(&files.net)?;
    let shape = shape_of(&files.net, &net)?;
    ensure!(
        shape == Grid::SINGLE,
        "{}: is a grid of {shape}, and a forest is made of the local net; {}",
        files.net.display(),
        make_local()
    );
    check_content(&files.net, &net, &expected::net(shape), make_local)?;
    let routes = read_beside(files, &files.routes)?;
    check_content(&files.routes, &routes, &expected::routes(shape, None), make_local)?;
    Ok([net, routes])
}

/// Returns the advice if a local net is needed.
fn make_local() -> String {
    "make one with: dials-traffic nets local --out DIR".to_owned()
}

fn check_content(path: &Path, found: &Element, expected: &Element, way_out: impl Fn() -> String) -> Result<()> {
    match compare::difference(found, expected) {
        Some(difference) => bail!("{}: {difference}; {}", path.display(), way_out()),
        None => Ok(()),
    }
}

fn read_net(net: &Path) -> Result<Element> {
    ensure!(net.exists(), no_such_network(net));
    let root = read(net)?;
    ensure!(root.name == "net", "{}: is not a SUMO network: its root is <{}>, not <net>", net.display(), root.name);
    Ok(root)
}

/// Reads another file of a network.
fn read_beside(files: &NetworkFiles, path: &Path) -> Result<Element> {
    read(path).with_context(|| cannot_be_simulated(&files.net))
}

/// Returns the command that remakes a network of this shape in its place, or in another directory if it has another
/// name.
fn way_out(net: &Path, grid: Grid) -> String {
    if net.file_name().is_some_and(|name| name == format!("grid_{grid}.net.xml").as_str()) {
        return format!("remake it with: {}", command_for(net));
    }
    format!("make one with: dials-traffic nets grid --rows {} --cols {} --out DIR", grid.rows(), grid.cols())
}

/// Returns the grid whose intersections and edges have the names in a net.
fn shape_of(net: &Path, root: &Element) -> Result<Grid> {
    let junctions = names(root, "junction");
    let grid = shape(&junctions).with_context(|| format!("{}: is too large", net.display()))?;
    let expected = grid.nodes().iter().map(ToString::to_string).collect();
    let difference = first_difference("junction", &junctions, &expected).or_else(|| {
        let expected = grid.edges().into_iter().map(|(from, to)| grid::edge(from, to)).collect();
        first_difference("edge", &names(root, "edge"), &expected)
    });
    match difference {
        Some(difference) => {
            let way_out = "make one with: dials-traffic nets grid --rows R --cols C --out DIR";
            bail!("{}: is not one of our grids: {difference}; {way_out}", net.display())
        }
        None => Ok(grid),
    }
}

/// Returns the ids of one kind of element, without those inside of intersections.
fn names(root: &Element, kind: &str) -> BTreeSet<String> {
    let ids = root.all(kind).filter_map(|element| element.attribute("id"));
    ids.filter(|id| !id.starts_with(':')).map(str::to_owned).collect()
}

/// Returns the smallest grid that has all the intersections named.
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
