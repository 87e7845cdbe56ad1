//! The program.

use dials_session::machine::{Allocator, end_now};

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

fn main() {
    end_now(dials_cli::main())
}
