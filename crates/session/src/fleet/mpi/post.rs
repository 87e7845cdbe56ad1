//! Letters between ranks, and the post of a rank: one thread that makes all calls of MPI, so that no other thread ever
//! waits for a rank.
//!
//! A letter is short. A frame, which may be long, can come with it. MPI has no way to wait for a letter without using a
//! whole core. So the thread looks for letters every millisecond while nothing happens, and all the time while something
//! is on its way.
//!
//! # Why not otherwise
//!
//! **Why one thread for all calls, and not each thread for itself?** MPI allows that only with `MPI_THREAD_MULTIPLE`.
//! Not every installation has it. With one thread, `MPI_THREAD_FUNNELED` is enough.
//!
//! **Why not collective calls (`MPI_Gather`) for the replies?** All ranks must take part. If one is lost, the others
//! wait for ever, and nobody can say for whom. With letters, rank 0 sees who is silent, and may end the job with a
//! reason.
//!
//! **Why not wait within MPI?** `MPI_Wait` turns in a loop on a core of its own, at the expense of the worker that is
//! to answer.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle, Thread};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use mpi::Threading;
use mpi::environment::processor_name;
use mpi::request::{LocalScope, Request, scope};
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;
use serde::{Deserialize, Serialize};

use crate::fleet::channel::{decode, encode};
use crate::fleet::link::Frame;

/// Interval at which the post looks for letters while nothing is on its way.
const LOOK: Duration = Duration::from_millis(1);
/// Number of bytes that may wait for being read. Beyond it, further ones wait where they come from, so that the answers
/// of all workers are never in the memory of rank 0 at once.
const MOST_WAITING: usize = 64 << 20;
/// Longest message, in bytes. MPI counts with 32 bits.
const LONGEST_PIECE: usize = 1 << 30;
/// Length of the pieces of a broadcast, which rank 0 must copy.
const BROADCAST_PIECE: usize = 16 << 20;
/// Tags of letters and of frames.
const LETTER: mpi::Tag = 1;
const FRAME: mpi::Tag = 2;

/// Number of a rank, as MPI counts.
pub(super) type Rank = i32;

#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Letter {
    /// To a relay: prepare for the run that the frame describes, [`SharedFiles`](super::shared_files::SharedFiles).
    Prepare,
    /// To a relay: start this worker.
    Start { worker: usize },
    /// To a relay: the frame is for these workers, as far as they are yours.
    Deliver { workers: Vec<usize> },
    /// To a relay: end your workers, answer with [`Letter::Ended`] and end.
    End,
    /// To rank 0: prepared. `build`: what computes there. `unwatched`: why there is no connection that would show a death.
    Prepared { host: String, build: String, unwatched: Option<String> },
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

/// How a frame comes with its letter: what the receiver must know to receive it.
#[derive(Debug, Serialize, Deserialize)]
struct Enclosed {
    length: usize,
    /// Ranks of the broadcast in which it comes, rank 0 first. `None`: it comes right after the letter.
    together: Option<Vec<Rank>>,
}

/// The post of this rank. Dropping it sends what was posted, and leaves the job. All ranks leave together.
pub(super) struct Post {
    pub(crate) rank: usize,
    pub(crate) ranks: usize,
    pub(crate) host: String,
    outbox: Option<Sender<Outgoing>>,
    inbox: Receiver<Received>,
    thread: Option<JoinHandle<()>>,
}

pub(super) struct Outgoing {
    pub(crate) to: Vec<Rank>,
    pub(crate) letter: Letter,
    pub(crate) frame: Option<Frame>,
    /// Whether rank 0 sends the frame in one broadcast.
    pub(crate) together: bool,
}

impl Outgoing {
    /// Returns the encoded envelope, and the group of a broadcast.
    fn envelope(&self) -> (Vec<u8>, Option<Vec<Rank>>) {
        let group = self.together.then(|| [&[0], &self.to[..]].concat());
        let frame = self.frame.as_ref().map(|frame| Enclosed { length: frame.len(), together: group.clone() });
        // Letters have no type that postcard cannot encode.
        let letter = encode(&(&self.letter, frame)).expect("a letter can be encoded");
        (letter, group)
    }
}

pub(super) struct Received {
    pub(crate) from: usize,
    pub(crate) letter: Letter,
    pub(crate) frame: Option<Parcel>,
}

/// A frame that waits for being read.
pub(super) struct Parcel {
    pub(crate) frame: Vec<u8>,
    length: usize,
    waiting: Arc<AtomicUsize>,
}

impl Drop for Parcel {
    fn drop(&mut self) {
        self.waiting.fetch_sub(self.length, Ordering::Relaxed);
    }
}

impl Post {
    /// Joins the job. Letters that come wake the thread that calls this.
    pub(super) fn open() -> Result<Post> {
        let reader = thread::current();
        let (outbox, outgoing) = channel();
        let (received, inbox) = channel();
        let (joined, who) = channel();
        let run = move || {
            let Some((universe, _)) = mpi::initialize_with_threading(Threading::Funneled) else { return };
            let world = universe.world();
            let host = processor_name().unwrap_or_default();
            let office = Office { outgoing, received, reader, groups: BTreeMap::new(), waiting: Arc::default() };
            // The receiver waits for this line.
            let _ = joined.send((world.rank() as usize, world.size() as usize, host));
            office.run(&world);
        };
        let thread = thread::Builder::new().name("mpi".to_owned()).spawn(run).context("cannot start the post")?;
        let (rank, ranks, host) = who.recv().map_err(|_| anyhow!("MPI was initialised before"))?;
        Ok(Post { rank, ranks, host, outbox: Some(outbox), inbox, thread: Some(thread) })
    }

    /// Posts a letter. Does not wait.
    pub(super) fn send(&self, outgoing: Outgoing) {
        // The post ends only when this is dropped.
        let _ = self.outbox.as_ref().expect("it is only taken at the end").send(outgoing);
    }

    /// Posts a letter to rank 0. Does not wait.
    pub(super) fn report(&self, letter: Letter, frame: Option<Frame>) {
        self.send(Outgoing { to: vec![0], letter, frame, together: false });
    }

    /// Returns the next letter; if there is none yet: `None`. Does not wait.
    pub(super) fn next(&self) -> Option<Received> {
        self.inbox.try_recv().ok()
    }

    /// Leaves the post as it is until the process ends, because another rank has gone and nobody can leave together.
    pub(super) fn abandon(mut self) {
        self.thread = None;
    }
}

impl Drop for Post {
    fn drop(&mut self) {
        drop(self.outbox.take());
        if let Some(thread) = self.thread.take() {
            // It panics only on what MPI cannot survive either.
            let _ = thread.join();
        }
    }
}

/// The thread's side of the post.
struct Office {
    outgoing: Receiver<Outgoing>,
    received: Sender<Received>,
    reader: Thread,
    /// Groups of ranks that have broadcast before.
    groups: BTreeMap<Vec<Rank>, SimpleCommunicator>,
    /// Number of bytes that wait for being read.
    waiting: Arc<AtomicUsize>,
}

impl Office {
    fn run(mut self, world: &SimpleCommunicator) {
        loop {
            let outgoing = self.outgoing.recv_timeout(LOOK);
            let last = matches!(outgoing, Err(RecvTimeoutError::Disconnected));
            if let Ok(outgoing) = outgoing {
                self.send_all(world, outgoing);
            }
            while self.receive(world) {}
            if last {
                return;
            }
        }
    }

    /// Sends all that is posted, and receives meanwhile, until nothing of this rank is on its way.
    fn send_all(&mut self, world: &SimpleCommunicator, first: Outgoing) {
        // MPI reads these until they are sent, so they must stay where they are.
        let batch: Vec<Outgoing> = std::iter::once(first).chain(self.outgoing.try_iter()).collect();
        let envelopes: Vec<(Vec<u8>, Option<Vec<Rank>>)> = batch.iter().map(Outgoing::envelope).collect();
        scope(|scope| {
            let mut open = Vec::new();
            for (outgoing, (envelope, group)) in batch.iter().zip(&envelopes) {
                for &rank in &outgoing.to {
                    open.push(world.process_at_rank(rank).immediate_send_with_tag(scope, &envelope[..], LETTER));
                }
                match (&outgoing.frame, group) {
                    (Some(frame), Some(group)) => self.broadcast(world, group.clone(), frame),
                    (Some(frame), None) => send_frame(world, &outgoing.to, frame, scope, &mut open),
                    (None, _) => {}
                }
            }
            while !open.is_empty() {
                let received = self.receive(world);
                open = open.into_iter().filter_map(|request: Request<'_, _, _>| request.test().err()).collect();
                if !open.is_empty() && !received {
                    thread::yield_now();
                }
            }
        });
    }

    /// Sends a frame from rank 0 to a group of ranks. Waits until this rank's part is done.
    fn broadcast(&mut self, world: &SimpleCommunicator, group: Vec<Rank>, frame: &[u8]) {
        let root = self.group(world, group).process_at_rank(0);
        // MPI does not promise to leave what it sends here unchanged.
        let mut copy = Vec::new();
        for piece in frame.chunks(BROADCAST_PIECE) {
            copy.clear();
            copy.extend_from_slice(piece);
            root.broadcast_into(&mut copy[..]);
        }
    }

    fn group(&mut self, world: &SimpleCommunicator, ranks: Vec<Rank>) -> &SimpleCommunicator {
        self.groups.entry(ranks).or_insert_with_key(|ranks| {
            let group = world.group().include(ranks);
            world.split_by_subgroup(&group).expect("this rank belongs to the group")
        })
    }

    /// Receives a letter with its frame. Returns whether there was one.
    fn receive(&mut self, world: &SimpleCommunicator) -> bool {
        if self.waiting.load(Ordering::Relaxed) >= MOST_WAITING {
            return false;
        }
        let Some(found) = world.any_process().immediate_matched_probe_with_tag(LETTER) else { return false };
        let (envelope, status) = found.matched_receive_vec::<u8>();
        let from = status.source_rank();
        let unreadable = |error| {
            let reason = format!("its letters cannot be read: {error:#}");
            (Letter::Unable { host: "a machine with another build".to_owned(), reason }, None)
        };
        let (letter, enclosed) = decode(&envelope).unwrap_or_else(unreadable);
        let frame = enclosed.map(|enclosed: Enclosed| {
            let mut frame = vec![0; enclosed.length];
            match enclosed.together {
                Some(group) => {
                    let root = self.group(world, group).process_at_rank(0);
                    frame.chunks_mut(BROADCAST_PIECE).for_each(|piece| root.broadcast_into(piece));
                }
                None => {
                    for piece in frame.chunks_mut(LONGEST_PIECE) {
                        world.process_at_rank(from).receive_into_with_tag(piece, FRAME);
                    }
                }
            }
            self.waiting.fetch_add(frame.len(), Ordering::Relaxed);
            Parcel { length: frame.len(), frame, waiting: self.waiting.clone() }
        });
        // If nobody reads any more, the letter is not needed.
        let _ = self.received.send(Received { from: from as usize, letter, frame });
        self.reader.unpark();
        true
    }
}

fn send_frame<'a, 'b>(
    world: &SimpleCommunicator,
    to: &[Rank],
    frame: &'a Frame,
    scope: &'b LocalScope<'a>,
    open: &mut Vec<Request<'a, [u8], &'b LocalScope<'a>>>,
) {
    for &rank in to {
        for piece in frame.chunks(LONGEST_PIECE) {
            open.push(world.process_at_rank(rank).immediate_send_with_tag(scope, piece, FRAME));
        }
    }
}
