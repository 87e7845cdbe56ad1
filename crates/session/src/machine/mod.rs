//! The limits of the machine, and the way out when one of them is reached.
//!
//! - `allocator`: memory that the system refuses ends the process with an error, not with an abort.
//! - `limits`: limits of processes, and how much memory and disk is free.
//! - `signals`: a file that reaches its limit is an error of the write, not the death of the process. A rank of an MPI
//!   job leaves Ctrl-C to rank 0.
//! - `way_out`: what a person can do about an error of the system, and why a process aborted.

mod allocator;
mod limits;
mod signals;
mod way_out;

pub use allocator::Allocator;
pub(crate) use limits::kib_in;
pub use limits::{allow_open_files, free_disk_mib, free_memory_mib, limit_cpu, limit_memory};
pub use signals::{end_now, leave_signals_to_another, survive_full_files};
pub use way_out::{note_option_for_processes, ran_out_of_memory, way_out, why_aborted};
