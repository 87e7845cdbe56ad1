//! A rank that owns workers: it starts them as child processes and passes frames between them and rank 0.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};
use tempfile::TempDir;

use super::letter::Letter;
use super::lifeline::Lifeline;
use super::luggage::Luggage;
use super::post::{Parcel, Post};
use crate::fleet::bell::Bell;
use crate::fleet::channel::{decode, receive_frame};
use crate::fleet::children::{ChildProcess, Place, log_of};
use crate::fleet::link::{Frame, News};
use crate::fleet::log::Log;
use dials_core::outside::{Directory, temporary_dir};

/// Interval at which the relay looks at its lifeline and at the logs of its workers.
const LOOK: Duration = Duration::from_millis(200);
/// Longest part of a log that one letter carries, in bytes.
const LONGEST_PART: u64 = 64 << 10;

/// A rank that is not rank 0.
pub struct Relay {
    post: Post,
    bell: Bell,
}

/// Why a relay has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Rank 0 has said so.
    Ordered,
    /// Rank 0 has died, or ended without a word.
    Orphaned,
}

impl Relay {
    pub(super) fn new(post: Post, bell: Bell) -> Relay {
        Relay { post, bell }
    }

    /// Does what rank 0 orders until it says that the run has ended, or ends itself.
    ///
    /// `describe`: describes what computes here, for the config that it gets as JSON.
    pub fn serve(self, describe: impl Fn(&str) -> Result<String>) -> End {
        let Relay { post, bell } = self;
        let mut camp: Option<Camp> = None;
        loop {
            bell.wait(LOOK);
            while let Some(received) = post.next() {
                match (received.letter, &mut camp) {
                    (Letter::Prepare, _) => match Camp::pitch(&post, received.frame, &describe) {
                        Ok((made, prepared)) => {
                            camp = Some(made);
                            post.report(prepared, None);
                        }
                        Err(error) => {
                            let reason = format!("{error:#}");
                            post.report(Letter::Unable { host: post.host.clone(), reason }, None);
                        }
                    },
                    (Letter::Start { worker }, Some(camp)) => {
                        if let Err(error) = camp.start(worker, &bell) {
                            post.report(Letter::Lost { worker, how: format!("{error:#}") }, None);
                        }
                    }
                    (Letter::Deliver { workers }, Some(camp)) => camp.deliver(&workers, received.frame),
                    (Letter::End, _) => {
                        if let Some(camp) = &mut camp {
                            camp.report(&post);
                            camp.workers.clear();
                        }
                        post.report(Letter::Ended, None);
                        // Before the lifeline, which may be cut only when rank 0 needs it no more.
                        drop(post);
                        return End::Ordered;
                    }
                    // Rank 0 says what this rank cannot read. It can read this rank as little, and ends the job.
                    (unable @ Letter::Unable { .. }, _) => post.report(unable, None),
                    // Nothing else is sent to a relay, and nothing before it is prepared.
                    _ => {}
                }
            }
            if let Some(camp) = &mut camp {
                camp.report(&post);
                if camp.lifeline.as_ref().is_some_and(Lifeline::is_cut) {
                    post.abandon();
                    return End::Orphaned;
                }
            }
        }
    }
}

/// Workers of this rank, and their files.
struct Camp {
    workers: BTreeMap<usize, Camper>,
    lifeline: Option<Lifeline>,
    logs: Directory,
    /// Folder of the networks and the logs. Removed at the end.
    files: TempDir,
}

/// A worker process whose reports stay encoded.
struct Camper {
    process: ChildProcess<Vec<u8>>,
    /// Its log, read up to what rank 0 knows.
    log: File,
}

impl Camp {
    /// Unpacks the files of the run and connects to rank 0. Returns the answer, too.
    fn pitch(
        post: &Post,
        luggage: Option<Parcel>,
        describe: impl Fn(&str) -> Result<String>,
    ) -> Result<(Camp, Letter)> {
        let luggage: Luggage = decode(&luggage.context("no luggage came")?.frame)?;
        let files = temporary_dir()?;
        luggage.unpack(files.path())?;
        let build = describe(&luggage.config_json)?;
        let (lifeline, missing) = match Lifeline::connect(&luggage.lifeline, post.rank) {
            Ok(line) => (Some(line), None),
            Err(error) => (None, Some(format!("{error:#}"))),
        };
        let camp = Camp { workers: BTreeMap::new(), lifeline, logs: Directory::open(files.path())?, files };
        Ok((camp, Letter::Prepared { host: post.host.clone(), build, lifeline: missing }))
    }

    /// Starts a worker. To be called from the thread that lives as long as the rank: the worker ends with it.
    fn start(&mut self, worker: usize, bell: &Bell) -> Result<()> {
        let name = log_of(worker);
        let log = Log::open(&self.logs, name.clone())?;
        let place = Place { worker, log, cord: bell.cord(), paths_from: Some(self.files.path().to_owned()) };
        let process = ChildProcess::spawn(place, |stream| receive_frame(stream))?;
        let log = open_log(&self.files.path().join(name))?;
        self.workers.insert(worker, Camper { process, log });
        Ok(())
    }

    /// Passes a frame to those of the workers that are here.
    fn deliver(&self, workers: &[usize], frame: Option<Parcel>) {
        let Some(mut parcel) = frame else { return };
        let frame = Frame::new(std::mem::take(&mut parcel.frame));
        for camper in workers.iter().filter_map(|worker| self.workers.get(worker)) {
            camper.process.send(frame.clone());
        }
    }

    /// Sends rank 0 what the workers said and printed, and which of them have ended.
    fn report(&mut self, post: &Post) {
        let mut ended = Vec::new();
        for (&worker, camper) in &mut self.workers {
            while let Some(news) = camper.process.next() {
                match news {
                    News::Said(frame) => post.report(Letter::Said { worker }, Some(Frame::new(frame))),
                    News::Gone(_) => ended.push(worker),
                }
            }
            pass_on(&camper.log, worker, post);
        }
        for worker in ended {
            let Some(Camper { process, log }) = self.workers.remove(&worker) else { continue };
            let how = process.end();
            pass_on(log, worker, post);
            post.report(Letter::Lost { worker, how }, None);
        }
    }
}

fn open_log(path: &Path) -> Result<File> {
    File::open(path).with_context(|| format!("{}: cannot be read", path.display()))
}

/// Sends rank 0 the next part of a log, if there is one. A log that cannot be read is no reason to end the run.
fn pass_on(log: impl Read, worker: usize, post: &Post) {
    let mut bytes = Vec::new();
    if log.take(LONGEST_PART).read_to_end(&mut bytes).is_ok() && !bytes.is_empty() {
        post.report(Letter::Printed { worker, bytes }, None);
    }
}
