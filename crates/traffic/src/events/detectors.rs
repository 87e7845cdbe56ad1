//! Where detectors are in a lane that ends at a stop line. The same ones are in the event log and in observations.

/// Length of the detector at the stop line, in metres: a loop of 40 feet, long enough to be on without a break while a
/// queue leaves. Source: FHWA, Traffic Detector Handbook, 3rd edition, "long loops" of 6 by 40 ft.
pub const STOP_BAR_M: f64 = 12.0;

/// Distance from the stop line to the advance detector, in metres: 4 s at 15 m/s.
pub const ADVANCE_M: f64 = 60.0;

/// Least distance of an advance detector from the beginning of its lane, in metres. SUMO puts cars on lanes there.
const FROM_BEGIN_M: f64 = 1.0;

/// Least distance between the two detectors of a lane, in metres: that of a car.
const APART_M: f64 = 8.0;

/// Places of the detectors of a lane, in metres from its beginning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Places {
    /// Beginning of the detector that ends at the stop line.
    pub stop_bar_m: f64,
    /// The line of the advance detector. `None`: the lane is too short for one.
    pub advance_m: Option<f64>,
}

impl Places {
    /// Returns the places on a lane of this length. On a lane shorter than [`ADVANCE_M`] the advance detector is where
    /// the lane begins.
    pub fn on(length_m: f64) -> Places {
        let stop_bar_m = (length_m - STOP_BAR_M).max(0.0);
        let advance_m = (length_m - ADVANCE_M).max(FROM_BEGIN_M);
        Places { stop_bar_m, advance_m: (stop_bar_m - advance_m >= APART_M).then_some(advance_m) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_lane_has_its_advance_detector_where_it_begins_or_none() {
        let places = |length_m| {
            let Places { stop_bar_m, advance_m } = Places::on(length_m);
            (stop_bar_m, advance_m)
        };
        assert_eq!(places(100.0), (88.0, Some(40.0)));
        assert_eq!(places(30.0), (18.0, Some(1.0)));
        assert_eq!(places(20.0), (8.0, None), "7 m apart");
        assert_eq!(places(5.0), (0.0, None));
    }
}
