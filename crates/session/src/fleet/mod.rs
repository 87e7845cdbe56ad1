//! The fleet: workers, each with a share of the agents, in this process or in others.
//!
//! libsumo holds one simulation per process, so local simulators run in parallel in processes of their own. The
//! [`Coordinator`] gives orders through the two-way streams of a [`link::Crew`]; [`serve()`] is the worker's side. The
//! crew decides what the loss of a worker means. A worker that can be replaced is started again with the state of the
//! last exchange and gets its order again, so the run ends with the same numbers. Nothing that a worker does or fails
//! to do blocks the coordinator, and one clock measures its patience.
//!
//! - [`worker`]: a share of the agents for the whole run, and the work that can be ordered. `telling`: how it speaks
//!   during long episodes.
//! - [`inline`]: the smallest fleet, one worker in this process.
//! - `coordinator`: orders, deaths and patience. `shares`: which worker owns which agents. `orders`: the steps of
//!   Algorithm 1 as orders to workers. `task`: an order in progress. `expected`: what a worker may say. `loss`: why it is
//!   given up.
//! - [`link`]: the worker's stream as the coordinator sees it. [`children`]: child processes; `bell` wakes the
//!   coordinator, `log` is what a worker printed.
//! - `mpi`: workers on the ranks of an MPI job, with the feature of that name. `launcher`: whether there is such a job.
//! - `message`, `channel`: the messages, and how they are written to a stream. `serve`: the worker's side of it.
//! - `footprint`: memory and CPU time of this process. `growth`: when a worker's process is replaced by a fresh one.
//! - `threads`: a crew of threads, with which the tests kill and hang workers.
//!
//! Only `run` opens this room. Training knows it as a [`Fleet`](dials_learn::training::fleet::Fleet).

mod bell;
mod channel;
pub mod children;
mod coordinator;
mod expected;
mod footprint;
mod growth;
pub mod inline;
mod launcher;
pub mod link;
mod log;
mod loss;
mod message;
#[cfg(feature = "mpi")]
mod mpi;
mod orders;
mod serve;
mod shares;
mod task;
mod telling;
#[cfg(test)]
mod threads;
pub mod worker;

// The ends of the channel, for tests that send nonsense through it.
#[cfg(feature = "mpi")]
pub use self::mpi::{End, Job, Part, Prepared, Ranks, Relay, join_the_job};
#[doc(hidden)]
pub use channel::{encode, receive};
pub use coordinator::{Coordinator, Options};
pub use growth::MostGrowth;
pub use launcher::ranks;
pub use log::Log;
pub use message::WorkerReport;
#[doc(hidden)]
pub use message::{Answer, Order};
pub use serve::serve;
pub use shares::agents_of_workers;
