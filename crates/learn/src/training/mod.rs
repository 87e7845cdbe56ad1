//! Learning: Algorithms 1 to 3 of the paper, and PPO.
//!
//! The global simulator (GS) simulates the whole system. Local simulators (LS) simulate one region each, driven by the
//! approximate influence predictors (AIPs); both together are the influence-augmented local simulators (IALS).
//!
//! - [`dials`]: Algorithm 1, the whole training on one screen.
//! - [`imitation`]: policies that begin by imitating a hand-coded controller.
//! - [`collect`]: Algorithm 2, datasets from the GS.
//! - [`ials`]: Algorithm 3, trajectories from the IALS; [`global`]: the GS in the same role.
//! - [`environment`]: what a learning agent sees of either; [`timed`]: simulators whose calls are timed.
//! - [`rollout`], [`gae`], [`ppo`], [`ppo_loss`]: trajectories, their advantages, and the update of the policies.
//! - [`block`]: a share of the agents with their networks; [`state`]: the state of agents after a period; [`answers`]:
//!   results of the work.
//! - [`fleet`]: the workers, as a trait. This room never sees a process, a socket or SUMO.
//! - [`journal`], [`observer`]: those who watch the progress. This room never sees a file.
//! - [`averaging`]: agents that get the mean of their policies.
//! - [`standing`]: how far Algorithm 1 has come; [`drift`]: whether the AIPs must be trained again.
//! - [`fits`]: whether a state from a file or a worker is one of these agents under this config.
//! - [`stream`]: what continues from one period to the next, so that evaluations do not change the training.

pub mod answers;
pub mod block;
pub mod collect;
pub mod dials;
pub mod drift;
pub mod environment;
pub mod fits;
pub mod fleet;
pub(crate) mod global;
pub mod ials;
pub mod journal;
pub mod observer;
pub(crate) mod progress;
mod returns;
pub mod standing;
pub mod state;
pub mod stream;
pub(crate) mod timed;
