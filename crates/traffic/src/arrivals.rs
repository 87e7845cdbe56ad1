//! Arrivals: the cars that entered a lane in a step, found by their ids.
//!
//! A car that has just entered is the rearmost on its lane. Cars leave in the order in which they came, and a second
//! car does not fit in behind it within a second.

use super::cars_at::CarsAt;
use libsumo::LaneCars;

/// Returns whether a car entered the lane between two reads.
pub(crate) fn has_arrival(now: LaneCars<'_>, before: LaneCars<'_>) -> bool {
    now.ids.first().is_some_and(|car| before.ids.first() != Some(car))
}

/// Writes 1 for every lane that a car entered between two reads of one light's lanes, and leaves the others.
pub(crate) fn note(arrivals: &mut [u8], now: CarsAt<'_>, before: CarsAt<'_>) {
    for (arrived, (now, before)) in arrivals.iter_mut().zip(now.iter().zip(before.iter())) {
        *arrived |= u8::from(has_arrival(now, before));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use libsumo::CarId;

    fn lane(ids: &[CarId]) -> LaneCars<'_> {
        const NUMBERS: [f64; 3] = [0.0; 3];
        LaneCars { ids, positions_m: &NUMBERS[..ids.len()], speeds_mps: &NUMBERS[..ids.len()] }
    }

    #[test]
    fn a_new_rearmost_car_is_an_arrival_and_a_car_that_left_is_none() {
        let [first, second, third] = [CarId(1), CarId(2), CarId(3)];
        assert!(has_arrival(lane(&[first]), lane(&[])));
        assert!(has_arrival(lane(&[third, second]), lane(&[second, first])), "one came while another left");
        assert!(!has_arrival(lane(&[second]), lane(&[second, first])));
        assert!(!has_arrival(lane(&[]), lane(&[first])));
    }
}
