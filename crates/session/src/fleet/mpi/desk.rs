//! What rank 0 knows of the other ranks and their workers: letters that come and go, and who has died.

use std::collections::{BTreeSet, VecDeque};
use std::fs::File;
use std::io::Write;
use std::ops::Range;

use anyhow::{Context, Result, bail};

use super::letter::{Letter, Rank};
use super::lifeline::Lifelines;
use super::post::{Outgoing, Parcel, Post, Received};
use crate::fleet::link::{Frame, News};
use crate::fleet::shares::{names_of, share};

/// Number of ranks from which one broadcast is better than a message to each.
const MANY: usize = 3;
/// Length of a frame from which a broadcast is worth its effort, in bytes.
const LARGE: usize = 1 << 20;

/// The state that the crew and its links share.
pub(super) struct Desk {
    /// Taken at the end only.
    pub(crate) post: Option<Post>,
    pub(crate) lifelines: Lifelines,
    /// By rank.
    pub(crate) members: Vec<Member>,
    /// By worker.
    pub(crate) seats: Vec<Seat>,
}

/// A rank. Nothing is noted of rank 0.
#[derive(Default)]
pub(super) struct Member {
    /// Name of its machine, and what computes there, once it is prepared.
    pub(crate) prepared: Option<(String, String)>,
    /// Its lifeline was cut.
    pub(crate) is_dead: bool,
    /// It said its last word.
    pub(crate) has_ended: bool,
}

/// A worker.
pub(super) struct Seat {
    pub(crate) agents: Range<usize>,
    /// Frames that are not posted yet.
    pub(crate) outgoing: VecDeque<Frame>,
    pub(crate) news: VecDeque<News<Parcel>>,
    /// Log in the run directory, once the worker is started.
    pub(crate) log: Option<File>,
    /// How the worker ended.
    pub(crate) how: Option<String>,
}

impl Seat {
    pub(super) fn of(agents: Range<usize>) -> Seat {
        Seat { agents, outgoing: VecDeque::new(), news: VecDeque::new(), log: None, how: None }
    }
}

impl Desk {
    pub(super) fn new(post: Post) -> Result<Desk> {
        let lifelines = Lifelines::open(&post.host, post.ranks)?;
        let members = (0..post.ranks).map(|_| Member::default()).collect();
        Ok(Desk { post: Some(post), lifelines, members, seats: Vec::new() })
    }

    /// Returns all other ranks.
    pub(super) fn relays(&self) -> Range<usize> {
        1..self.members.len()
    }

    /// Returns the workers that a rank owns: nearly equally many each, one after another.
    fn workers_of(&self, rank: usize) -> Range<usize> {
        share(self.seats.len(), self.members.len() - 1, rank - 1)
    }

    pub(super) fn rank_of(&self, worker: usize) -> usize {
        self.relays().find(|&rank| self.workers_of(rank).contains(&worker)).expect("every worker has its rank")
    }

    /// Returns a rank with its machine, for people.
    pub(super) fn name(&self, rank: usize) -> String {
        match &self.members[rank].prepared {
            Some((host, _)) => format!("rank {rank} on {host}"),
            None => format!("rank {rank}"),
        }
    }

    /// Returns what a rank owned, for people.
    pub(super) fn its_workers(&self, rank: usize) -> String {
        let names = self.workers_of(rank).map(|worker| names_of(worker, &self.seats[worker].agents));
        format!("it owned {}", names.collect::<Vec<_>>().join(", "))
    }

    /// Posts a letter, with its frame in one broadcast if that is better.
    pub(super) fn post(&self, ranks: &[usize], letter: Letter, frame: Option<Frame>) {
        let together = ranks.len() >= MANY && frame.as_ref().is_some_and(|frame| frame.len() >= LARGE);
        let to = ranks.iter().map(|&rank| rank as Rank).collect();
        self.post.as_ref().expect("it is only taken at the end").send(Outgoing { to, letter, frame, together });
    }

    /// Posts all frames that links have sent. A frame that is the next one for several workers is sent to each rank
    /// once.
    pub(super) fn deliver(&mut self) {
        while let Some(first) = self.seats.iter().position(|seat| !seat.outgoing.is_empty()) {
            let frame = self.seats[first].outgoing[0].clone();
            let mut workers = Vec::new();
            for (worker, seat) in self.seats.iter_mut().enumerate().skip(first) {
                if seat.outgoing.front().is_some_and(|front| Frame::ptr_eq(front, &frame)) {
                    seat.outgoing.pop_front();
                    workers.push(worker);
                }
            }
            let ranks: BTreeSet<usize> = workers.iter().map(|&worker| self.rank_of(worker)).collect();
            self.post(&ranks.into_iter().collect::<Vec<_>>(), Letter::Deliver { workers }, Some(frame));
        }
    }

    /// Takes in all letters that have come.
    pub(super) fn read(&mut self) -> Result<()> {
        while let Some(received) = self.post.as_ref().and_then(Post::next) {
            self.take_in(received)?;
        }
        Ok(())
    }

    fn take_in(&mut self, Received { from, letter, frame }: Received) -> Result<()> {
        match letter {
            Letter::Prepared { host, build, lifeline } => {
                match lifeline {
                    None => self.lifelines.expect(from)?,
                    Some(why) => bail!(
                        "rank {from} on {host}: {why}; the machines of the ranks must reach each other by TCP, so that \
                         a dead rank is noticed"
                    ),
                }
                self.members[from].prepared = Some((host, build));
            }
            Letter::Unable { host, reason } => bail!("rank {from} on {host} cannot take part: {reason}"),
            Letter::Said { worker } => {
                let parcel = frame.context("a report came without its frame")?;
                self.seats[worker].news.push_back(News::Said(parcel));
            }
            Letter::Lost { worker, how } => {
                self.seats[worker].how = Some(how);
                self.seats[worker].news.push_back(News::Gone(None));
            }
            Letter::Printed { worker, bytes } => {
                let log = self.seats[worker].log.as_mut().context("a worker printed before it was started")?;
                log.write_all(&bytes).with_context(|| format!("the log of worker {worker} cannot be written"))?;
            }
            Letter::Ended => self.members[from].has_ended = true,
            Letter::Prepare | Letter::Start { .. } | Letter::Deliver { .. } | Letter::End => {
                bail!("rank {from} sent a letter that only rank 0 sends")
            }
        }
        Ok(())
    }

    /// Notes which ranks have died since the last call: all their workers have gone.
    pub(super) fn look_for_the_dead(&mut self) {
        for rank in self.lifelines.newly_cut() {
            self.members[rank].is_dead = true;
            for worker in self.workers_of(rank) {
                self.seats[worker].news.push_back(News::Gone(None));
            }
        }
    }
}
