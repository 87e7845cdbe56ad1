//! The crew of rank 0: workers on the other ranks of an MPI job.
//!
//! The agents of a rank that died cannot be given to another one: this crew replaces nobody. The run ends with a message
//! and is resumed with any fleet.

use std::cell::RefCell;
use std::collections::{BTreeSet, VecDeque};
use std::fs::File;
use std::io::Write;
use std::ops::Range;
use std::rc::Rc;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};

use super::post::{Letter, Outgoing, Parcel, Post, Rank, Received};
use super::shared_files::{SharedFiles, from_the_run_directory};
use super::watch::RankWatch;
use crate::config::RunConfig;
use crate::fleet::channel::{decode, encode};
use crate::fleet::children::log_of;
use crate::fleet::link::{Crew, Frame, Link, News};
use crate::fleet::shares::{names_of, share};
use dials_core::outside::Directory;

/// Time in which the relays must end at the end of a run.
const ENDING: Duration = Duration::from_secs(20);
/// Interval at which rank 0 looks for dead ranks while it waits.
const LOOK: Duration = Duration::from_millis(200);
/// Number of ranks from which one broadcast is better than a message to each.
const MANY: usize = 3;
/// Length of a frame from which a broadcast is worth its effort, in bytes.
const LARGE: usize = 1 << 20;

/// The other ranks of the job, of which each owns the same number of workers, or one less.
pub struct Ranks {
    table: Rc<RefCell<Table>>,
    /// Folder of the logs, once a run is prepared.
    logs: Option<Directory>,
}

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
    pub agents: Vec<Range<usize>>,
    /// Longest time that a rank may take to prepare.
    pub patience: Duration,
}

impl Ranks {
    pub(super) fn new(post: Post) -> Result<Ranks> {
        let watch = RankWatch::open(&post.host, post.ranks)?;
        let members = (0..post.ranks).map(|_| Member::default()).collect();
        let table = Table { post: Some(post), watch, members, workers: Vec::new() };
        Ok(Ranks { table: Rc::new(RefCell::new(table)), logs: None })
    }

    /// Returns the number of ranks that can own workers.
    pub fn relays(&self) -> usize {
        self.table.borrow().relays().count()
    }

    /// Sends all ranks what they need for a run, and waits for them. Returns them, and the config for their workers.
    pub fn prepare(&mut self, job: Job) -> Result<(Vec<Prepared>, RunConfig)> {
        let config = from_the_run_directory(job.config, job.directory)?;
        self.logs = Some(job.directory.clone());
        let mut table = self.table.borrow_mut();
        let files = SharedFiles::read(&config, job.directory, job.networks, table.watch.address())?;
        let worker = |agents| RemoteWorker { agents, ..RemoteWorker::default() };
        table.workers = job.agents.into_iter().map(worker).collect();
        let all: Vec<usize> = table.relays().collect();
        table.post(&all, Letter::Prepare, Some(Frame::new(encode(&files)?)));
        let begun = Instant::now();
        loop {
            table.read()?;
            table.look_for_the_dead();
            if let Some(rank) = table.relays().find(|&rank| table.members[rank].is_dead) {
                bail!("{} has ended before the run began", table.name(rank));
            }
            let Some(rank) = table.relays().find(|&rank| table.members[rank].prepared.is_none()) else { break };
            ensure!(
                begun.elapsed() < job.patience,
                "rank {rank} is not prepared after {:?}; --patience allows more",
                job.patience
            );
            thread::park_timeout(LOOK);
        }
        let prepared = |rank: usize| {
            let (host, build) = table.members[rank].prepared.clone().expect("all are prepared now");
            Prepared { rank, host, build }
        };
        Ok((table.relays().map(prepared).collect(), config))
    }
}

impl Crew for Ranks {
    fn start(&mut self, worker: usize) -> Result<Box<dyn Link>> {
        let logs = self.logs.as_ref().context("the ranks are not prepared for a run")?;
        let mut table = self.table.borrow_mut();
        table.workers[worker].log = Some(logs.open_to_append(&log_of(worker))?);
        let rank = table.rank_of(worker);
        table.post(&[rank], Letter::Start { worker }, None);
        Ok(Box::new(RankLink { table: self.table.clone(), worker }))
    }

    fn can_replace(&self) -> bool {
        false
    }

    fn wait(&mut self, at_most: Duration) {
        self.table.borrow_mut().deliver();
        thread::park_timeout(at_most);
        self.table.borrow_mut().look_for_the_dead();
    }
}

impl Drop for Ranks {
    /// Ends the other ranks and leaves the job together with them, if they all live.
    fn drop(&mut self) {
        let mut table = self.table.borrow_mut();
        let all: Vec<usize> = table.relays().collect();
        table.post(&all, Letter::End, None);
        let begun = Instant::now();
        let all_live = loop {
            // A letter that cannot be taken in is not needed any more.
            let _ = table.read();
            table.workers.iter_mut().for_each(|worker| worker.news.clear());
            table.look_for_the_dead();
            let mut members = table.relays().map(|rank| &table.members[rank]);
            if members.clone().all(|member| member.has_ended) {
                break true;
            }
            if members.any(|member| member.is_dead && !member.has_ended) || begun.elapsed() > ENDING {
                break false;
            }
            thread::park_timeout(Duration::from_millis(10));
        };
        let post = table.post.take().expect("it is only taken here");
        if !all_live {
            post.abandon();
        }
    }
}

struct RankLink {
    table: Rc<RefCell<Table>>,
    worker: usize,
}

impl Link for RankLink {
    fn send(&self, frame: Frame) {
        self.table.borrow_mut().workers[self.worker].outgoing.push_back(frame);
    }

    fn next(&mut self) -> Option<News> {
        let mut table = self.table.borrow_mut();
        if let Err(error) = table.read() {
            return Some(News::Gone(Some(error)));
        }
        match table.workers[self.worker].news.pop_front()? {
            News::Gone(reason) => Some(News::Gone(reason)),
            News::Said(parcel) => Some(match decode(&parcel.frame) {
                Ok(report) => News::Said(report),
                Err(error) => News::Gone(Some(error)),
            }),
        }
    }

    fn state(&self) -> Option<String> {
        let table = self.table.borrow();
        Some(format!("on {}", table.name(table.rank_of(self.worker))))
    }

    fn end(self: Box<Self>) -> String {
        let table = self.table.borrow();
        let rank = table.rank_of(self.worker);
        match &table.workers[self.worker].how {
            Some(how) => format!("{how}\nit ran on {}", table.name(rank)),
            None => format!("{} has ended; {}", table.name(rank), table.its_workers(rank)),
        }
    }

    fn end_by_force(self: Box<Self>) -> String {
        let table = self.table.borrow();
        table.its_workers(table.rank_of(self.worker))
    }
}

/// What rank 0 knows of the other ranks and their workers. The crew and its links share it.
struct Table {
    /// Taken at the end only.
    post: Option<Post>,
    watch: RankWatch,
    /// By rank. Nothing is noted of rank 0.
    members: Vec<Member>,
    workers: Vec<RemoteWorker>,
}

#[derive(Default)]
struct Member {
    /// Name of its machine, and what computes there, once it is prepared.
    prepared: Option<(String, String)>,
    is_dead: bool,
    /// It has sent [`Letter::Ended`].
    has_ended: bool,
}

#[derive(Default)]
struct RemoteWorker {
    agents: Range<usize>,
    /// Frames that are not posted yet.
    outgoing: VecDeque<Frame>,
    news: VecDeque<News<Parcel>>,
    /// Log in the run directory, once the worker is started.
    log: Option<File>,
    /// How the worker ended.
    how: Option<String>,
}

impl Table {
    fn relays(&self) -> Range<usize> {
        1..self.members.len()
    }

    /// Returns the workers that a rank owns: nearly equally many each, one after another.
    fn workers_of(&self, rank: usize) -> Range<usize> {
        share(self.workers.len(), self.members.len() - 1, rank - 1)
    }

    fn rank_of(&self, worker: usize) -> usize {
        self.relays().find(|&rank| self.workers_of(rank).contains(&worker)).expect("every worker has its rank")
    }

    /// Returns a rank with its machine, for people.
    fn name(&self, rank: usize) -> String {
        match &self.members[rank].prepared {
            Some((host, _)) => format!("rank {rank} on {host}"),
            None => format!("rank {rank}"),
        }
    }

    fn its_workers(&self, rank: usize) -> String {
        let names = self.workers_of(rank).map(|worker| names_of(worker, &self.workers[worker].agents));
        format!("it owned {}", names.collect::<Vec<_>>().join(", "))
    }

    /// Posts a letter, with its frame in one broadcast if that is better.
    fn post(&self, ranks: &[usize], letter: Letter, frame: Option<Frame>) {
        let together = ranks.len() >= MANY && frame.as_ref().is_some_and(|frame| frame.len() >= LARGE);
        let to = ranks.iter().map(|&rank| rank as Rank).collect();
        self.post.as_ref().expect("it is only taken at the end").send(Outgoing { to, letter, frame, together });
    }

    /// Posts all frames that links have sent. A rank gets a frame once, however many of its workers it is for.
    fn deliver(&mut self) {
        while let Some(first) = self.workers.iter().position(|worker| !worker.outgoing.is_empty()) {
            let frame = self.workers[first].outgoing[0].clone();
            let mut workers = Vec::new();
            for (number, worker) in self.workers.iter_mut().enumerate().skip(first) {
                if worker.outgoing.front().is_some_and(|front| Frame::ptr_eq(front, &frame)) {
                    worker.outgoing.pop_front();
                    workers.push(number);
                }
            }
            let ranks: BTreeSet<usize> = workers.iter().map(|&worker| self.rank_of(worker)).collect();
            self.post(&ranks.into_iter().collect::<Vec<_>>(), Letter::Deliver { workers }, Some(frame));
        }
    }

    fn read(&mut self) -> Result<()> {
        while let Some(received) = self.post.as_ref().and_then(Post::next) {
            self.take_in(received)?;
        }
        Ok(())
    }

    fn take_in(&mut self, Received { from, letter, frame }: Received) -> Result<()> {
        match letter {
            Letter::Prepared { host, build, unwatched } => {
                match unwatched {
                    None => self.watch.expect(from)?,
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
                self.workers[worker].news.push_back(News::Said(parcel));
            }
            Letter::Lost { worker, how } => {
                self.workers[worker].how = Some(how);
                self.workers[worker].news.push_back(News::Gone(None));
            }
            Letter::Printed { worker, bytes } => {
                let log = self.workers[worker].log.as_mut().context("a worker printed before it was started")?;
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
    fn look_for_the_dead(&mut self) {
        for rank in self.watch.newly_dead() {
            self.members[rank].is_dead = true;
            for worker in self.workers_of(rank) {
                self.workers[worker].news.push_back(News::Gone(None));
            }
        }
    }
}
