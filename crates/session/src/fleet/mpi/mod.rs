//! Workers on the ranks of an MPI job, which may be on other machines.
//!
//! Rank 0 is the coordinator: `ranks` is its crew. Every other rank runs a `relay`, which starts worker processes on
//! its machine and passes frames between them and rank 0. So `serve` is the same as for child processes, a worker that
//! dies is a message and not the end of its rank, and a rank always listens, however busy its workers are.
//!
//! - `post`: one thread that makes all calls of MPI, in both kinds of ranks. `kept`: what it is sending.
//! - `letter`: what ranks say to each other; a frame may come with a letter.
//! - `luggage`: the config and the networks on their way to the relays, which need no shared file system.
//! - `lifeline`: a connection from every relay to rank 0 whose end is the death of a rank, because MPI itself does not
//!   report that.
//! - `ranks`: the crew, on top of `desk`, what rank 0 knows of the others. `relay`: the other ranks.

mod desk;
mod kept;
mod letter;
mod lifeline;
mod luggage;
mod post;
mod ranks;
mod relay;

use anyhow::{Result, ensure};

use super::bell::Bell;
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

/// Joins the MPI job that this process was started in.
pub fn join_the_job() -> Result<Part> {
    let bell = Bell::new();
    let post = Post::open(bell.cord())?;
    ensure!(
        post.ranks > 1,
        "the launcher started several ranks, but MPI knows one: this program was built for another MPI library than that \
         of the launcher"
    );
    Ok(match post.rank {
        0 => Part::Coordinator(Ranks::new(post, bell)?),
        _ => Part::Relay(Relay::new(post, bell)),
    })
}
