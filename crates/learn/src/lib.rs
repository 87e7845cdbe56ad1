//! Learning: Algorithms 1 to 3 of the paper, its predictors and policies, PPO and other algorithms.
//!
//! The global simulator (GS) simulates the whole system. Local simulators (LS) simulate one region each, driven by
//! approximate influence predictors (AIPs); both together are the influence-augmented local simulators (IALS). Nothing
//! here knows a file, a process, SUMO or a domain by name.
//!
//! - [`dials`]: Algorithm 1, the whole training on one screen. [`progress`]: how far it has come.
//! - [`steps`]: what workers do in it, step by step. [`steps::collect`] is Algorithm 2, datasets from the GS.
//! - [`fleet`]: the workers, as a trait. [`worker`]: one of them, with the networks of its agents.
//! - [`environments`]: what agents act in. [`environments::ials`] is Algorithm 3; the GS plays the same role.
//! - [`algorithms`]: PPO and DQN; imitation of a controller; averaging of policies.
//! - [`predictors`]: what predicts the influence on a local region.
//! - [`policy`]: policies, and how they draw actions. [`evaluation`]: evaluation episodes on the GS, and their figures.
//! - [`state`]: the state of agents between two periods, and whether a state fits a config.
//! - [`observer`]: who watches the progress. [`config`]: the settings of learning.

pub mod algorithms;
pub mod config;
pub mod dials;
pub mod environments;
pub mod evaluation;
#[cfg(test)]
mod fixtures;
pub mod fleet;
pub mod observer;
mod pace;
pub mod policy;
pub mod predictors;
pub mod progress;
mod side_by_side;
pub mod state;
pub mod steps;
pub mod worker;
