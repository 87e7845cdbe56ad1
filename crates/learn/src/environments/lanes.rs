//! Lanes: environments that are played side by side. Nothing that happens in one depends on another one.
//!
//! # Why not otherwise
//!
//! **Why does a copy of the GS make many decisions before the next one has its turn?** One decision in each copy would let
//! all networks act on many rows at once. But the cars of a copy leave the cache while the others move. With 25 lights and 8
//! copies a step then took twice as long, and acting row by row costs a tenth of that.
//!
//! **Why does a thread wait for its copy, and not one thread for all of them?** A thread and the copy that it waits for take
//! turns on one core. One thread for all would often be woken on a core where a copy is at work, while another core is idle.

use super::Environment;
use crate::state::stream::{AgentStream, Part};
use dials_core::domain::Percept;
use stacknets::Threads;

/// Lanes, and where they are played.
pub(crate) enum Lanes<'a> {
    /// In this thread, one after the other.
    Here(Vec<Lane<dyn Environment + 'a>>),
    /// In these threads.
    Apart(Vec<Lane<dyn Environment + Send + 'a>>, Threads),
}

pub(crate) struct Lane<E: ?Sized> {
    /// Its rows, kind by kind.
    pub(crate) parts: Vec<Part>,
    pub(crate) environment: Box<E>,
}

impl Lanes<'_> {
    pub(crate) fn parts(&self) -> Vec<&[Part]> {
        match self {
            Lanes::Here(lanes) => lanes.iter().map(|lane| &lane.parts[..]).collect(),
            Lanes::Apart(lanes, _) => lanes.iter().map(|lane| &lane.parts[..]).collect(),
        }
    }

    /// Returns what every lane shows, kind by kind.
    pub(crate) fn percepts(&self) -> Vec<&[Percept]> {
        match self {
            Lanes::Here(lanes) => lanes.iter().map(|lane| lane.environment.percepts()).collect(),
            Lanes::Apart(lanes, _) => lanes.iter().map(|lane| lane.environment.percepts()).collect(),
        }
    }

    /// Ends all lanes: writes down how far their rows have come. Returns what their simulators counted, added up.
    pub(crate) fn leave(&mut self, streams: &mut [&mut [AgentStream]]) -> Vec<(String, u64)> {
        let environments: Vec<&mut dyn Environment> = match self {
            Lanes::Here(lanes) => lanes.iter_mut().map(|lane| &mut *lane.environment as _).collect(),
            Lanes::Apart(lanes, _) => lanes.iter_mut().map(|lane| &mut *lane.environment as _).collect(),
        };
        let mut counters: Vec<(String, u64)> = Vec::new();
        for environment in environments {
            environment.leave(streams);
            for (name, more) in environment.counters() {
                match counters.iter_mut().find(|(known, _)| *known == name) {
                    Some((_, count)) => *count += more,
                    None => counters.push((name, more)),
                }
            }
        }
        counters
    }

    /// Returns whether lanes are played at the same time.
    pub(crate) fn are_apart(&self) -> bool {
        matches!(self, Lanes::Apart(..))
    }

    /// Does `work` in every lane, with what is given to it. Returns the results in the order of the lanes.
    pub(crate) fn each<I: Send, T: Send>(
        &mut self,
        given: Vec<I>,
        work: impl Fn(&mut dyn Environment, I) -> T + Send + Sync,
    ) -> Vec<T> {
        match self {
            Lanes::Here(lanes) => {
                lanes.iter_mut().zip(given).map(|(lane, given)| work(&mut *lane.environment, given)).collect()
            }
            Lanes::Apart(lanes, threads) => {
                let items = lanes.iter_mut().zip(given).collect();
                threads
                    .map(items, 2, |_: &mut (), (lane, given): (&mut Lane<_>, I)| work(&mut *lane.environment, given))
            }
        }
    }
}
