//! A crew of workers in this process, and what becomes of them.

use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::Result;

use super::lies::lies;
use crate::fleet::MostGrowth;
use crate::fleet::in_process::InProcess;
use crate::fleet::link::{Crew, Link, News};
use dials_core::domain::Domain;
use dials_learn::observer::Silent;

/// What happens to a worker at a certain frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Fate {
    Dies,
    Hangs,
    /// The worker sends the message of this number in [`lies`] and then hangs.
    Lies(usize),
}

/// Number of the worker's frame, from 0, at which its fate strikes, and the fate.
pub(super) type FateAt = (usize, Fate);

pub(super) struct TestCrew {
    pub(super) domain: Arc<dyn Domain>,
    pub(super) can_replace: bool,
    /// Fates by worker. The last one in a list strikes the next worker that is started with that number.
    pub(super) fates: Vec<Vec<FateAt>>,
    pub(super) most_growth: MostGrowth,
    pub(super) running: BTreeMap<usize, TestWorker>,
}

pub(super) struct TestWorker {
    process: InProcess,
    fate: Option<FateAt>,
    frames: usize,
    has_ended: bool,
}

impl Crew for TestCrew {
    fn start(&mut self, worker: usize) -> Result<Box<dyn Link>> {
        let process = InProcess::new(self.domain.clone(), Rc::new(Silent));
        let link = process.mailbox.clone();
        let fate = self.fates[worker].pop();
        self.running.insert(worker, TestWorker { process, fate, frames: 0, has_ended: false });
        Ok(Box::new(link))
    }

    fn can_replace(&self) -> bool {
        self.can_replace
    }

    fn wait(&mut self, at_most: Duration) {
        let done: usize = self.running.values_mut().map(TestWorker::work).sum();
        if done == 0 {
            thread::sleep(at_most);
        }
    }
}

impl TestWorker {
    /// Does what it was sent. Returns the number of frames.
    fn work(&mut self) -> usize {
        let before = self.frames;
        while !self.has_ended {
            let Some(order) = self.process.mailbox.borrow_mut().orders.pop_front() else { break };
            let news = match self.fate.filter(|(at, _)| *at == self.frames) {
                None => self.process.carry_out(&order),
                Some((_, fate)) => {
                    self.has_ended = true;
                    match fate {
                        Fate::Dies => Some(News::Gone(None)),
                        Fate::Hangs => None,
                        Fate::Lies(number) => Some(News::Said(lies().remove(number))),
                    }
                }
            };
            self.process.mailbox.borrow_mut().news.extend(news);
            self.frames += 1;
        }
        self.frames - before
    }
}
