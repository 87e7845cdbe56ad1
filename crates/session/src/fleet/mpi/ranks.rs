//! The crew of rank 0: workers on the other ranks of an MPI job.
//!
//! The agents of a rank that died cannot be given to another one: this crew replaces nobody. The run ends with a message
//! and is resumed with any fleet.

use std::cell::RefCell;
use std::ops::Range;
use std::rc::Rc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};

use super::desk::{Desk, Seat};
use super::letter::Letter;
use super::luggage::{Luggage, from_the_run_directory};
use super::post::Post;
use crate::config::RunConfig;
use crate::fleet::bell::Bell;
use crate::fleet::channel::{decode, encode};
use crate::fleet::children::log_of;
use crate::fleet::link::{Crew, Frame, Link, News};
use dials_core::outside::Directory;

/// Time in which the relays must end at the end of a run.
const ENDING: Duration = Duration::from_secs(20);
/// Interval at which rank 0 looks for dead ranks while it waits.
const LOOK: Duration = Duration::from_millis(200);

/// The other ranks of the job, of which each owns the same number of workers, or one less.
pub struct Ranks {
    desk: Rc<RefCell<Desk>>,
    bell: Bell,
    /// Folder of the logs, once a run is prepared.
    logs: Option<Directory>,
}

/// A rank that is prepared for a run.
pub struct Prepared {
    pub rank: usize,
    pub host: String,
    /// What computes there, as its program describes it.
    pub build: String,
}

/// The run whose workers are to be started.
pub struct Job<'a> {
    /// Config as it was loaded from the run directory.
    pub config: &'a RunConfig,
    pub directory: &'a Directory,
    /// Folder of the run directory with the files that workers need.
    pub networks: &'a str,
    /// Agents of each worker.
    pub agents: Vec<Range<usize>>,
    /// Longest time that a rank may take to prepare.
    pub patience: Duration,
}

impl Ranks {
    pub(super) fn new(post: Post, bell: Bell) -> Result<Ranks> {
        Ok(Ranks { desk: Rc::new(RefCell::new(Desk::new(post)?)), bell, logs: None })
    }

    /// Returns the number of ranks that can own workers.
    pub fn relays(&self) -> usize {
        self.desk.borrow().relays().count()
    }

    /// Sends all ranks what they need for a run, and waits until they are prepared. Returns them, and the config that
    /// their workers need.
    pub fn prepare(&mut self, job: Job) -> Result<(Vec<Prepared>, RunConfig)> {
        let config = from_the_run_directory(job.config, job.directory)?;
        self.logs = Some(job.directory.clone());
        let mut desk = self.desk.borrow_mut();
        let luggage = Luggage::pack(&config, job.directory, job.networks, desk.lifelines.address())?;
        desk.seats = job.agents.into_iter().map(Seat::of).collect();
        let all: Vec<usize> = desk.relays().collect();
        desk.post(&all, Letter::Prepare, Some(Frame::new(encode(&luggage)?)));
        let begun = Instant::now();
        loop {
            desk.read()?;
            desk.look_for_the_dead();
            if let Some(rank) = desk.relays().find(|&rank| desk.members[rank].is_dead) {
                bail!("{} has ended before the run began", desk.name(rank));
            }
            let Some(rank) = desk.relays().find(|&rank| desk.members[rank].prepared.is_none()) else { break };
            ensure!(
                begun.elapsed() < job.patience,
                "rank {rank} is not prepared after {:?}; --patience allows more",
                job.patience
            );
            drop(desk);
            self.bell.wait(LOOK);
            desk = self.desk.borrow_mut();
        }
        let prepared = |rank: usize| {
            let (host, build) = desk.members[rank].prepared.clone().expect("all are prepared now");
            Prepared { rank, host, build }
        };
        Ok((desk.relays().map(prepared).collect(), config))
    }
}

impl Crew for Ranks {
    fn start(&mut self, worker: usize) -> Result<Box<dyn Link>> {
        let logs = self.logs.as_ref().context("the ranks are not prepared for a run")?;
        let mut desk = self.desk.borrow_mut();
        desk.seats[worker].log = Some(logs.open_to_append(&log_of(worker))?);
        let rank = desk.rank_of(worker);
        desk.post(&[rank], Letter::Start { worker }, None);
        Ok(Box::new(RankLink { desk: self.desk.clone(), worker }))
    }

    fn can_replace(&self) -> bool {
        false
    }

    fn wait(&mut self, at_most: Duration) {
        self.desk.borrow_mut().deliver();
        self.bell.wait(at_most);
        self.desk.borrow_mut().look_for_the_dead();
    }
}

impl Drop for Ranks {
    /// Ends the other ranks and leaves the job together with them, if they all live.
    fn drop(&mut self) {
        let mut desk = self.desk.borrow_mut();
        let all: Vec<usize> = desk.relays().collect();
        desk.post(&all, Letter::End, None);
        let begun = Instant::now();
        let all_live = loop {
            // A letter that cannot be taken in is not needed any more.
            let _ = desk.read();
            desk.seats.iter_mut().for_each(|seat| seat.news.clear());
            desk.look_for_the_dead();
            let mut members = desk.relays().map(|rank| &desk.members[rank]);
            if members.clone().all(|member| member.has_ended) {
                break true;
            }
            if members.any(|member| member.is_dead && !member.has_ended) || begun.elapsed() > ENDING {
                break false;
            }
            drop(members);
            self.bell.wait(Duration::from_millis(10));
        };
        let post = desk.post.take().expect("it is only taken here");
        if !all_live {
            post.abandon();
        }
    }
}

/// The other end of a link to a worker on another rank.
pub(super) struct RankLink {
    desk: Rc<RefCell<Desk>>,
    worker: usize,
}

impl Link for RankLink {
    fn send(&self, frame: Frame) {
        self.desk.borrow_mut().seats[self.worker].outgoing.push_back(frame);
    }

    fn next(&mut self) -> Option<News> {
        let mut desk = self.desk.borrow_mut();
        if let Err(error) = desk.read() {
            return Some(News::Gone(Some(error)));
        }
        match desk.seats[self.worker].news.pop_front()? {
            News::Gone(reason) => Some(News::Gone(reason)),
            News::Said(parcel) => Some(match decode(&parcel.frame) {
                Ok(report) => News::Said(report),
                Err(error) => News::Gone(Some(error)),
            }),
        }
    }

    fn state(&self) -> Option<String> {
        let desk = self.desk.borrow();
        Some(format!("on {}", desk.name(desk.rank_of(self.worker))))
    }

    fn end(self: Box<Self>) -> String {
        let desk = self.desk.borrow();
        let rank = desk.rank_of(self.worker);
        match &desk.seats[self.worker].how {
            Some(how) => format!("{how}\nit ran on {}", desk.name(rank)),
            None => format!("{} has ended; {}", desk.name(rank), desk.its_workers(rank)),
        }
    }

    fn end_by_force(self: Box<Self>) -> String {
        let desk = self.desk.borrow();
        desk.its_workers(desk.rank_of(self.worker))
    }
}
