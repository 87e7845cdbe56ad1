//! Copies of the GS.

use std::collections::VecDeque;

use anyhow::Context;

use dials_core::base::{Seed, Stopwatch};
use dials_core::domain::{Action, Domain, GlobalSimulator, JointTransition, Kinds, Result};

/// Several GSs of one domain, each with an episode of its own. They are numbered from 0.
///
/// What a copy shows depends on its episode and its actions only, and never on where or when it is computed. A copy that has
/// begun something must be waited for before it begins something else.
pub trait GlobalCopies {
    /// Returns how many copies may be at work at the same time.
    fn at_once(&self) -> usize;

    /// Begins to begin an episode: [`GlobalSimulator::reset`].
    fn begin_reset(&mut self, copy: usize, episode: Seed) -> Result<()>;

    /// Begins a step. `actions`: `[agents]`.
    fn begin_step(&mut self, copy: usize, actions: &[Action]) -> Result<()>;

    /// Waits until a copy that is at work has done what it was asked for, and returns it.
    fn wait(&mut self) -> Result<usize>;

    /// Returns what a copy has shown last. The rewards after a reset mean nothing.
    fn shown(&self, copy: usize) -> &JointTransition;

    /// Returns how long steps took since the last call, where it is known in parts: [`GlobalSimulator::take_watch`].
    fn take_watch(&mut self) -> Stopwatch;
}

/// Makes copies of the GS. A process that holds only one GS lets others make the rest.
pub trait MakeCopies {
    /// Makes this number of copies, at least one.
    fn make(&self, domain: &dyn Domain, copies: usize) -> Result<Box<dyn GlobalCopies>>;
}

/// Makes all copies in this process, one at work after the other.
pub struct InThisProcess;

impl MakeCopies for InThisProcess {
    fn make(&self, domain: &dyn Domain, copies: usize) -> Result<Box<dyn GlobalCopies>> {
        let simulators = (0..copies).map(|_| domain.global_simulator()).collect::<Result<Vec<_>>>()?;
        let copies = simulators.into_iter().map(OwnCopy::new).collect();
        Ok(Box::new(OwnCopies { copies, done: VecDeque::new() }))
    }
}

/// A GS in this process, and what it has shown last.
pub struct OwnCopy {
    simulator: Box<dyn GlobalSimulator>,
    shown: JointTransition,
}

impl OwnCopy {
    pub fn new(simulator: Box<dyn GlobalSimulator>) -> OwnCopy {
        OwnCopy { shown: JointTransition::new(simulator.kinds()), simulator }
    }

    pub fn kinds(&self) -> &Kinds {
        self.simulator.kinds()
    }

    pub fn reset(&mut self, episode: Seed) -> Result<()> {
        self.shown.percept.copy_from(self.simulator.reset(episode)?);
        Ok(())
    }

    pub fn step(&mut self, actions: &[Action]) -> Result<()> {
        let transition = self.simulator.step(actions)?;
        self.shown.percept.copy_from(&transition.percept);
        self.shown.rewards.copy_from_slice(&transition.rewards);
        Ok(())
    }

    pub fn shown(&self) -> &JointTransition {
        &self.shown
    }

    pub fn take_watch(&mut self) -> Stopwatch {
        self.simulator.take_watch()
    }
}

struct OwnCopies {
    copies: Vec<OwnCopy>,
    done: VecDeque<usize>,
}

impl GlobalCopies for OwnCopies {
    fn at_once(&self) -> usize {
        1
    }

    fn begin_reset(&mut self, copy: usize, episode: Seed) -> Result<()> {
        self.done.push_back(copy);
        self.copies[copy].reset(episode)
    }

    fn begin_step(&mut self, copy: usize, actions: &[Action]) -> Result<()> {
        self.done.push_back(copy);
        self.copies[copy].step(actions)
    }

    fn wait(&mut self) -> Result<usize> {
        self.done.pop_front().context("no copy of the global simulator is at work")
    }

    fn shown(&self, copy: usize) -> &JointTransition {
        self.copies[copy].shown()
    }

    fn take_watch(&mut self) -> Stopwatch {
        let mut all = Stopwatch::default();
        self.copies.iter_mut().for_each(|copy| all.add(&copy.take_watch()));
        all
    }
}
