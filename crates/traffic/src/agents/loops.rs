//! The detectors that an agent sees: those of the event log, in the order of its approaches.

use super::region_plan::Approach;
use crate::events::detectors::Places;
use crate::events::site::DetectorPlace;

/// Length of road that a car of a usual type is over, in metres.
const CAR_M: f64 = 5.0;

/// A detector of an approach that ends at its stop line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Loop {
    /// Index into the approaches of the region.
    pub(crate) approach: usize,
    pub(crate) place: DetectorPlace,
    /// Its beginning, in metres from the lane's beginning.
    pub(crate) begin_m: f64,
    /// A car is over it while its front is between the beginning and this place.
    pub(crate) end_m: f64,
}

impl Loop {
    /// Returns the detectors of a region, the one at the stop line first on each lane.
    pub(crate) fn of(approaches: &[Approach]) -> Vec<Loop> {
        let at_stop_line = approaches.iter().enumerate().filter(|(_, approach)| approach.ahead_m == 0.0);
        let of_lane = |(number, lane): (usize, &Approach)| {
            let Places { stop_bar_m, advance_m } = Places::on(lane.length_m);
            let detector = |place, begin_m, end_m| Loop { approach: number, place, begin_m, end_m };
            let advance = advance_m.map(|begin_m| detector(DetectorPlace::Advance, begin_m, begin_m + CAR_M));
            [detector(DetectorPlace::StopBar, stop_bar_m, f64::INFINITY)].into_iter().chain(advance)
        };
        at_stop_line.flat_map(of_lane).collect()
    }

    pub(crate) fn name(&self, approaches: &[Approach]) -> String {
        let place = match self.place {
            DetectorPlace::StopBar => "stop bar",
            DetectorPlace::Advance => "advance",
        };
        format!("{place} {}", approaches[self.approach].lane)
    }
}
