//! How sumo-gui shows the roads of a replay; plain sumo ignores it.

use std::io;
use std::path::PathBuf;

use crate::network::xml::{Xml, document, leaf, nest};
use crate::sim::recorded_roads::RecordedRoads;

pub struct Snapshot {
    /// Path of the picture; its ending gives the format.
    pub file: PathBuf,
    pub step: usize,
}

/// Colours of cars at these speeds, in metres per second; between them the colours flow into each other. A standing car is
/// red, a car at a city's limit blue. People with any kind of colour vision can distinguish these.
pub const SPEED_COLOURS: [([u8; 3], u32); 3] = [([213, 94, 0], 0), ([240, 228, 66], 5), ([86, 180, 233], 10)];

/// Longer side of a film in pixels, and least length of a car in it.
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
