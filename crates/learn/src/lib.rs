//! Learning: Algorithms 1 to 3 of the paper, PPO, the influence predictors and the policies.
//!
//! Nothing here knows a file, a process, SUMO or a domain by name.
//!
//! - [`config`]: the settings of learning.
//! - [`training`]: Algorithms 1 to 3 and PPO.
//! - [`influence`]: what predicts the influence on a local region.
//! - [`policy`]: policies, how they draw actions, and the memory that they learn from.
//! - [`evaluation`]: evaluation episodes on the global simulator, and their figures.

pub mod algorithms;
pub mod config;
pub mod evaluation;
pub mod influence;
pub mod policy;
pub mod steps;
pub mod training;
pub mod worker;
