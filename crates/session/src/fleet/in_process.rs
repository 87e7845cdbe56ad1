//! A crew of one worker in this process, which works while the coordinator waits for it.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;

use super::channel::decode;
use super::link::{Crew, Frame, Link, News};
use super::message::{Order, WorkerReport};
use super::process::CpuClock;
use super::serve::Server;
use super::{Coordinator, MostGrowth, Options};
use crate::config::RunConfig;
use dials_core::domain::Domain;
use dials_learn::observer::Observer;

/// Makes the smallest fleet: all agents in this process.
pub fn in_process(
    domain: Arc<dyn Domain>,
    config: impl Into<RunConfig>,
    observer: Rc<dyn Observer>,
) -> Result<Coordinator> {
    let options = Options {
        workers: 1,
        threads: 1,
        patience: Duration::MAX,
        most_growth: MostGrowth { kib: u64::MAX, share: 0.0 },
        prepared: None,
    };
    let crew = InProcess::new(domain.clone(), observer.clone());
    Coordinator::start(domain, &config.into(), Box::new(crew), options, observer)
}

pub(super) struct InProcess {
    domain: Arc<dyn Domain>,
    observer: Rc<dyn Observer>,
    server: Option<Server>,
    pub(super) mailbox: Rc<RefCell<Mailbox>>,
}

/// What coordinator and worker have sent each other and not read yet.
#[derive(Default)]
pub(super) struct Mailbox {
    pub(super) orders: VecDeque<Frame>,
    pub(super) news: VecDeque<News>,
}

impl InProcess {
    pub(super) fn new(domain: Arc<dyn Domain>, observer: Rc<dyn Observer>) -> InProcess {
        InProcess { domain, observer, server: None, mailbox: Rc::default() }
    }

    /// Carries out an encoded order. Returns the answer, if it has one.
    pub(super) fn carry_out(&mut self, order: &[u8]) -> Option<News> {
        let mut answer = || -> Result<Option<WorkerReport>> {
            let order: Order = decode(order)?;
            if let Some(server) = &mut self.server {
                return server.carry_out(order, &*self.observer);
            }
            self.server = Some(Server::begin(order, CpuClock::from_now(), |_| Ok(self.domain.clone()))?);
            Ok(Some(WorkerReport::Begun))
        };
        answer().map_or_else(|error| Some(News::Gone(Some(error))), |report| report.map(News::Said))
    }
}

impl Crew for InProcess {
    fn start(&mut self, _worker: usize) -> Result<Box<dyn Link>> {
        Ok(Box::new(self.mailbox.clone()))
    }

    fn can_replace(&self) -> bool {
        false
    }

    fn is_this_process(&self) -> bool {
        true
    }

    fn wait(&mut self, _at_most: Duration) {
        loop {
            let Some(order) = self.mailbox.borrow_mut().orders.pop_front() else { return };
            let news = self.carry_out(&order);
            self.mailbox.borrow_mut().news.extend(news);
        }
    }
}

impl Link for Rc<RefCell<Mailbox>> {
    fn send(&self, frame: Frame) {
        self.borrow_mut().orders.push_back(frame);
    }

    fn next(&mut self) -> Option<News> {
        self.borrow_mut().news.pop_front()
    }

    fn state(&self) -> Option<String> {
        None
    }

    fn end(self: Box<Self>) -> String {
        "it is this process".to_owned()
    }

    fn end_by_force(self: Box<Self>) -> String {
        self.end()
    }
}
