//! Who makes the simulators that policies train on. A process that can hold only one lets others make the rest.

use dials_core::base::{AgentId, Seed, Stopwatch};
use dials_core::domain::{Action, Domain, GlobalSimulator, JointPercept, JointTransition, LocalSimulator, Result};

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

/// Makes simulators.
pub trait MakeSimulators {
    /// Makes this number of copies of the GS, at least one.
    fn copies(&self, domain: &dyn Domain, copies: usize) -> Result<GlobalCopies>;

    /// Makes the local simulators of some agents of a kind ([`Domain::local_simulator`]) in another process; `None` if all must be
    /// here.
    fn apart(
        &self,
        domain: &dyn Domain,
        agents: &[AgentId],
        copies: usize,
        seed: Seed,
    ) -> Option<Result<Box<dyn LocalSimulator + Send>>>;
}

/// Makes all simulators in this process.
pub struct InThisProcess;

impl MakeSimulators for InThisProcess {
    fn copies(&self, domain: &dyn Domain, copies: usize) -> Result<GlobalCopies> {
        let copy = |_| Ok(Box::new(OwnCopy(domain.global_simulator()?)) as Box<dyn GlobalCopy>);
        Ok(GlobalCopies::Here((0..copies).map(copy).collect::<Result<_>>()?))
    }

    fn apart(
        &self,
        _domain: &dyn Domain,
        _agents: &[AgentId],
        _copies: usize,
        _seed: Seed,
    ) -> Option<Result<Box<dyn LocalSimulator + Send>>> {
        None
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
