//! Replays in which each car that entered is listed: of a grid, and of the local simulator of a light of a scenario.
//!
//! Cars of a grid draw nothing at random. For a local simulator SUMO gives lane n the generator of random numbers of the
//! seed plus n. The recorded episode had these seeds, so cars dawdle as they did. The road apart is there, too: see
//! [`crate::cut::mixed`].

use std::collections::HashMap;
use std::io;
use std::path::Path;

use super::{NAME, SIGNALS, VIEW};
use crate::cut::mixed::Alone;
use crate::network::files::NetworkFiles;
use crate::network::xml::{Xml, document, element, leaf, section};
use crate::scenario::stops::Stop;
use crate::sim::local_forest::write_route;
use crate::sim::options::NO_TELEPORTS;
use crate::sim::recorded_roads::{GridFiles, LocalFiles};
use crate::sim::recording::{Entry, Recording};
use libsumo::DepartSpeed;

const TYPES: &str = "replay.types.add.xml";
/// Places on the road apart for the first cars, one after the other, in metres: number and distance.
const PLACES: (usize, usize) = (30, 30);

type Contents = Vec<(String, Vec<u8>)>;

/// Returns the files of a grid's replay, without signals and view.
pub(super) fn of_grid(recording: &Recording, grid: &GridFiles) -> Contents {
    // SUMO wants the cars in the order of their departures.
    let cars = document("routes", |xml| {
        grid.vehicle_types.iter().try_for_each(|kind| element(xml, kind))?;
        write_routes(xml, recording, &HashMap::new())?;
        recording.entries.iter().try_for_each(|entry| write_car(xml, entry, entry.step as f64, None))
    });
    files(recording, grid.net.clone(), cars, &[SIGNALS], &[])
}

/// Returns the files of a local simulator's replay, without signals and view. `place_m`: where the light is.
pub(super) fn of_local(recording: &Recording, local: &LocalFiles, place_m: [f64; 2]) -> Contents {
    let alone = Alone::of(&local.net, place_m);
    let cars = document("routes", |xml| {
        leaf(xml, "route", [("id", &*alone.apart), ("edges", &*alone.apart)])?;
        write_routes(xml, recording, &local.stops)?;
        for (number, (vehicle_type, speed_factor)) in local.first.iter().enumerate() {
            let place_m = number % PLACES.0 * PLACES.1 + 10;
            let attributes = [
                ("id", format!("{}.{number}", alone.apart)),
                ("type", vehicle_type.clone()),
                ("speedFactor", speed_factor.to_string()),
                ("route", alone.apart.clone()),
                ("depart", number.to_string()),
                ("departPos", place_m.to_string()),
                ("arrivalPos", format!("{place_m}.1")),
            ];
            leaf(xml, "vehicle", attributes)?;
        }
        recording.entries.iter().try_for_each(|entry| {
            let end_m = local.ends_m.get(&entry.car.route).copied();
            // A car enters in the last step of a second.
            let second = (local.begin_s() + entry.step as u64) as f64;
            write_car(xml, entry, second + 1.0 - 1.0 / f64::from(local.steps_per_s), end_m)
        })
    });
    let generators = alone.lanes.to_string();
    let options = local.options.iter().map(|(name, value)| (&**name, &**value));
    let options: Vec<(&str, &str)> = [("thread-rngs", &*generators)].into_iter().chain(options).collect();
    let mut files = files(recording, alone.net, cars, &[TYPES, SIGNALS], &options);
    files.push((TYPES.to_owned(), local.types.clone().into_bytes()));
    files
}

/// Returns net, cars and configuration. `options`: those that a grid has not.
fn files(recording: &Recording, net: String, cars: String, additional: &[&str], options: &[(&str, &str)]) -> Contents {
    let names = NetworkFiles::of(Path::new(NAME));
    let [net_file, routes_file, config_file] =
        [names.net, names.routes, names.config].map(|path| path.to_string_lossy().into_owned());
    let end = (recording.roads.begin_s() + recording.steps.len() as u64).to_string();
    let additional = additional.join(",");
    let input = [("net-file", &*net_file), ("route-files", &routes_file), ("additional-files", &additional)];
    let step_length = (1.0 / f64::from(recording.roads.steps_per_s())).to_string();
    let options = [&[NO_TELEPORTS], options].concat();
    let config = document("configuration", |xml| {
        section(xml, "input", &input)?;
        section(xml, "time", &[("begin", "0"), ("end", &end), ("step-length", &step_length)])?;
        section(xml, "processing", &options)?;
        section(xml, "random_number", &[("seed", &recording.seed.to_string())])?;
        section(xml, "report", &[("no-warnings", "true"), ("xml-validation", "never")])?;
        section(xml, "gui_only", &[("gui-settings-file", VIEW)])
    });
    vec![(net_file, net.into_bytes()), (routes_file, cars.into_bytes()), (config_file, config.into_bytes())]
}

fn write_routes(xml: &mut Xml, recording: &Recording, stops: &HashMap<String, Vec<Stop>>) -> io::Result<()> {
    let mut routes: Vec<(&str, &[String])> =
        recording.entries.iter().map(|entry| (entry.car.route.as_str(), entry.car.edges.as_slice())).collect();
    routes.sort_unstable();
    routes.dedup();
    routes.iter().try_for_each(|(id, edges)| {
        write_route(xml, id, &edges.join(" "), stops.get(*id).map_or(&[], Vec::as_slice), "")
    })
}

/// Writes a car that enters at a second. `end_m`: position at which it has arrived; `None`: at the end of its route.
fn write_car(xml: &mut Xml, Entry { car, speed, .. }: &Entry, depart_s: f64, end_m: Option<f64>) -> io::Result<()> {
    let speed = match speed {
        DepartSpeed::Max => "max".to_owned(),
        DepartSpeed::Fixed(speed_mps) => speed_mps.to_string(),
    };
    // Rust writes the shortest digits that read back as the same number.
    let attributes = [
        ("id", car.name.clone()),
        ("type", car.vehicle_type.clone()),
        ("route", car.route.clone()),
        ("depart", depart_s.to_string()),
        ("departLane", car.lane.to_string()),
        ("departPos", car.position_m.to_string()),
        ("departSpeed", speed),
        ("speedFactor", car.speed_factor.to_string()),
    ];
    leaf(xml, "vehicle", attributes.into_iter().chain(end_m.map(|end_m| ("arrivalPos", end_m.to_string()))))
}
