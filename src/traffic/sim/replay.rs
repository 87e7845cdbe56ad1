//! Replays: a recorded episode as a folder that plain `sumo` and `sumo-gui` play, car by car and to the last bit.
//!
//! The folder needs nothing outside of itself. It holds the net, one `<vehicle>` per car that entered, one light
//! program per intersection and a configuration that names them. The programs show what was shown. No part of the
//! folder makes decisions, and SUMO's cars draw nothing at random, so they move as before.

use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::options::{STEP_LENGTH_S, TIME_TO_TELEPORT_S};
use super::recording::{Entry, Recording, Step};
use crate::outside::write_together;
use crate::sumo::{CarTable, DepartSpeed, SignalState, Simulation};
use crate::traffic::network::files::{NetworkFiles, for_sumo};
use crate::traffic::network::xml::{Xml, document, element, leaf, nest, section};

/// Name of all files of a replay.
const NAME: &str = "replay";
const SIGNALS: &str = "replay.signals.add.xml";
const VIEW: &str = "view.xml";

/// Returns the configuration for `sumo -c` and `sumo-gui -c` in the folder of a replay.
pub fn config_in(dir: &Path) -> PathBuf {
    NetworkFiles::of(&dir.join(NAME)).config
}

/// Writes the episode into `dir`.
pub fn write(recording: &Recording, dir: &Path) -> Result<()> {
    let files = NetworkFiles::of(&dir.join(NAME));
    files.check_paths()?;
    let contents = [
        (files.net, recording.roads.net.clone().into_bytes()),
        (files.routes, vehicles(recording).into_bytes()),
        (dir.join(SIGNALS), signals(recording).into_bytes()),
        (dir.join(VIEW), view(WATCHING_DELAY_MS, &[]).into_bytes()),
        (files.config, config(recording).into_bytes()),
    ];
    write_together(dir, &contents)
}

/// Lets SUMO play the folder and compares. It is an error unless in every step every car is in the same place, equally
/// fast, bit for bit. The caller must hold no simulation.
pub fn check(recording: &Recording, dir: &Path) -> Result<()> {
    let config = config_in(dir);
    let mut simulation = Simulation::load(&["-c".to_owned(), for_sumo(&config)?])?;
    let lanes: Vec<String> = recording.roads.lanes.iter().map(|lane| lane.name.clone()).collect();
    let lanes = simulation.register_lanes(&lanes)?;
    let lights = simulation.register_lights(&recording.roads.lights)?;
    let mut played = Step { signals: Vec::new(), cars: CarTable::new() };
    for (number, recorded) in recording.steps.iter().enumerate() {
        simulation.step()?;
        simulation.read_lights(&lights, &mut played.signals)?;
        simulation.read_lanes(&lanes, &mut played.cars)?;
        ensure!(
            played == *recorded,
            "SUMO plays step {number} of the replay differently from the recording; only networks whose cars draw nothing at \
             random, such as those of `dials-traffic nets`, can be replayed"
        );
    }
    Ok(())
}

/// Returns the cars with their state at entry. SUMO wants them in the order of their departures.
fn vehicles(recording: &Recording) -> String {
    let mut routes: Vec<(&str, &[String])> =
        recording.entries.iter().map(|entry| (entry.car.route.as_str(), entry.car.edges.as_slice())).collect();
    routes.sort_unstable();
    routes.dedup();
    document("routes", |xml| {
        recording.roads.vehicle_types.iter().try_for_each(|kind| element(xml, kind))?;
        routes.iter().try_for_each(|(id, edges)| leaf(xml, "route", [("id", *id), ("edges", &edges.join(" "))]))?;
        recording.entries.iter().try_for_each(|Entry { step, car, speed }| {
            let speed = match speed {
                DepartSpeed::Max => "max".to_owned(),
                DepartSpeed::Fixed(speed_mps) => speed_mps.to_string(),
            };
            // Rust writes the shortest digits that read back as the same number.
            let attributes = [
                ("id", car.name.clone()),
                ("type", car.vehicle_type.clone()),
                ("route", car.route.clone()),
                ("depart", step.to_string()),
                ("departLane", car.lane.to_string()),
                ("departPos", car.position_m.to_string()),
                ("departSpeed", speed),
                ("speedFactor", car.speed_factor.to_string()),
            ];
            leaf(xml, "vehicle", attributes)
        })
    })
}

/// Returns one program per light, which shows what was shown.
fn signals(recording: &Recording) -> String {
    document("additional", |xml| {
        recording.roads.lights.iter().enumerate().try_for_each(|(light, id)| {
            let head = [("id", id.as_str()), ("type", "static"), ("programID", "recorded"), ("offset", "0")];
            let shown: Vec<&SignalState> = recording.steps.iter().map(|step| &step.signals[light]).collect();
            nest(xml, "tlLogic", head, |xml| {
                shown.chunk_by(|a, b| a == b).try_for_each(|phase| {
                    leaf(xml, "phase", [("duration", phase.len().to_string().as_str()), ("state", phase[0].as_str())])
                })
            })
        })
    })
}

/// Time for which sumo-gui shows a step.
const WATCHING_DELAY_MS: u32 = 100;

/// A picture for sumo-gui to take.
pub struct Snapshot {
    /// Path of the picture; its ending gives the format.
    pub file: PathBuf,
    /// Step before which it is taken.
    pub step: usize,
}

/// Returns how sumo-gui shows the roads; plain sumo ignores it.
///
/// Cars and roads are drawn wider than they are, so that a whole grid can be watched. A standing car is red, a car at
/// half of the limit yellow and a car at the limit blue. People with any kind of colour vision can tell these apart.
pub fn view(delay_ms: u32, snapshots: &[Snapshot]) -> String {
    const BOXES: &str = "1";
    const BY_SPEED: &str = "8";
    let speeds = [("213,94,0", "0"), ("240,228,66", "5"), ("86,180,233", "10")];
    document("viewsettings", |xml| {
        nest(xml, "scheme", [("name", "standard")], |xml| {
            leaf(xml, "background", [("backgroundColor", "245,245,245"), ("showGrid", "0")])?;
            nest(xml, "edges", [("laneEdgeMode", "0"), ("widthExaggeration", "1.5")], |xml| all_grey(xml, "road"))?;
            nest(xml, "junctions", [("junctionMode", "0")], |xml| all_grey(xml, ""))?;
            let cars = [("vehicleMode", BY_SPEED), ("vehicleQuality", BOXES), ("vehicle_exaggeration", "1.4")];
            nest(xml, "vehicles", cars.into_iter().chain([("showBlinker", "0")]), |xml| {
                nest(xml, "colorScheme", [("name", "by speed"), ("interpolated", "1")], |xml| {
                    speeds.iter().try_for_each(|(colour, speed_mps)| {
                        leaf(xml, "entry", [("color", *colour), ("threshold", *speed_mps)])
                    })
                })
            })?;
            leaf(xml, "legend", [("showSizeLegend", "0")])
        })?;
        leaf(xml, "delay", [("value", delay_ms.to_string())])?;
        snapshots.iter().try_for_each(|snapshot| {
            let (file, time) = (snapshot.file.to_string_lossy(), snapshot.step.to_string());
            leaf(xml, "snapshot", [("file", &*file), ("time", &time)])
        })
    })
}

/// Writes one grey for everything of a kind.
fn all_grey(xml: &mut Xml, name: &str) -> io::Result<()> {
    let entry = [("name", name), ("color", "90,90,90")];
    nest(xml, "colorScheme", [("name", "uniform")], |xml| leaf(xml, "entry", entry))
}

fn config(recording: &Recording) -> String {
    let NetworkFiles { net, routes, .. } = NetworkFiles::of(Path::new(NAME));
    let (net, routes) = (net.to_string_lossy(), routes.to_string_lossy());
    let (end, seed) = (recording.steps.len().to_string(), recording.seed.to_string());
    document("configuration", |xml| {
        section(xml, "input", &[("net-file", &net), ("route-files", &routes), ("additional-files", SIGNALS)])?;
        section(xml, "time", &[("begin", "0"), ("end", &end), ("step-length", STEP_LENGTH_S)])?;
        section(xml, "processing", &[("time-to-teleport", TIME_TO_TELEPORT_S)])?;
        section(xml, "random_number", &[("seed", &seed)])?;
        section(xml, "report", &[("no-warnings", "true"), ("xml-validation", "never")])?;
        section(xml, "gui_only", &[("gui-settings-file", VIEW)])
    })
}
