//! Replays: a recorded episode as a folder that plain `sumo` and `sumo-gui` play, car by car and to the last bit.
//!
//! The folder needs nothing outside of itself. Each light under control has a program that shows what was shown.
//!
//! - On a grid and of a local simulator, each car that entered is `listed`.
//! - On a scenario, its own files play with the seed of the episode. So SUMO draws the same numbers, and cars of all types
//!   choose the same routes, lanes and speeds.

mod listed;

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use super::recorded_roads::{RecordedFiles, RecordedRoads};
use super::recording::Recording;
use crate::cut::names::free_name;
use crate::network::files::{NetworkFiles, for_sumo};
use crate::network::loadable::way_out_of;
use crate::network::tree::Element;
use crate::network::xml::{Xml, document, element, leaf, nest};
use crate::scenario::kept::Episode;
use dials_core::outside::{quoted, write_together};
use libsumo::{CarTable, SignalState, Simulation};

const NAME: &str = "replay";
const SIGNALS: &str = "replay.signals.add.xml";
const VIEW: &str = "view.xml";

const WATCHING_DELAY_MS: u32 = 100;

pub fn config_in(dir: &Path) -> PathBuf {
    NetworkFiles::of(&dir.join(NAME)).config
}

/// Checks that SUMO can open the files of a replay in the folder `dir`, which need not exist.
pub fn check_place(dir: &Path) -> Result<()> {
    NetworkFiles::of(&dir.join(NAME)).check_config_path()
}

pub fn write(recording: &Recording, dir: &Path) -> Result<()> {
    let RecordedRoads { files, agents, lights, .. } = &*recording.roads;
    let (mut files, signals) = match files {
        RecordedFiles::Grid(files) => {
            (listed::of_grid(recording, files), signals(&programs(recording, lights.len(), [])))
        }
        RecordedFiles::Whole(files) => {
            // The lights that do not learn run the programs that they ran.
            let roots = || [files.net()].into_iter().chain(files.additional());
            let mut programs = programs(recording, agents.len(), roots());
            // SUMO refuses some programs in an additional file, but not in a net. There a program of another file would be later.
            let is_refused = |light: usize| waiting_for_each_other(recording, light).is_some();
            let others = || files.additional().flat_map(|root| root.all("tlLogic"));
            let in_net = |light: &usize| {
                let id = Some(&*recording.roads.lights[*light]);
                is_refused(*light) && others().all(|program| program.attribute("id") != id)
            };
            let places: Vec<usize> = (0..agents.len()).filter(in_net).collect();
            check_programs(
                recording,
                (0..agents.len()).filter(|light| !places.contains(light)),
                &quoted(files.net_path()),
            )?;
            let net_programs = places.iter().rev().map(|&light| programs.remove(light)).collect();
            let end_s = recording.roads.begin_s() + recording.steps.len() as u64;
            let episode = Episode { seed: recording.seed, end_s, signals: SIGNALS, net_programs, view: VIEW };
            (files.episode_files(NAME, &episode), signals(&programs))
        }
        RecordedFiles::Local(files) => {
            check_programs(recording, 0..lights.len(), "NET.net.xml")?;
            let signals = signals(&programs(recording, lights.len(), [files.net.root()]));
            (listed::of_local(recording, files, agents[0].place_m), signals)
        }
    };
    files.push((SIGNALS.to_owned(), signals.into_bytes()));
    files.push((VIEW.to_owned(), view(&recording.roads, WATCHING_DELAY_MS, &[]).into_bytes()));
    let files: Vec<_> = files.into_iter().map(|(name, bytes)| (dir.join(name), bytes)).collect();
    write_together(dir, &files)
}

/// Lets SUMO play the folder and compares. It is an error unless in every step every car is in the same place, equally
/// fast, bit for bit. The caller must hold no simulation.
pub fn check(recording: &Recording, dir: &Path) -> Result<()> {
    let config = config_in(dir);
    let mut simulation = Simulation::unloaded()?;
    simulation.name(&config.display().to_string(), &way_out_of(&config));
    simulation.reload(&["-c".to_owned(), for_sumo(&config)?])?;
    simulation.set_steps_per_second(recording.roads.steps_per_s());
    let lanes = simulation.register_lanes(&recording.roads.lanes)?;
    let lights = simulation.register_lights(&recording.roads.lights)?;
    let (mut signals, mut cars) = (Vec::new(), CarTable::new());
    // A local simulator has some seconds before its episode.
    while simulation.time_s()? < recording.roads.begin_s() as f64 {
        simulation.second()?;
    }
    for (number, recorded) in recording.steps.iter().enumerate() {
        simulation.second()?;
        simulation.read_lights(&lights, &mut signals)?;
        simulation.read_lanes(&lanes, &mut cars)?;
        if signals == recorded.signals && cars == recorded.cars {
            continue;
        }
        let of = match &recording.roads.files {
            RecordedFiles::Grid(_) => bail!(
                "SUMO plays step {number} of the replay differently from the recording; only networks whose cars draw \
                 nothing at random, such as those of `dials-traffic nets`, can be replayed"
            ),
            RecordedFiles::Whole(files) => files.path().display().to_string(),
            RecordedFiles::Local(files) => format!("the light {}", files.net.light),
        };
        bail!(
            "SUMO plays second {} of the replay differently from the recording, so it is not kept; this should not \
             happen, please report it with {of}",
            recording.roads.begin_s() + number as u64
        );
    }
    Ok(())
}

/// Returns an error if SUMO would refuse what one of these lights showed as a program of another file. `net`: for the way out.
fn check_programs(recording: &Recording, lights: impl IntoIterator<Item = usize>, net: &str) -> Result<()> {
    for number in lights {
        if let Some([one, two]) = waiting_for_each_other(recording, number) {
            let light = &recording.roads.lights[number];
            bail!(
                "SUMO cannot replay what the light {light} showed: `g` for the letters {one} and {two} at once, whose cars \
                 yield to each other; make the net anew with `netconvert -s {net} --tls.ignore-internal-junction-jam -o \
                 NEW.net.xml`, and use that"
            );
        }
    }
    Ok(())
}

fn waiting_for_each_other(recording: &Recording, number: usize) -> Option<[usize; 2]> {
    let light = &recording.roads.lights[number];
    recording.roads.roads.waiting_for_each_other(light, &shown(recording, number))
}

/// Returns a program for each of the first `lights` recorded lights. `roots`: of the files with their other programs.
fn programs<'a>(recording: &Recording, lights: usize, roots: impl IntoIterator<Item = &'a Element>) -> Vec<Element> {
    let programs = roots.into_iter().flat_map(|root| root.all("tlLogic"));
    let taken: HashSet<(&str, &str)> =
        programs.filter_map(|program| Some((program.attribute("id")?, program.attribute("programID")?))).collect();
    // With an offset of its first second, a program is at the beginning of its first phase then.
    let offset = recording.roads.begin_s().to_string();
    let element = |name: &str, attributes: &[(&str, &str)], children: Vec<Element>| {
        let attributes = attributes.iter().map(|(key, value)| (key.to_string(), value.to_string())).collect();
        Element { name: name.to_owned(), attributes, children }
    };
    let program = |(number, light): (usize, &String)| {
        // A scenario may be a replay itself.
        let name = free_name("recorded", |name| taken.contains(&(light, name)));
        let head = [("id", &**light), ("type", "static"), ("programID", &*name), ("offset", &*offset)];
        let shown = shown(recording, number);
        let phase = |phase: &[&SignalState]| {
            let duration = phase.len().to_string();
            element("phase", &[("duration", &*duration), ("state", phase[0].as_str())], Vec::new())
        };
        element("tlLogic", &head, shown.chunk_by(|a, b| a == b).map(phase).collect())
    };
    recording.roads.lights.iter().take(lights).enumerate().map(program).collect()
}

fn signals(programs: &[Element]) -> String {
    document("additional", |xml| programs.iter().try_for_each(|program| element(xml, program)))
}

fn shown(recording: &Recording, light: usize) -> Vec<&SignalState> {
    recording.steps.iter().map(|step| &step.signals[light]).collect()
}

pub struct Snapshot {
    /// Path of the picture; its ending gives the format.
    pub file: PathBuf,
    pub step: usize,
}

/// Colours of cars at these speeds, in metres per second; between them the colours flow into each other. A standing car is
/// red, a car at a city's limit blue. People with any kind of colour vision can distinguish these.
pub const SPEED_COLOURS: [([u8; 3], u32); 3] = [([213, 94, 0], 0), ([240, 228, 66], 5), ([86, 180, 233], 10)];

/// Longer side of a film, and least length of a car in it.
const FILM_PX: f64 = 1200.0;
const LEAST_CAR_PX: f64 = 10.0;
const CAR_M: f64 = 5.0;
const LARGER: f64 = 1.4;

/// SUMO's names of the sorts of roads on which cars drive. Without a colour of ours, rails in a road are purple.
const SORTS: [&str; 3] = ["road", "no passenger", "rails on road"];

pub fn view(roads: &RecordedRoads, delay_ms: u32, snapshots: &[Snapshot]) -> String {
    const BOXES: &str = "1";
    const BY_SPEED: &str = "8";
    // How much larger than they are cars and roads are drawn, so that a whole network can be watched.
    let (cars, edges, sorts) = if roads.grid().is_some() {
        (LARGER, "1.5", &SORTS[..1])
    } else {
        let [wide, tall] = roads.extent_m();
        let car_px = CAR_M * FILM_PX / wide.max(tall);
        // Lanes side by side must not cover each other.
        ((LEAST_CAR_PX / car_px).max(LARGER), "1", &SORTS[..])
    };
    document("viewsettings", |xml| {
        nest(xml, "scheme", [("name", "standard")], |xml| {
            leaf(xml, "background", [("backgroundColor", "245,245,245"), ("showGrid", "0")])?;
            nest(xml, "edges", [("laneEdgeMode", "0"), ("widthExaggeration", edges)], |xml| all_grey(xml, sorts))?;
            nest(xml, "junctions", [("junctionMode", "0")], |xml| all_grey(xml, &[""]))?;
            let cars =
                [("vehicleMode", BY_SPEED), ("vehicleQuality", BOXES), ("vehicle_exaggeration", &*cars.to_string())];
            nest(xml, "vehicles", cars.into_iter().chain([("showBlinker", "0")]), |xml| {
                nest(xml, "colorScheme", [("name", "by speed"), ("interpolated", "1")], |xml| {
                    SPEED_COLOURS.iter().try_for_each(|([red, green, blue], speed_mps)| {
                        let colour = format!("{red},{green},{blue}");
                        leaf(xml, "entry", [("color", &*colour), ("threshold", &speed_mps.to_string())])
                    })
                })
            })?;
            leaf(xml, "legend", [("showSizeLegend", "0")])
        })?;
        leaf(xml, "delay", [("value", delay_ms.to_string())])?;
        snapshots.iter().try_for_each(|snapshot| {
            let time = (roads.begin_s() + snapshot.step as u64).to_string();
            leaf(xml, "snapshot", [("file", &*snapshot.file.to_string_lossy()), ("time", &time)])
        })
    })
}

fn all_grey(xml: &mut Xml, sorts: &[&str]) -> io::Result<()> {
    let entry = |xml: &mut Xml, sort: &&str| leaf(xml, "entry", [("name", *sort), ("color", "90,90,90")]);
    nest(xml, "colorScheme", [("name", "uniform")], |xml| sorts.iter().try_for_each(|sort| entry(xml, sort)))
}
