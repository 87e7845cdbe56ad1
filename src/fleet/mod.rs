//! Who does the work: workers, each with a share of the agents, in this process or in others.
//!
//! libsumo holds one simulation per process, so local simulators run in parallel in processes of their own. The
//! [`Coordinator`] gives them orders through the two-way streams of a [`link::Crew`]; [`serve()`] is the worker's side.
//! What the loss of a worker means is for the crew to say. One that can be replaced is started again with the state of
//! the last exchange and given its order again, so that a run ends with the same numbers. Nothing that a worker does
//! or fails to do blocks the coordinator, and one patience clock covers both.
//!
//! - [`worker`]: a share of the agents for the whole run, and what can be asked of it.
//! - [`inline`]: the smallest fleet, one worker in this process.
//! - `coordinator`: who owns whom, orders, deaths and patience. `orders`: what Algorithm 1 asks, as orders to workers.
//!   `task`: an order under way.
//! - [`link`]: the worker's stream as the coordinator sees it. [`children`]: child processes; `bell` wakes the
//!   coordinator, `log_tail` shows the end of a log.
//! - `message`, `channel`: what is said, and how it is written on a stream. `serve`: the worker's side of it.
//! - `footprint`: memory and CPU time of this process.
//! - `threads`: a crew of threads, with which the tests kill and hang workers.
//!
//! Only `run` opens this room. Training knows it as a [`Fleet`](crate::training::fleet::Fleet).

mod bell;
mod channel;
pub mod children;
mod coordinator;
mod footprint;
pub mod inline;
pub mod link;
mod log_tail;
mod message;
mod orders;
mod serve;
mod task;
#[cfg(test)]
mod threads;
pub mod worker;

pub use coordinator::{Coordinator, Options};
pub use message::Report;
pub use serve::serve;
