//! The limits of the machine, and the way out when one of them is reached.
//!
//! - `aborts`: why a process of this program aborted.
//! - `allocator`: memory that the system refuses ends the process with an error, not with an abort.
//! - `open_files`: the limit on open files is raised where a command needs many.
//! - `signals`: a file that reaches its limit is an error of the write, not the death of the process. A rank of an MPI
//!   job leaves Ctrl-C to rank 0.
//! - `way_out`: what a person can do about an error of the system.

mod aborts;
mod allocator;
mod open_files;
mod signals;
mod way_out;

pub use aborts::why_aborted;
pub use allocator::Allocator;
pub use open_files::allow_open_files;
pub use signals::{end_now, leave_signals_to_another, survive_full_files};
pub use way_out::way_out;
