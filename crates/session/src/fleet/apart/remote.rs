//! Simulators in other processes, as the worker sees them.

use anyhow::ensure;

use super::process::{Ask, Begin, Bytes, Process, SimulatorLost};
use dials_core::base::{AgentId, Rows, Seed};
use dials_core::domain::{
    Action, Beginning, JointPercept, JointTransition, Kinds, LocalSimulator, Percept, RegionSpec, Result, Transition,
};
use dials_learn::environments::makers::GlobalCopy;

/// What is no picture of this domain.
fn strange() -> SimulatorLost {
    SimulatorLost("it shows what is not of this domain".to_owned())
}

/// A copy of the GS.
pub(super) struct RemoteCopy {
    process: Process,
    /// What it has shown last.
    shown: JointTransition,
}

impl RemoteCopy {
    pub(super) fn start(begin: &Begin, copy: usize, kinds: &Kinds) -> Result<RemoteCopy> {
        let name = format!("copy {copy} of the global simulator");
        Ok(RemoteCopy { process: Process::start(begin, name)?, shown: JointTransition::new(kinds) })
    }

    fn ask(&mut self, ask: &Ask) -> Result<()> {
        let (bytes, _) = self.process.ask(ask)?;
        let JointTransition { percept: JointPercept { obs, d_set, masks }, rewards } = &mut self.shown;
        let fits = bytes.read_into([obs.as_mut_slice(), d_set.as_mut_slice(), rewards], masks.as_mut_slice());
        ensure!(fits, strange());
        Ok(())
    }
}

impl GlobalCopy for RemoteCopy {
    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        self.ask(&Ask::Reset(episode))?;
        Ok(&self.shown.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        self.ask(&Ask::Step(actions.to_vec()))?;
        Ok(&self.shown)
    }
}

/// Local simulators of some agents.
pub(super) struct RemoteForest {
    process: Process,
    spec: RegionSpec,
    /// What they have shown last.
    shown: Transition,
    counters: Vec<(String, u64)>,
}

impl RemoteForest {
    /// `agents`: at least one.
    pub(super) fn start(begin: &Begin, agents: &[AgentId], copies: usize, spec: &RegionSpec) -> Result<RemoteForest> {
        let name = format!("local simulators of agents {} to {}", agents[0], agents[agents.len() - 1]);
        let (process, shown) = (Process::start(begin, name)?, Transition::new(agents.len() * copies, spec));
        Ok(RemoteForest { process, spec: spec.clone(), shown, counters: Vec::new() })
    }

    fn ask(&mut self, ask: &Ask) -> Result<()> {
        let bytes: Bytes;
        (bytes, self.counters) = self.process.ask(ask)?;
        let Transition { percept: Percept { obs, d_set, masks }, rewards } = &mut self.shown;
        let masks = masks.as_mut().map_or(&mut [][..], |masks| masks.as_mut_slice());
        let fits = bytes.read_into([obs.as_mut_slice(), d_set.as_mut_slice(), rewards], masks);
        ensure!(fits, strange());
        Ok(())
    }
}

impl LocalSimulator for RemoteForest {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn rows(&self) -> usize {
        self.shown.rewards.len()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        self.ask(&Ask::Restart(begin.iter().map(|beginning| (beginning.row, beginning.episode)).collect()))?;
        Ok(&self.shown.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        self.ask(&Ask::Drive(actions.to_vec(), Bytes(sources.as_slice().to_vec())))?;
        Ok(&self.shown)
    }

    fn counters(&self) -> Vec<(String, u64)> {
        self.counters.clone()
    }
}
