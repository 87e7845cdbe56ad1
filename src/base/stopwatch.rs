//! Where the wall time goes, phase by phase.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

/// The phases of a run that `timing.csv` tells apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// Inside the simulator: insertion, step, reading (traffic: SUMO), while policies train.
    Simulation,
    /// Policy forward passes and sampling of actions while policies train.
    Acting,
    /// Sampling of influence sources from the AIPs while policies train.
    AipSampling,
    /// PPO updates.
    Learning,
    /// Algorithm 2: datasets from the GS.
    Collection,
    /// Training of the AIPs.
    AipTraining,
    /// Evaluation episodes on the GS.
    Evaluation,
}

impl Phase {
    pub const ALL: [Phase; 7] = [
        Phase::Simulation,
        Phase::Acting,
        Phase::AipSampling,
        Phase::Learning,
        Phase::Collection,
        Phase::AipTraining,
        Phase::Evaluation,
    ];

    /// The column of `timing.csv`.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Simulation => "simulation",
            Phase::Acting => "acting",
            Phase::AipSampling => "aip_sampling",
            Phase::Learning => "learning",
            Phase::Collection => "collection",
            Phase::AipTraining => "aip_training",
            Phase::Evaluation => "evaluation",
        }
    }
}

/// Adds up wall time per phase.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Stopwatch {
    spent: [Duration; Phase::ALL.len()],
}

impl Stopwatch {
    pub fn time<T>(&mut self, phase: Phase, work: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let result = work();
        self.spent[phase as usize] += begun.elapsed();
        result
    }

    pub fn add(&mut self, other: &Stopwatch) {
        for (mine, theirs) in self.spent.iter_mut().zip(other.spent) {
            *mine += theirs;
        }
    }

    pub fn spent(&self, phase: Phase) -> Duration {
        self.spent[phase as usize]
    }

    /// All phases together.
    pub fn total(&self) -> Duration {
        self.spent.iter().sum()
    }

    /// Reads all phases and starts again from zero.
    pub fn take(&mut self) -> Stopwatch {
        std::mem::take(self)
    }
}
