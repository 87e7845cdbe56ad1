//! Network files: a grid written down so that SUMO and sumo-gui can open it, and recognised again.
//!
//! Recognised means: every number in it that observations, rewards, controllers and simulators assume is the one that this
//! program writes ([`read_grid`]); only how often cars arrive may differ.
//!
//! A *network* is four files with one name: `grid_2x2.net.xml` (roads and lights, made by Debian's `netconvert` from
//! our plain XML), `.rou.xml` (vehicle type, routes, flows), `.actuated.add.xml` (actuated lights, for whoever wants
//! to load them) and `.sumocfg` (what `sumo -c` takes). The *local* net is the 1x1 grid without flows, for its cars are
//! sampled.
//!
//! Making a network twice gives the same files byte for byte.

mod compare;
mod content;
mod expected;
pub mod grid;

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{self, Permissions};
use std::io::{ErrorKind, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use tempfile::NamedTempFile;

use grid::Grid;

pub(super) use super::network::tree::{Element, read};
pub(super) use content::{document, document_with, leaf, nest, section};

/// Probability of a car per step on each edge that leads in, in the authors' setup.
const INFLOW: f64 = 0.1;

/// Where the files of one network are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkFiles {
    /// The roads and the lights with their static program.
    pub net: PathBuf,
    /// The vehicle type and the routes, and the flows of a grid.
    pub routes: PathBuf,
    /// The actuated program of every light.
    pub actuated: PathBuf,
    /// Net and routes together, for `sumo -c` and `sumo-gui -c`.
    pub config: PathBuf,
}

impl NetworkFiles {
    /// The network that a config names: directory and name, such as `../sumo_nets/grid_2x2`. They need not exist.
    pub fn of(prefix: &Path) -> NetworkFiles {
        let file = |ending: &str| {
            let mut path = OsString::from(prefix);
            path.push(ending); // `with_extension` would take a dot in the name for an extension.
            PathBuf::from(path)
        };
        NetworkFiles {
            net: file(".net.xml"),
            routes: file(".rou.xml"),
            actuated: file(".actuated.add.xml"),
            config: file(".sumocfg"),
        }
    }

    /// CRC-32 of what decides about roads and cars: the net and its routes.
    pub fn checksum(&self) -> Result<u32> {
        let mut hasher = crc32fast::Hasher::new();
        for file in [&self.net, &self.routes] {
            hasher.update(&fs::read(file).with_context(|| format!("{}: cannot be read", file.display()))?);
        }
        Ok(hasher.finalize())
    }

    /// An error with the way out if one of the files is missing or SUMO could not take its path.
    pub fn check(&self) -> Result<()> {
        self.check_paths()?;
        match self.all().into_iter().find(|path| !path.is_file()) {
            Some(missing) => bail!(no_such_network(missing)),
            None => Ok(()),
        }
    }

    /// An error if SUMO could not take the path of one of the files, there or not.
    pub fn check_paths(&self) -> Result<()> {
        self.all().into_iter().try_for_each(|path| for_sumo(path).map(drop))
    }

    /// Copies the network into another directory under a name of its own, for a run directory that needs nothing outside
    /// of itself. What `sumo -c` takes is written anew, for it names the others.
    pub fn copy_to(&self, dir: &Path, name: &str) -> Result<NetworkFiles> {
        self.check()?;
        let copy = NetworkFiles::of(&dir.join(name));
        let text = |path: &Path| fs::read(path).with_context(|| format!("{}: could not be read", path.display()));
        let contents = [
            (copy.net.clone(), text(&self.net)?),
            (copy.routes.clone(), text(&self.routes)?),
            (copy.actuated.clone(), text(&self.actuated)?),
            (copy.config.clone(), config_of(name).into_bytes()),
        ];
        write_together(dir, &contents)?;
        Ok(copy)
    }

    fn all(&self) -> [&Path; 4] {
        [&self.net, &self.routes, &self.actuated, &self.config]
    }
}

/// Writes the network `grid_{rows}x{cols}` into `dir`; `inflow` is the probability of a car per step on each edge that
/// leads in (0.1 in the authors' setup).
pub fn write_grid(grid: Grid, inflow: f64, dir: &Path) -> Result<NetworkFiles> {
    ensure!((0.0..=1.0).contains(&inflow), "inflow = {inflow}: must be a probability, from 0 to 1");
    let flows = (inflow > 0.0).then_some(inflow); // SUMO refuses a flow of probability 0.
    write_network(&format!("grid_{grid}"), grid, flows, dir, "netconvert")
}

/// Writes the network `local` into `dir`: one intersection, no flows.
pub fn write_local(dir: &Path) -> Result<NetworkFiles> {
    write_network("local", Grid::SINGLE, None, dir, "netconvert")
}

/// Everything is made in a temporary directory first, so an error leaves `dir` as it was.
fn write_network(name: &str, grid: Grid, inflow: Option<f64>, dir: &Path, netconvert: &str) -> Result<NetworkFiles> {
    let files = NetworkFiles::of(&dir.join(name));
    files.check_paths()?;
    let net = convert(grid, netconvert).with_context(|| format!("{}: could not be made", files.net.display()))?;
    let contents = [
        (files.net.clone(), net.into_bytes()),
        (files.routes.clone(), content::routes(grid, inflow).into_bytes()),
        (files.actuated.clone(), content::actuated(grid).into_bytes()),
        (files.config.clone(), config_of(name).into_bytes()),
    ];
    write_together(dir, &contents)?;
    Ok(files)
}

/// What `sumo -c` takes for a network of this name.
fn config_of(name: &str) -> String {
    content::config(&format!("{name}.net.xml"), &format!("{name}.rou.xml"))
}

/// A path as SUMO takes it among its options: text, and one file only.
pub(super) fn for_sumo(path: &Path) -> Result<String> {
    let place = path.display();
    let text = path.to_str().with_context(|| format!("{place}: is not UTF-8, as SUMO's options are; rename it"))?;
    ensure!(!text.contains(','), "{place}: has a comma in it, where SUMO would split it in two; rename it");
    Ok(text.to_owned())
}

/// netconvert's net of a grid.
fn convert(grid: Grid, netconvert: &str) -> Result<String> {
    let room = tempfile::tempdir().context("could not make a temporary directory")?;
    let inputs = [
        ("--node-files", "nod.xml", content::nodes(grid)),
        ("--edge-files", "edg.xml", content::edges(grid)),
        ("--connection-files", "con.xml", content::connections(grid)),
        ("--tllogic-files", "tll.xml", content::lights(grid)),
    ];
    let mut command = Command::new(netconvert);
    command.current_dir(room.path()).stdin(Stdio::null());
    for (option, file, text) in inputs {
        fs::write(room.path().join(file), text).context("could not write to the temporary directory")?;
        command.args([option, file]);
    }
    // Normalisation would move the south-west corner of the bounding box, a dead end's, to (0, 0).
    command.args(["--offset.disable-normalization", "--no-turnarounds", "--xml-validation", "never"]);
    command.args(["--output-file", "net.xml"]);
    run(command)?;
    let net = fs::read_to_string(room.path().join("net.xml")).context("netconvert wrote no net")?;
    Ok(without_comment(&net))
}

fn run(mut command: Command) -> Result<()> {
    let output = match command.output() {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            bail!("netconvert is not on the PATH: install Debian's package sumo (./setup.sh)")
        }
        output => output.context("netconvert could not be started")?,
    };
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "netconvert failed ({}): {}", output.status, said.trim());
    Ok(())
}

/// The net without the comment that netconvert begins it with: date and temporary paths would make every net different.
fn without_comment(net: &str) -> String {
    let comment = net.find("<!--").filter(|&begin| net.find("<net").is_none_or(|root| begin < root));
    let end = comment.and_then(|begin| net[begin..].find("-->").map(|length| begin + length + "-->".len()));
    match (comment, end) {
        (Some(begin), Some(end)) => [&net[..begin], net[end..].trim_start()].concat(),
        _ => net.to_owned(),
    }
}

/// Writes files into one directory, all of them or none: each is written under another name first, then renamed.
pub(super) fn write_together(dir: &Path, files: &[(PathBuf, Vec<u8>)]) -> Result<()> {
    let unwritable =
        || format!("{}: could not be written to: make it writable or choose another directory", dir.display());
    fs::create_dir_all(dir).with_context(unwritable)?;
    let mut staged = Vec::new();
    for (path, content) in files {
        ensure!(!path.is_dir(), "{}: is a directory, where a file is to be written: move it away", path.display());
        // A temporary file is for its owner alone by default; these are for everyone whom the umask allows.
        let mut temporary = tempfile::Builder::new();
        let temporary = temporary.prefix(".writing-").permissions(Permissions::from_mode(0o666));
        let mut file = temporary.tempfile_in(dir).with_context(unwritable)?;
        file.write_all(content).with_context(unwritable)?;
        staged.push((file, path));
    }
    staged.into_iter().try_for_each(|(file, path)| rename(file, path))
}

fn rename(file: NamedTempFile, path: &Path) -> Result<()> {
    file.persist(path)
        .map_err(|error| error.error)
        .with_context(|| format!("{}: could not be replaced", path.display()))?;
    Ok(())
}

/// The shape of one of our grids, recovered from the names in its `net.xml`. What else is in it, [`read_grid`] compares.
pub fn read_shape(net: &Path) -> Result<Grid> {
    shape_of(net, &read_net(net)?)
}

/// The grid that a network is made for, after its net, its routes and its actuated lights were held against what this program
/// writes for a grid of that size. An error names the file, the element, both values and the way out.
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

/// The net and the routes of the local network; an error with the way out if they are any others.
pub(super) fn read_local(files: &NetworkFiles) -> Result<[Element; 2]> {
    let net = read_net(&files.net)?;
    let shape = shape_of(&files.net, &net)?;
    let make_one = || "make one with: dials-traffic nets local --out DIR".to_owned();
    ensure!(
        shape == Grid::SINGLE,
        "{}: is a grid of {shape}, and a forest is made of the local net; {}",
        files.net.display(),
        make_one()
    );
    check_content(&files.net, &net, &expected::net(shape), make_one)?;
    let routes = read_beside(files, &files.routes)?;
    check_content(&files.routes, &routes, &expected::routes(shape, None), make_one)?;
    Ok([net, routes])
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

/// Another file of a network.
fn read_beside(files: &NetworkFiles, path: &Path) -> Result<Element> {
    read(path).with_context(|| cannot_be_simulated(files))
}

/// What to say of a network in which something is wrong, with the command that remakes it.
pub(super) fn cannot_be_simulated(files: &NetworkFiles) -> String {
    let command = command_for(&files.net);
    format!("{}: this network cannot be simulated; remake it with: {command}", files.net.display())
}

/// The command that remakes a network of this shape where it is; elsewhere if it is called otherwise than that.
fn way_out(net: &Path, grid: Grid) -> String {
    if net.file_name().is_some_and(|name| name == format!("grid_{grid}.net.xml").as_str()) {
        return format!("remake it with: {}", command_for(net));
    }
    format!("make one with: dials-traffic nets grid --rows {} --cols {} --out DIR", grid.rows(), grid.cols())
}

/// The grid whose intersections and edges have the names in a net.
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

/// The ids of one kind of element, without those inside of intersections.
fn names(root: &Element, kind: &str) -> BTreeSet<String> {
    let ids = root.all(kind).filter_map(|element| element.attribute("id"));
    ids.filter(|id| !id.starts_with(':')).map(str::to_owned).collect()
}

/// The smallest grid that has all the intersections named.
fn shape(junctions: &BTreeSet<String>) -> Result<Grid> {
    let places = junctions.iter().filter_map(|name| {
        let (row, col) = name.strip_prefix('r')?.split_once('c')?;
        Some((row.parse::<usize>().ok()?, col.parse::<usize>().ok()?))
    });
    // A grid has fewer rows and columns than its net has junctions; a larger number is a name of somebody else's.
    let places = places.filter(|&(row, col)| row.max(col) < junctions.len());
    let (rows, cols) = places.fold((1, 1), |(rows, cols), (row, col)| (rows.max(row + 1), cols.max(col + 1)));
    Grid::new(rows, cols)
}

fn first_difference(kind: &str, found: &BTreeSet<String>, expected: &BTreeSet<String>) -> Option<String> {
    let unexpected = found.difference(expected).next().map(|name| format!("it has the {kind} '{name}'"));
    unexpected.or_else(|| expected.difference(found).next().map(|name| format!("it lacks the {kind} '{name}'")))
}

/// What to say of a file of a network that is not there, with the command that makes it.
fn no_such_network(missing: &Path) -> String {
    format!("{}: no such network; make it with: {}", missing.display(), command_for(missing))
}

/// The command that makes the network that a file belongs to.
pub(super) fn command_for(path: &Path) -> String {
    let dir = path.parent().filter(|dir| !dir.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let name = file.split('.').next().unwrap_or_default();
    let which = match name.strip_prefix("grid_").and_then(|shape| shape.split_once('x')) {
        Some((rows, cols)) if [rows, cols].iter().all(|number| number.parse::<usize>().is_ok()) => {
            format!("grid --rows {rows} --cols {cols}")
        }
        _ if name == "local" => "local".to_owned(),
        _ => "grid --rows R --cols C".to_owned(),
    };
    format!("dials-traffic nets {which} --out {}", dir.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_network_comes_with_the_command_that_makes_it() {
        let error = NetworkFiles::of(Path::new("nowhere/grid_3x4")).check().unwrap_err().to_string();
        let way_out = "dials-traffic nets grid --rows 3 --cols 4 --out nowhere";
        assert_eq!(error, format!("nowhere/grid_3x4.net.xml: no such network; make it with: {way_out}"));
        assert!(no_such_network(Path::new("local.rou.xml")).ends_with("dials-traffic nets local --out ."));
        assert!(no_such_network(Path::new("a/city.net.xml")).ends_with("nets grid --rows R --cols C --out a"));
    }

    #[test]
    fn a_dot_in_the_name_of_a_network_stays() {
        assert_eq!(NetworkFiles::of(Path::new("../v1.2/net")).config, Path::new("../v1.2/net.sumocfg"));
        assert_eq!(NetworkFiles::of(Path::new("net.a")).net, Path::new("net.a.net.xml"));
    }

    #[test]
    fn only_the_comment_of_netconvert_is_taken_away() {
        let net = "<?xml?>\n\n<!-- generated on a day\n-->\n\n<net>\n<!-- ours -->\n</net>\n";
        assert_eq!(without_comment(net), "<?xml?>\n\n<net>\n<!-- ours -->\n</net>\n");
        assert_eq!(without_comment("<net><!-- ours --></net>"), "<net><!-- ours --></net>");
    }

    #[test]
    fn without_netconvert_nothing_is_left_behind() {
        let room = tempfile::tempdir().expect("a temporary directory");
        let dir = room.path().join("nets");
        let error = write_network("local", Grid::SINGLE, None, &dir, "netconvert-that-nobody-has").unwrap_err();
        let way_out = "netconvert is not on the PATH: install Debian's package sumo (./setup.sh)";
        assert_eq!(
            format!("{error:#}"),
            format!("{}: could not be made: {way_out}", dir.join("local.net.xml").display())
        );
        assert!(!dir.exists());
    }

    #[test]
    fn what_netconvert_complains_of_is_in_the_error() {
        let room = tempfile::tempdir().expect("a temporary directory");
        let broken = room.path().join("broken");
        fs::write(&broken, "#!/bin/sh\necho 'Error: no idea' >&2\nexit 1\n").expect("a writable directory");
        fs::set_permissions(&broken, Permissions::from_mode(0o755)).expect("our own file");
        let dir = room.path().join("nets");
        let error = write_network("local", Grid::SINGLE, None, &dir, &broken.to_string_lossy()).unwrap_err();
        assert!(format!("{error:#}").ends_with("netconvert failed (exit status: 1): Error: no idea"), "{error:#}");
        assert!(!dir.exists());
    }

    #[test]
    fn an_inflow_is_a_probability() {
        for inflow in [-0.1, 1.5, f64::NAN] {
            let error = write_grid(Grid::SINGLE, inflow, Path::new("unused")).unwrap_err().to_string();
            assert!(error.ends_with("must be a probability, from 0 to 1"), "{error}");
        }
    }

    #[test]
    fn files_are_written_together_or_not_at_all() {
        let room = tempfile::tempdir().expect("a temporary directory");
        let blocked = room.path().join("b");
        fs::create_dir(&blocked).expect("a writable directory");
        let files = [(room.path().join("a"), vec![1]), (blocked.clone(), vec![2])];
        let error = write_together(room.path(), &files).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: is a directory", blocked.display())), "{error}");
        assert_eq!(fs::read_dir(room.path()).expect("readable").count(), 1, "only the directory b is there");
    }
}
