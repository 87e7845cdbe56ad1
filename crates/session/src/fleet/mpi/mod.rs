//! Workers on the ranks of an MPI job, which may be on other machines.
//!
//! Rank 0 is the coordinator: `ranks` is its crew. Every other rank runs a `relay`, which starts worker processes on
//! its machine and passes frames between them and rank 0. So `serve` is the same as for child processes, a worker that
//! dies is a message and not the end of its rank, and a rank always listens, however busy its workers are.
//!
//! - `post`: letters between ranks, and the one thread that makes all calls of MPI.
//! - `shared_files`: the config and the networks, which rank 0 sends to the relays: they need no shared file system.
//! - `watch`: a connection from every relay to rank 0 whose end is the death of a rank, because MPI itself does not
//!   report that.

mod post;
mod ranks;
mod relay;
mod shared_files;
mod watch;

use anyhow::{Result, ensure};

use post::Post;
pub use ranks::{Job, Prepared, Ranks};
pub use relay::{End, Relay};

/// What this process is in its MPI job.
pub enum Part {
    /// Rank 0.
    Coordinator(Ranks),
    /// Any other rank.
    Relay(Relay),
}

pub fn join_the_job() -> Result<Part> {
    let post = Post::open()?;
    ensure!(
        post.ranks > 1,
        "the launcher started several ranks, but MPI knows one: this program was built for another MPI library than that \
         of the launcher"
    );
    Ok(match post.rank {
        0 => Part::Coordinator(Ranks::new(post)?),
        _ => Part::Relay(Relay(post)),
    })
}
