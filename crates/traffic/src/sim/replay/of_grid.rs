//! The replay of a grid: one `<vehicle>` per car that entered.

use std::path::Path;

use super::vehicle::{write_car, write_routes};
use super::{NAME, Program, SIGNALS, VIEW, programs, shown};
use crate::network::files::NetworkFiles;
use crate::network::xml::{document, element, section};
use crate::sim::options::{STEP_LENGTH_S, TIME_TO_TELEPORT_S};
use crate::sim::recorded_roads::RecordedGrid;
use crate::sim::recording::Recording;

/// Returns the files of the replay without signals and view: names and contents.
pub fn files(recording: &Recording, grid: &RecordedGrid) -> Vec<(String, Vec<u8>)> {
    let names = NetworkFiles::of(Path::new(NAME));
    let [net, routes, sumocfg] =
        [names.net, names.routes, names.config].map(|path| path.to_string_lossy().into_owned());
    let config = config(recording, &net, &routes);
    vec![
        (net, grid.net.clone().into_bytes()),
        (routes, vehicles(recording, grid).into_bytes()),
        (sumocfg, config.into_bytes()),
    ]
}

/// Returns one program per light.
pub fn signals(recording: &Recording) -> String {
    let lights = recording.roads.lights.iter().enumerate();
    programs(
        lights.map(|(number, light)| Program { light, name: "recorded".to_owned(), shown: shown(recording, number) }),
        0,
    )
}

/// Returns the cars with their state at entry. SUMO wants them in the order of their departures.
fn vehicles(recording: &Recording, grid: &RecordedGrid) -> String {
    document("routes", |xml| {
        grid.vehicle_types.iter().try_for_each(|kind| element(xml, kind))?;
        write_routes(xml, recording)?;
        recording.entries.iter().try_for_each(|entry| write_car(xml, entry, entry.step as u64, None))
    })
}

fn config(recording: &Recording, net: &str, routes: &str) -> String {
    let (end, seed) = (recording.steps.len().to_string(), recording.seed.to_string());
    document("configuration", |xml| {
        section(xml, "input", &[("net-file", net), ("route-files", routes), ("additional-files", SIGNALS)])?;
        section(xml, "time", &[("begin", "0"), ("end", &end), ("step-length", STEP_LENGTH_S)])?;
        section(xml, "processing", &[("time-to-teleport", TIME_TO_TELEPORT_S)])?;
        section(xml, "random_number", &[("seed", &seed)])?;
        section(xml, "report", &[("no-warnings", "true"), ("xml-validation", "never")])?;
        section(xml, "gui_only", &[("gui-settings-file", VIEW)])
    })
}
