//! Learning: Algorithms 1 to 3 of the paper and PPO.
//!
//! - [`dials`]: Algorithm 1, the whole training on one screen.
//! - [`collect`]: Algorithm 2, datasets from the GS.
//! - [`ials`]: Algorithm 3, trajectories from local simulators and AIPs; [`global`] is the GS in the same role.
//! - [`timed`]: simulators that tell how long their calls took.
//! - [`rollout`], [`gae`], [`ppo`]: what an agent makes of its trajectories.
//! - [`fleet`], [`worker`], [`block`]: who does it. This room never sees a process, a socket or SUMO.
//! - [`drift`]: whether AIPs have to be trained again.
//! - [`stream`]: what goes on from one period to the next, so that looking at training leaves no trace in it.
//! - [`run_log`], [`checkpoint`], [`joint_layout`], [`state`]: what a run leaves behind, and how it goes on from there.

pub mod answers;
pub mod block;
pub mod checkpoint;
pub mod collect;
pub mod dials;
pub mod drift;
pub mod environment;
mod events;
pub mod files;
mod finite;
pub mod fleet;
pub mod footprint;
pub mod gae;
pub mod global;
pub mod ials;
pub mod inline;
pub mod joint_layout;
pub mod observer;
pub mod ppo;
pub mod rollout;
pub mod run_log;
pub mod state;
pub mod stream;
pub mod tables;
pub mod timed;
pub mod worker;
