//! The fleet: workers, each with a share of the agents, in this process or in others.
//!
//! libsumo holds one simulation per process, so local simulators run in parallel in processes of their own. The
//! [`Coordinator`] gives orders through the two-way streams of a [`link::Crew`]; [`serve()`] is the worker's side. The
//! crew decides what the loss of a worker means. A worker that can be replaced is started again with the state of the
//! last exchange and gets its order again, so the run ends with the same numbers. Nothing that a worker does or fails
//! to do blocks the coordinator, and one clock measures its patience.
//!
//! - `coordinator`: orders, deaths and patience. `shares`: which worker owns which agents. `task`: an order in progress.
//! - [`fn@in_process`]: the smallest crew, one worker in this process.
//! - [`link`]: the worker's stream as the coordinator sees it, and why a worker is given up. [`children`]: child
//!   processes; `log` is what they printed. [`copies`]: copies of the global simulator that a worker steps together.
//! - `mpi`: workers on the ranks of an MPI job, with the feature of that name. `launcher`: whether there is such a job.
//! - `message`, `channel`: the messages, and how they are written to a stream. `serve`: the worker's side of it.
//! - `process`: memory and CPU time of a process, and when a worker's is replaced by a fresh one.
//!
//! Only `run` opens this room. Training knows it as a [`Fleet`](dials_learn::fleet::Fleet).

pub mod apart;
mod channel;
pub mod children;
mod coordinator;
mod in_process;
mod launcher;
pub(crate) mod link;
mod log;
mod message;
#[cfg(feature = "mpi")]
mod mpi;
mod process;
mod serve;
mod shares;
mod task;
#[cfg(test)]
mod tests;

// The ends of the channel, for tests that send nonsense through it.
#[cfg(feature = "mpi")]
pub use self::mpi::{End, Job, Part, Prepared, Ranks, Relay, join_the_job};
#[doc(hidden)]
pub use channel::{encode, receive};
pub use coordinator::{Coordinator, Options};
pub use in_process::in_process;
pub use launcher::ranks;
pub use log::Log;
#[doc(hidden)]
pub use message::Order;
pub use message::WorkerReport;
pub use process::MostGrowth;
pub use serve::serve;
pub use shares::agents_of_workers;
