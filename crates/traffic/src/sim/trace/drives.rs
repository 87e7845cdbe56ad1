//! The cars on lanes that follow each other, as lines in space and time.

use std::collections::BTreeMap;

use anyhow::Result;

use crate::sim::recording::Recording;
use libsumo::CarId;

/// A lane on a way.
pub(crate) struct Stretch {
    pub(crate) lane: String,
    /// Metres from the beginning of the way to that of the lane.
    pub(crate) begin_m: f64,
    /// Metres on the way for a metre on the lane. Lanes side by side may differ in length.
    pub(crate) scale: f64,
}

/// Returns the points of each drive on these lanes: seconds, and metres from the beginning of the way. A car that leaves
/// the way and comes back makes two drives.
pub(super) fn drives(recording: &Recording, stretches: &[Stretch]) -> Result<Vec<Vec<(f64, f64)>>> {
    let mut cars: BTreeMap<CarId, Vec<(usize, f64)>> = BTreeMap::new();
    for Stretch { lane, begin_m, scale } in stretches {
        for (step, on_lane) in recording.on_lane(lane)?.enumerate() {
            for car in on_lane.iter() {
                cars.entry(car.id).or_default().push((step + 1, begin_m + car.position_m * scale));
            }
        }
    }
    let drives = cars.into_values().flat_map(|mut points| {
        points.sort_by_key(|&(second, _)| second);
        let goes_on = |one: &(usize, f64), next: &(usize, f64)| next.0 == one.0 + 1 && next.1 >= one.1;
        points
            .chunk_by(goes_on)
            .map(|drive| drive.iter().map(|&(second, place_m)| (second as f64, place_m)).collect())
            .collect::<Vec<Vec<(f64, f64)>>>()
    });
    Ok(drives.collect())
}
