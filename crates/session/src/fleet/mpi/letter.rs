//! Letters between ranks. A letter is short. A frame, which may be long, can come with it.

use serde::{Deserialize, Serialize};

/// Number of a rank, as MPI counts.
pub(super) type Rank = i32;

/// What a rank says to another.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Letter {
    /// To a relay: prepare for the run that the frame describes, a [`Luggage`](super::luggage::Luggage).
    Prepare,
    /// To a relay: start this worker.
    Start { worker: usize },
    /// To a relay: the frame is for these workers, as far as they are yours.
    Deliver { workers: Vec<usize> },
    /// To a relay: end your workers, answer with [`Letter::Ended`] and end.
    End,
    /// To rank 0: prepared. `build`: what computes there. `lifeline`: why there is no connection for it, if so.
    Prepared { host: String, build: String, lifeline: Option<String> },
    /// To rank 0: this machine cannot take part, for this reason.
    Unable { host: String, reason: String },
    /// To rank 0: the frame is a report of this worker.
    Said { worker: usize },
    /// To rank 0: this worker has ended in this way.
    Lost { worker: usize, how: String },
    /// To rank 0: what this worker printed.
    Printed { worker: usize, bytes: Vec<u8> },
    /// To rank 0: nothing comes after this.
    Ended,
}

/// A letter on its way, with what the receiver must know of its frame.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Envelope {
    pub(crate) letter: Letter,
    pub(crate) frame: Option<Enclosed>,
}

/// How a frame comes with its letter.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Enclosed {
    /// Number of bytes.
    pub(crate) length: usize,
    /// Ranks that receive it together in one broadcast of rank 0, which is the first of them. `None`: it comes right
    /// after the letter.
    pub(crate) together: Option<Vec<Rank>>,
}
