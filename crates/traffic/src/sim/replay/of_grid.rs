//! The replay of a grid: one `<vehicle>` per car that entered.

use std::path::Path;

use super::vehicle::{write_car, write_routes};
use super::{NAME, config};
use crate::network::files::NetworkFiles;
use crate::network::xml::{document, element};
use crate::sim::recorded_roads::GridFiles;
use crate::sim::recording::Recording;

/// Returns the files of the replay without signals and view: names and contents.
pub(super) fn files(recording: &Recording, grid: &GridFiles) -> Vec<(String, Vec<u8>)> {
    let names = NetworkFiles::of(Path::new(NAME));
    let [net, routes, sumocfg] =
        [names.net, names.routes, names.config].map(|path| path.to_string_lossy().into_owned());
    let config = config(recording, [&net, &routes], &[], &[]);
    // SUMO wants the cars in the order of their departures.
    let vehicles = document("routes", |xml| {
        grid.vehicle_types.iter().try_for_each(|kind| element(xml, kind))?;
        write_routes(xml, recording)?;
        recording.entries.iter().try_for_each(|entry| write_car(xml, entry, entry.step as u64, None))
    });
    vec![(net, grid.net.clone().into_bytes()), (routes, vehicles.into_bytes()), (sumocfg, config.into_bytes())]
}
