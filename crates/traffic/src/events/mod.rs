//! The event log of the street: what a signal controller with loops in the road would write in an episode.
//!
//! Codes are those of the *Indiana Traffic Signal Hi Resolution Data Logger Enumerations* (Sturdevant et al., Indiana
//! Department of Transportation and Purdue University, 2012), which tools of signal engineers read.
//!
//! - `site`: the phases and detectors of each light, from its net. Pure.
//! - `phases`: from what lights show to events of phases. Pure.
//! - `presence`: from crossings of loops to times at which a detector is on. Pure.
//! - `loops`: the loops in SUMO, and what it writes about them.
//! - `recorder`: logs the episodes of a GS.
//! - `tables`: the log and its two tables as lines of CSV files.
//!
//! # Words
//! - *Phase*: the lanes of one road whose cars have green at the same times, whatever the light shows; or a crossing.
//!   SUMO's phases are called states here.
//! - *Detector*: a place of a lane that is on while a car is over it. *Loop*: a line across a lane, from which detectors
//!   are made.

pub mod detectors;
mod loops;
mod phases;
mod presence;
mod recorder;
pub mod site;
pub mod tables;

use std::sync::{Arc, Mutex, PoisonError};

pub(crate) use recorder::EventRecorder;

/// Codes of the enumerations.
pub mod code {
    pub const PHASE_BEGIN_GREEN: u16 = 1;
    pub const PHASE_GREEN_TERMINATION: u16 = 7;
    pub const PHASE_BEGIN_YELLOW: u16 = 8;
    pub const PHASE_END_YELLOW: u16 = 9;
    pub const PHASE_BEGIN_RED_CLEARANCE: u16 = 10;
    pub const PHASE_END_RED_CLEARANCE: u16 = 11;
    pub const PEDESTRIAN_BEGIN_WALK: u16 = 21;
    pub const PEDESTRIAN_BEGIN_CLEARANCE: u16 = 22;
    pub const PEDESTRIAN_BEGIN_DONT_WALK: u16 = 23;
    pub const DETECTOR_OFF: u16 = 81;
    pub const DETECTOR_ON: u16 = 82;
}

/// One line of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// Tenths of a second since midnight of the first day of the log. Times are rounded down, so that no car changes to
    /// the next state of its light.
    pub tenths: u64,
    /// Index of the light among the [`site::Site`]s.
    pub site: usize,
    pub code: u16,
    /// Number of the phase or of the detector.
    pub parameter: u16,
}

/// Takes the events of all episodes that simulators of a [`crate::Traffic`] play and measure. Clones are the same log.
#[derive(Clone, Debug, Default)]
pub struct EventLog(Arc<Mutex<Logged>>);

#[derive(Debug, Default)]
struct Logged {
    episodes: u64,
    events: Vec<Event>,
}

const DAY_S: u64 = 24 * 3600;

impl EventLog {
    /// Returns the events of the episodes that ended since the last call, in the order of time.
    pub fn take(&self) -> Vec<Event> {
        std::mem::take(&mut self.lock().events)
    }

    /// Adds the events of an episode that ended at second `end_s`. Each episode has a day of its own, or as many as it
    /// needs: so all begin at the same time of day, and follow each other.
    fn add(&self, events: Vec<Event>, end_s: u64) {
        let mut log = self.lock();
        let days = end_s / DAY_S + 1;
        let begin = 10 * DAY_S * days * log.episodes;
        log.episodes += 1;
        log.events.extend(events.into_iter().map(|event| Event { tenths: begin + event.tenths, ..event }));
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Logged> {
        // Each episode is added as a whole, so a panic elsewhere leaves no half of one.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_episode_has_days_of_its_own() {
        let event = Event { tenths: 252_000, site: 0, code: 1, parameter: 1 };
        let days = |end_s| {
            let log = EventLog::default();
            (0..3).for_each(|_| log.add(vec![event], end_s));
            log.take().iter().map(|event| (event.tenths - 252_000) / 864_000).collect::<Vec<_>>()
        };
        assert_eq!(days(28_800), [0, 1, 2]);
        // Its last events are at midnight.
        assert_eq!(days(86_400), [0, 2, 4]);
        // An episode until 1 a.m. of the next day.
        assert_eq!(days(90_000), [0, 2, 4]);
    }
}
