//! What the page and the process that plays for its map write to each other, one JSON object per line.

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// What is to be played: today's plan and the newest policies of the run.
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Wish {
    pub(super) episodes: usize,
}

#[derive(Debug, Deserialize, Serialize)]
pub(super) enum Said {
    /// An episode begins. `who`: `today's plan`, or the policies.
    Playing { who: String, episode: usize, of: usize },
    /// What was asked for. `steps`: timesteps per agent of the policies; `None`: there are no policies yet, or their file does
    /// not say. `city`: as in a `city.json`.
    City { steps: Option<u64>, city: Value },
    /// It could not be played.
    Failed(String),
}
