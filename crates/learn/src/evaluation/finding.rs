//! A player and the episodes that it played.

use serde_json::Value;

use super::EpisodeReport;
use crate::policy::Selection;
use dials_core::base::statistics::Interval;

/// A controller or policies, with their name in tables and files.
#[derive(Clone, Debug, PartialEq)]
pub struct Player {
    pub label: String,
    /// Keys and values that identify the player in JSON.
    pub keys: Vec<(&'static str, Value)>,
    /// How its policies choose actions; `None` for a controller.
    pub policies: Option<Selection>,
    /// Which agents follow them and what the others do, in words; `None`: all agents do.
    pub others: Option<String>,
}

/// A player and its episodes. All players of a command play the same episodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    pub player: Player,
    pub episodes: Vec<EpisodeReport>,
}

impl Finding {
    /// Returns the mean return of one agent, with its 95 % interval.
    pub(crate) fn of_agent(&self, agent: usize) -> Interval {
        Interval::of(&self.episodes.iter().map(|episode| episode.returns[agent]).collect::<Vec<_>>())
    }
}
