//! From crossings of loops to the times at which a detector is on: while at least one car is over it.
//!
//! A detector at the stop line has two loops, where it begins and at the stop line. A car is over it from when its
//! front crosses the first one until its rear has crossed the second one. Cars that change lanes in between cross only
//! one of them, so the lanes are also read at the end of every second.

use std::collections::HashSet;

use libsumo::CarId;

/// What happens at a detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Passage {
    /// The front of a car crosses its beginning.
    Comes(CarId),
    /// The front of a car crosses its end.
    Passes(CarId),
    /// The rear of a car leaves its end.
    Leaves(CarId),
    /// A read finds a car on it that was not on it in the read before.
    Found(CarId),
    /// A read no longer finds the front of a car on it.
    Lost(CarId),
    /// A car ends its trip, or is taken off the road.
    Gone(CarId),
}

/// The cars over one detector.
#[derive(Debug, Default)]
pub(super) struct Presence {
    over: HashSet<CarId>,
    /// Cars whose fronts have crossed the end.
    passing: HashSet<CarId>,
}

impl Presence {
    /// Notes what happens next. Returns whether the detector is now on, if that has changed.
    pub(super) fn note(&mut self, passage: Passage) -> Option<bool> {
        let was_on = !self.over.is_empty();
        match passage {
            Passage::Comes(car) | Passage::Found(car) => {
                self.over.insert(car);
            }
            Passage::Passes(car) => {
                self.over.insert(car);
                self.passing.insert(car);
            }
            // Its rear is still over the detector.
            Passage::Lost(car) if self.passing.contains(&car) => {}
            Passage::Leaves(car) | Passage::Lost(car) | Passage::Gone(car) => {
                self.over.remove(&car);
                self.passing.remove(&car);
            }
        }
        let is_on = !self.over.is_empty();
        (is_on != was_on).then_some(is_on)
    }

    pub(super) fn is_on(&self) -> bool {
        !self.over.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::Passage::{Comes, Found, Gone, Leaves, Lost, Passes};
    use super::*;

    fn changes(passages: &[fn(CarId) -> Passage]) -> Vec<Option<bool>> {
        let mut presence = Presence::default();
        passages.iter().map(|passage| presence.note(passage(CarId(7)))).collect()
    }

    #[test]
    fn a_car_is_over_the_detector_until_its_rear_has_left() {
        let (on, off) = (Some(true), Some(false));
        assert_eq!(changes(&[Comes, Found, Passes, Lost, Leaves]), [on, None, None, None, off]);
        // It changes to another lane.
        assert_eq!(changes(&[Comes, Found, Lost]), [on, None, off]);
        // It comes from another lane.
        assert_eq!(changes(&[Found, Passes, Lost, Leaves]), [on, None, None, off]);
        // It teleports.
        assert_eq!(changes(&[Comes, Passes, Gone, Lost]), [on, None, off, None]);
    }

    #[test]
    fn a_second_car_keeps_the_detector_on() {
        let mut presence = Presence::default();
        let all = [Comes(CarId(1)), Comes(CarId(2)), Leaves(CarId(1)), Leaves(CarId(2))];
        assert_eq!(all.map(|passage| presence.note(passage)), [Some(true), None, None, Some(false)]);
    }
}
