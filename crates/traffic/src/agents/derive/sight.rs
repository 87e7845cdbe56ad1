//! What the agent of a light sees.

use super::{CarsSeen, Rules};
use crate::agents::region::CELL_M;
use crate::agents::region_plan::RegionPlan;
use crate::agents::sensor::{CarColumns, LightColumns, Sensor};
use crate::config::DSet;

/// Makes the sensor of an agent: cars up to `approach_m` before the stop line, and a light with this number of greens.
pub(super) fn sensor(region: &RegionPlan, rules: &Rules, greens: usize) -> Sensor {
    let cells = region.approaches.iter().map(|approach| {
        let seen_m = approach.length_m.min(rules.approach_m - approach.ahead_m);
        (seen_m / CELL_M).ceil() as usize
    });
    let cars = match rules.cars {
        CarsSeen::Cells => CarColumns::Cells(cells.collect()),
        CarsSeen::Queues => CarColumns::QueueAndDensity(region.approaches.len()),
    };
    Sensor { cars, light: LightColumns::TargetAndAge(greens), clock: 0, clock_ahead: 0, d_set: DSet::Cells }
}
