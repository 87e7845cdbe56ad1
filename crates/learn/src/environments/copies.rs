//! Copies of the GS.

use dials_core::base::{Seed, Stopwatch};
use dials_core::domain::{Action, Domain, GlobalSimulator, JointPercept, JointTransition, Result};

/// One of several GSs of a domain, each with an episode of its own.
///
/// What it shows depends on its episode and its actions only, and never on where or when it is computed.
pub trait GlobalCopy {
    /// Begins an episode: [`GlobalSimulator::reset`].
    fn reset(&mut self, episode: Seed) -> Result<&JointPercept>;

    /// Makes a step: [`GlobalSimulator::step`].
    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition>;

    /// Returns how long steps took since the last call, where it is known in parts: [`GlobalSimulator::take_watch`].
    fn take_watch(&mut self) -> Stopwatch {
        Stopwatch::default()
    }
}

/// Copies, in order.
pub enum GlobalCopies {
    /// One is at work after the other.
    Here(Vec<Box<dyn GlobalCopy>>),
    /// They may all be at work at the same time.
    Apart(Vec<Box<dyn GlobalCopy + Send>>),
}

/// Makes copies of the GS. A process that holds only one GS lets others make the rest.
pub trait MakeCopies {
    /// Makes this number of copies, at least one.
    fn make(&self, domain: &dyn Domain, copies: usize) -> Result<GlobalCopies>;
}

/// Makes all copies in this process.
pub struct InThisProcess;

impl MakeCopies for InThisProcess {
    fn make(&self, domain: &dyn Domain, copies: usize) -> Result<GlobalCopies> {
        let copy = |_| Ok(Box::new(OwnCopy(domain.global_simulator()?)) as Box<dyn GlobalCopy>);
        Ok(GlobalCopies::Here((0..copies).map(copy).collect::<Result<_>>()?))
    }
}

/// A GS in this process.
pub struct OwnCopy(pub Box<dyn GlobalSimulator>);

impl GlobalCopy for OwnCopy {
    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        self.0.reset(episode)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        self.0.step(actions)
    }

    fn take_watch(&mut self) -> Stopwatch {
        self.0.take_watch()
    }
}
