//! The post of a rank: one thread that makes all calls of MPI, so that no other thread ever waits for a rank.
//!
//! MPI has no way to wait for a letter without using a whole core. So the thread looks for letters every millisecond
//! while nothing happens, and all the time while something is on its way.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use mpi::Threading;
use mpi::environment::processor_name;
use mpi::request::{LocalScope, Request, scope};
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;

use super::kept::Kept;
use super::letter::{Enclosed, Envelope, Letter, Rank};
use crate::fleet::bell::Cord;
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
/// Tags that tell letters from frames.
const LETTER: mpi::Tag = 1;
const FRAME: mpi::Tag = 2;

/// The post of this rank. Dropping it sends what was posted, and leaves the job. All ranks leave together.
pub(super) struct Post {
    pub(crate) rank: usize,
    /// Number of ranks.
    pub(crate) ranks: usize,
    /// Name of the machine.
    pub(crate) host: String,
    outbox: Option<Sender<Outgoing>>,
    inbox: Receiver<Received>,
    thread: Option<JoinHandle<()>>,
}

/// A letter to other ranks.
pub(super) struct Outgoing {
    pub(crate) to: Vec<Rank>,
    pub(crate) letter: Letter,
    pub(crate) frame: Option<Frame>,
    /// Whether rank 0 sends the frame in one broadcast.
    pub(crate) together: bool,
}

/// A letter that has come.
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
    /// Joins the job. Letters that come ring the bell.
    pub(super) fn open(cord: Cord) -> Result<Post> {
        let (outbox, outgoing) = channel();
        let (received, inbox) = channel();
        let (joined, who) = channel();
        let run = move || {
            let Some((universe, _)) = mpi::initialize_with_threading(Threading::Funneled) else { return };
            let world = universe.world();
            let host = processor_name().unwrap_or_default();
            let office = Office { outgoing, received, cord, groups: BTreeMap::new(), waiting: Arc::default() };
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
    cord: Cord,
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
                self.send_until_all_is_sent(world, outgoing);
            }
            while self.receive(world) {}
            if last {
                return;
            }
        }
    }

    /// Sends, and receives meanwhile, until nothing of this rank is on its way.
    fn send_until_all_is_sent(&mut self, world: &SimpleCommunicator, first: Outgoing) {
        let kept = Kept::new(Frame::default());
        scope(|scope| {
            let (mut end, mut open, mut next) = (&kept, Vec::new(), Some(first));
            loop {
                while let Some(outgoing) = next {
                    end = self.send(world, outgoing, end, scope, &mut open);
                    next = self.outgoing.try_recv().ok();
                }
                let received = self.receive(world);
                open = open.into_iter().filter_map(|request: Request<'_, _, _>| request.test().err()).collect();
                if open.is_empty() {
                    break;
                }
                if !received {
                    thread::yield_now();
                }
                next = self.outgoing.try_recv().ok();
            }
        });
    }

    /// Begins to send a letter, and its frame if it has one. Returns the new end of the list.
    fn send<'a, 'b>(
        &mut self,
        world: &SimpleCommunicator,
        outgoing: Outgoing,
        end: &'a Kept,
        scope: &'b LocalScope<'a>,
        open: &mut Vec<Request<'a, [u8], &'b LocalScope<'a>>>,
    ) -> &'a Kept {
        let Outgoing { to, letter, frame, together } = outgoing;
        let group = together.then(|| [&[0], &to[..]].concat());
        let enclosed = frame.as_ref().map(|frame| Enclosed { length: frame.len(), together: group.clone() });
        let envelope = encode(&Envelope { letter, frame: enclosed }).expect("a letter can be encoded");
        let end = end.append(Frame::new(envelope));
        for &rank in &to {
            open.push(world.process_at_rank(rank).immediate_send_with_tag(scope, &end.frame[..], LETTER));
        }
        let Some(frame) = frame else { return end };
        let end = end.append(frame);
        if let Some(group) = group {
            self.broadcast(world, group, &end.frame);
            return end;
        }
        for &rank in &to {
            for piece in end.frame.chunks(LONGEST_PIECE) {
                open.push(world.process_at_rank(rank).immediate_send_with_tag(scope, piece, FRAME));
            }
        }
        end
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
            Envelope { letter: Letter::Unable { host: "a machine with another build".to_owned(), reason }, frame: None }
        };
        let Envelope { letter, frame } = decode(&envelope).unwrap_or_else(unreadable);
        let frame = frame.map(|enclosed| {
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
        // If the reader has gone, the letter is not needed.
        let _ = self.received.send(Received { from: from as usize, letter, frame });
        self.cord.ring();
        true
    }
}
