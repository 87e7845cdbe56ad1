//! Learning: Algorithms 1 to 3 of the paper and PPO.
//!
//! - [`dials`]: Algorithm 1, the whole training on one screen.
//! - [`collect`]: Algorithm 2, datasets from the GS.
//! - [`ials`]: Algorithm 3, trajectories from local simulators and AIPs; [`global`] is the GS in the same role.
//! - [`environment`]: what both are to a learning agent. [`timed`]: simulators that tell how long their calls took.
//! - [`rollout`], [`gae`], [`ppo`]: what an agent makes of its trajectories.
//! - [`block`]: a share of the agents with their networks. [`state`]: what agents have become. [`answers`]: what work brings.
//! - [`fleet`]: who does the work. This room never sees a process, a socket or SUMO.
//! - [`journal`], [`observer`]: who hears of it. This room never sees a file.
//! - [`standing`], [`drift`]: how Algorithm 1 goes on, and whether AIPs have to be trained again.
//! - [`stream`]: what goes on from one period to the next, so that looking at training leaves no trace in it.

pub mod answers;
pub mod block;
pub mod collect;
pub mod dials;
pub mod drift;
pub mod environment;
pub mod fleet;
pub mod gae;
pub mod global;
pub mod ials;
pub mod journal;
pub mod observer;
pub mod ppo;
pub mod rollout;
pub mod standing;
pub mod state;
pub mod stream;
pub mod timed;
