//! A rank that owns workers: it starts them as child processes and passes frames between them and rank 0.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};
use tempfile::TempDir;

use super::post::{Letter, Parcel, Post};
use super::shared_files::SharedFiles;
use super::watch::ParentWatch;
use crate::fleet::channel::{decode, receive_frame};
use crate::fleet::children::{ChildProcess, log_of};
use crate::fleet::link::{Frame, Link, News};
use crate::fleet::log::Log;
use dials_core::outside::{Directory, temporary_dir};

/// Interval at which the relay looks for the death of rank 0 and at the logs of its workers.
const LOOK: Duration = Duration::from_millis(200);
/// Longest part of a log that one letter carries, in bytes.
const LONGEST_PART: u64 = 64 << 10;

pub struct Relay(pub(super) Post);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Rank 0 has said so.
    Ordered,
    /// Rank 0 has died, or ended without a word.
    Orphaned,
}

impl Relay {
    /// Does what rank 0 orders until the run or rank 0 ends. `describe`: says what computes here, for a config as JSON.
    pub fn serve(self, describe: impl Fn(&str) -> Result<String>) -> End {
        let post = self.0;
        let mut team: Option<LocalTeam> = None;
        loop {
            thread::park_timeout(LOOK);
            while let Some(received) = post.next() {
                match (received.letter, &mut team) {
                    (Letter::Prepare, _) => match LocalTeam::prepare(&post, received.frame, &describe) {
                        Ok((prepared, answer)) => {
                            team = Some(prepared);
                            post.report(answer, None);
                        }
                        Err(error) => {
                            let reason = format!("{error:#}");
                            post.report(Letter::Unable { host: post.host.clone(), reason }, None);
                        }
                    },
                    (Letter::Start { worker }, Some(team)) => {
                        if let Err(error) = team.start(worker) {
                            post.report(Letter::Lost { worker, how: format!("{error:#}") }, None);
                        }
                    }
                    (Letter::Deliver { workers }, Some(team)) => team.deliver(&workers, received.frame),
                    (Letter::End, _) => {
                        if let Some(team) = &mut team {
                            team.report(&post);
                            team.workers.clear();
                        }
                        post.report(Letter::Ended, None);
                        // Before the watch, whose end may reach rank 0 only when it needs this rank no more.
                        drop(post);
                        return End::Ordered;
                    }
                    // Rank 0 says what this rank cannot read. It can read this rank as little, and ends the job.
                    (unable @ Letter::Unable { .. }, _) => post.report(unable, None),
                    // Nothing else is sent to a relay, and nothing before it is prepared.
                    _ => {}
                }
            }
            if let Some(team) = &mut team {
                team.report(&post);
                if team.watch.as_ref().is_some_and(ParentWatch::has_ended) {
                    post.abandon();
                    return End::Orphaned;
                }
            }
        }
    }
}

struct LocalTeam {
    workers: BTreeMap<usize, LocalWorker>,
    watch: Option<ParentWatch>,
    logs: Directory,
    /// Folder of the networks and the logs. Removed at the end.
    files: TempDir,
}

/// A worker process whose reports stay encoded.
struct LocalWorker {
    process: Box<ChildProcess<Vec<u8>>>,
    /// Its log, read up to what rank 0 knows.
    log: File,
}

impl LocalTeam {
    /// Writes the files of the run and connects to rank 0. Returns the answer, too.
    fn prepare(
        post: &Post,
        files: Option<Parcel>,
        describe: impl Fn(&str) -> Result<String>,
    ) -> Result<(LocalTeam, Letter)> {
        let shared: SharedFiles = decode(&files.context("no files came")?.frame)?;
        let files = temporary_dir()?;
        shared.write(files.path())?;
        let build = describe(&shared.config_json)?;
        let (watch, unwatched) = match ParentWatch::connect(&shared.rank_0, post.rank) {
            Ok(watch) => (Some(watch), None),
            Err(error) => (None, Some(format!("{error:#}"))),
        };
        let team = LocalTeam { workers: BTreeMap::new(), watch, logs: Directory::open(files.path())?, files };
        Ok((team, Letter::Prepared { host: post.host.clone(), build, unwatched }))
    }

    fn start(&mut self, worker: usize) -> Result<()> {
        let name = log_of(worker);
        let log = Log::open(&self.logs, name.clone())?;
        let process = ChildProcess::spawn(worker, log, Some(self.files.path()), |stream| receive_frame(stream))?;
        let path = self.files.path().join(name);
        let log = File::open(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        self.workers.insert(worker, LocalWorker { process: Box::new(process), log });
        Ok(())
    }

    /// Passes a frame to those of the workers that are here.
    fn deliver(&self, workers: &[usize], frame: Option<Parcel>) {
        let Some(mut parcel) = frame else { return };
        let frame = Frame::new(std::mem::take(&mut parcel.frame));
        for local in workers.iter().filter_map(|worker| self.workers.get(worker)) {
            local.process.send(frame.clone());
        }
    }

    /// Sends rank 0 what the workers said and printed, and which of them have ended.
    fn report(&mut self, post: &Post) {
        let mut ended = Vec::new();
        for (&worker, local) in &mut self.workers {
            while let Some(news) = local.process.next() {
                match news {
                    News::Said(frame) => post.report(Letter::Said { worker }, Some(Frame::new(frame))),
                    News::Gone(_) => ended.push(worker),
                }
            }
            pass_on(&local.log, worker, post);
        }
        for worker in ended {
            let Some(LocalWorker { process, log }) = self.workers.remove(&worker) else { continue };
            let how = process.end();
            pass_on(log, worker, post);
            post.report(Letter::Lost { worker, how }, None);
        }
    }
}

/// Sends rank 0 the next part of a log, if there is one. A log that cannot be read is no reason to end the run.
fn pass_on(log: impl Read, worker: usize, post: &Post) {
    let mut bytes = Vec::new();
    if log.take(LONGEST_PART).read_to_end(&mut bytes).is_ok() && !bytes.is_empty() {
        post.report(Letter::Printed { worker, bytes }, None);
    }
}
