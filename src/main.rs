//! The program.

#![allow(unsafe_code, reason = "a variable of the environment can be set while there is one thread")]

use dials_session::machine::{Allocator, end_now};

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

/// The number of threads of OpenBLAS, which SUMO's libraries bring along. It would start one for each core in every process, and
/// nothing here ever uses them.
const THREADS_OF_BLAS: (&str, &str) = ("OPENBLAS_NUM_THREADS", "1");

fn main() {
    let (variable, threads) = THREADS_OF_BLAS;
    // SAFETY: this process has no other thread yet, so nobody reads the environment. Its children inherit it.
    unsafe { std::env::set_var(variable, threads) };
    end_now(dials_cli::main())
}
