//! Influence sources on the GS: arrivals at the approaches of a grid, and arrivals and blocked exits of a region of a
//! scenario, remembered for the d-set on either simulator.

use super::agents::border_plan::{BLOCK_M, BLOCK_MPS, BorderPlan};
use libsumo::LaneCars;

pub(crate) const REMEMBERED_S: usize = 60;

/// Returns whether a car entered a lane of a grid between two reads. A car that has just entered is the rearmost on its
/// lane: cars leave in the order in which they came, and a second one does not fit in behind it within a second.
pub(crate) fn has_arrival(now: LaneCars<'_>, before: LaneCars<'_>) -> bool {
    now.ids.first().is_some_and(|car| before.ids.first() != Some(car))
}

/// Counts the influence sources of a decision on a scenario, second by second.
#[derive(Clone, Debug)]
pub(crate) struct SourceCounter {
    /// Cars per entry that have arrived and do not count yet, because one a second counts.
    pub(crate) arrived: Vec<u32>,
    /// Whether each exit was blocked in each part of this decision, as the sources have it.
    pub(crate) blocked: Vec<bool>,
}

impl SourceCounter {
    pub(crate) fn new(plan: &BorderPlan) -> SourceCounter {
        SourceCounter { arrived: vec![0; plan.entries.len()], blocked: vec![false; plan.all_blocked().len()] }
    }

    /// Writes what counts in this second into the `sources` of its decision, which begin with zeros.
    pub(crate) fn end_second(&mut self, plan: &BorderPlan, second: usize, sources: &mut [u8]) {
        for (entry, arrived) in self.arrived.iter_mut().enumerate().filter(|(_, arrived)| **arrived > 0) {
            *arrived -= 1;
            sources[plan.arrival(entry, second)] = 1;
        }
        if second + 1 == plan.decision_s {
            for (source, blocked) in sources[plan.all_blocked()].iter_mut().zip(&mut self.blocked) {
                *source = u8::from(std::mem::take(blocked));
            }
        }
    }
}

/// Returns whether the first car of a lane of this length is near its end and slow.
pub(crate) fn is_blocked(lane: LaneCars<'_>, length_m: f64) -> bool {
    let first = lane.positions_m.last().zip(lane.speeds_mps.last());
    first.is_some_and(|(position_m, speed_mps)| *speed_mps < BLOCK_MPS && length_m - position_m <= BLOCK_M)
}

/// The influence sources of the last minute, as the d-set shows them.
#[derive(Clone, Debug, Default)]
pub(crate) struct History {
    /// A bit per second and entry: did a car arrive? The lowest bit is the last second.
    arrivals: Vec<u64>,
    pub(crate) blocked: Vec<bool>,
}

impl History {
    pub(crate) fn new(plan: &BorderPlan) -> History {
        History { arrivals: vec![0; plan.entries.len()], blocked: vec![false; plan.exits.len()] }
    }

    pub(crate) fn note(&mut self, plan: &BorderPlan, sources: &[u8]) {
        for (entry, bits) in self.arrivals.iter_mut().enumerate() {
            for second in 0..plan.decision_s {
                *bits = *bits << 1 | u64::from(sources[plan.arrival(entry, second)]);
            }
        }
        for (exit, blocked) in self.blocked.iter_mut().enumerate() {
            *blocked = sources[plan.blocked(exit, plan.parts() - 1)] == 1;
        }
    }

    /// Returns the number of arrivals at an entry in the last seconds, at most [`REMEMBERED_S`].
    pub(crate) fn arrivals(&self, entry: usize, seconds: usize) -> u32 {
        (self.arrivals[entry] & ((1 << seconds.min(REMEMBERED_S)) - 1)).count_ones()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::border_plan::{Entry, EntryPlace};

    fn plan(entries: usize, exits: usize) -> BorderPlan {
        let entry = |lane| Entry { place: EntryPlace::Lane(lane), default_way: Vec::new() };
        BorderPlan {
            roads: Vec::new(),
            lanes: Vec::new(),
            entries: (0..entries).map(entry).collect(),
            exits: (0..exits).collect(),
            exit_signals: vec![Vec::new(); exits],
            decision_s: 3,
        }
    }

    #[test]
    fn a_second_car_in_a_second_counts_in_the_next_one_even_of_the_next_decision() {
        let plan = plan(2, 0);
        let mut counter = SourceCounter::new(&plan);
        let mut decision = |arrivals: [[u32; 2]; 3]| {
            let mut sources = [0; 6];
            for (second, arrivals) in arrivals.into_iter().enumerate() {
                (0..2).for_each(|entry| counter.arrived[entry] += arrivals[entry]);
                counter.end_second(&plan, second, &mut sources);
            }
            sources
        };
        assert_eq!(decision([[2, 0], [0, 0], [3, 1]]), [1, 1, 1, 0, 0, 1]);
        assert_eq!(decision([[0, 0]; 3]), [1, 1, 0, 0, 0, 0], "two of the three are left");
        assert_eq!(decision([[0, 0]; 3]), [0; 6]);
    }

    #[test]
    fn the_history_counts_seconds_back_from_now() {
        let plan = plan(1, 1);
        let mut history = History::new(&plan);
        history.note(&plan, &[1, 0, 1, 1, 1]);
        history.note(&plan, &[0, 1, 0, 1, 0]);
        let counts: Vec<u32> = [1, 2, 3, 4, 6, 60, 300].map(|seconds| history.arrivals(0, seconds)).into();
        assert_eq!(counts, [0, 1, 1, 2, 3, 3, 3]);
        assert!(!history.blocked[0]);
        (0..19).for_each(|_| history.note(&plan, &[0, 0, 0, 0, 1]));
        let now = (history.arrivals(0, 60), history.blocked[0]);
        assert_eq!(now, (1, true), "57 s later only the fifth second is left");
    }
}
