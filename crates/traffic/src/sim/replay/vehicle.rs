//! Cars of a replay as elements: with them SUMO lets each car enter as it was recorded.

use std::io;

use crate::network::xml::{Xml, leaf};
use crate::sim::recording::{Entry, Recording};
use libsumo::DepartSpeed;

/// Writes the routes of the recorded cars, each once.
pub(crate) fn write_routes(xml: &mut Xml, recording: &Recording) -> io::Result<()> {
    let mut routes: Vec<(&str, &[String])> =
        recording.entries.iter().map(|entry| (entry.car.route.as_str(), entry.car.edges.as_slice())).collect();
    routes.sort_unstable();
    routes.dedup();
    routes.iter().try_for_each(|(id, edges)| leaf(xml, "route", [("id", *id), ("edges", &edges.join(" "))]))
}

/// Writes a car that enters at a second. `end_m`: position at which it has arrived; `None`: at the end of its route.
pub(crate) fn write_car(
    xml: &mut Xml,
    Entry { car, speed, .. }: &Entry,
    depart_s: u64,
    end_m: Option<f64>,
) -> io::Result<()> {
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
