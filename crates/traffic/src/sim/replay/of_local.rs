//! The replay of a local simulator of a scenario: the local net alone, its cars one by one, and its lights.
//!
//! SUMO gives lane n the generator of random numbers of the seed plus n. The recorded episode had these seeds, so cars
//! dawdle as they did. The road apart is there, too: see [`crate::cut::mixed`].

use std::path::Path;

use super::vehicle::{write_car, write_routes};
use super::{NAME, config};
use crate::cut::mixed::Alone;
use crate::network::files::NetworkFiles;
use crate::network::xml::{document, leaf};
use crate::sim::recorded_local::LocalFiles;
use crate::sim::recording::Recording;

/// File of the vehicle types.
const TYPES: &str = "replay.types.add.xml";
/// Places on the road apart for the first cars, one after the other, in metres: number and distance.
const PLACES: (usize, usize) = (30, 30);

/// Returns the files of the replay without signals and view: names and contents. `place_m`: where the light is.
pub(super) fn files(recording: &Recording, files: &LocalFiles, place_m: [f64; 2]) -> Vec<(String, Vec<u8>)> {
    let names = NetworkFiles::of(Path::new(NAME));
    let [net, routes, sumocfg] =
        [names.net, names.routes, names.config].map(|path| path.to_string_lossy().into_owned());
    let alone = Alone::of(&files.net, place_m);
    let generators = alone.lanes.to_string();
    let options = files.options.iter().map(|(name, value)| (&**name, &**value));
    let options: Vec<(&str, &str)> = [("thread-rngs", &*generators)].into_iter().chain(options).collect();
    let config = config(recording, [&net, &routes], &[TYPES], &options);
    vec![
        (net, alone.net.clone().into_bytes()),
        (TYPES.to_owned(), files.types.clone().into_bytes()),
        (routes, vehicles(recording, files, &alone).into_bytes()),
        (sumocfg, config.into_bytes()),
    ]
}

/// Returns the cars on the road apart, then those that were recorded.
fn vehicles(recording: &Recording, files: &LocalFiles, alone: &Alone) -> String {
    let begin_s = files.begin_s();
    document("routes", |xml| {
        leaf(xml, "route", [("id", &*alone.apart), ("edges", &*alone.apart)])?;
        write_routes(xml, recording)?;
        for (number, (vehicle_type, speed_factor)) in files.first.iter().enumerate() {
            let (depart_s, place_m) = (number.to_string(), number % PLACES.0 * PLACES.1 + 10);
            let (from_m, to_m) = (place_m.to_string(), format!("{place_m}.1"));
            let who = [("id", format!("{}.{number}", alone.apart)), ("type", vehicle_type.clone())];
            let way =
                [("route", &*alone.apart), ("depart", &*depart_s), ("departPos", &*from_m), ("arrivalPos", &*to_m)];
            let how = ("speedFactor", speed_factor.to_string());
            let attributes = who.iter().chain([&how]).map(|(key, value)| (*key, &**value)).chain(way);
            leaf(xml, "vehicle", attributes)?;
        }
        recording.entries.iter().try_for_each(|entry| {
            let end_m = files.ends_m.get(&entry.car.route).copied();
            write_car(xml, entry, begin_s + entry.step as u64, end_m)
        })
    })
}
