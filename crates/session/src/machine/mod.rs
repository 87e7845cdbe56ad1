//! The limits of the machine, and the way out when one of them is reached.
//!
//! - `aborts`: why a process of this program aborted, and whether its memory ran out.
//! - `allocator`: memory that the system refuses ends the process with an error, not with an abort.
//! - `memory`: a process that reads what may be endless gets a limit on its memory.
//! - `open_files`: the limit on open files is raised where a command needs many.
//! - `processes`: the option that says how many processes a command starts.
//! - `room`: how much memory and disk is free.
//! - `signals`: a file that reaches its limit is an error of the write, not the death of the process. A rank of an MPI
//!   job leaves Ctrl-C to rank 0.
//! - `way_out`: what a person can do about an error of the system.

mod aborts;
mod allocator;
mod memory;
mod open_files;
mod processes;
mod room;
mod signals;
mod way_out;

pub use aborts::{ran_out_of_memory, why_aborted};
pub use allocator::Allocator;
pub use memory::{limit_cpu, limit_memory};
pub use open_files::allow_open_files;
pub use processes::note_option_for_processes;
pub use room::{free_disk_mib, free_memory_mib};
pub use signals::{end_now, leave_signals_to_another, survive_full_files};
pub use way_out::way_out;
