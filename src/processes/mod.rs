//! Worker processes: child processes of the same program, each with a share of the agents.
//!
//! libsumo holds one simulation per process, so local simulators run in parallel in processes of their own. The
//! [`ProcessFleet`] of the coordinator speaks with them through a socket that is their standard input, in the
//! messages of this room; [`serve`] is the worker's side. A worker that is lost is started again with the state of
//! the last exchange and given its order again, so that a run ends with the same numbers. Nothing that a worker does or
//! fails to do blocks the coordinator: threads write and read for it, and one patience clock covers both.
//!
//! Only `run` opens this room. Training knows it as a [`Fleet`](crate::training::fleet::Fleet).

mod channel;
mod child;
mod fleet;
mod log_tail;
mod message;
mod worker;

pub use fleet::{Options, ProcessFleet};
pub use worker::serve;
