//! Simulators in processes of their own: libsumo holds one simulation per process. So copies of the GS, and the lanes of local
//! simulators whose agents share a policy, are in processes that a worker starts.
//!
//! Once they have loaded, at most as many are at work as the worker has threads. So a run takes no more cores than it was given.
//! Those of a domain that is native are all in the worker: there learning takes the time.
//!
//! A simulator that dies takes its worker along, which is started again like any lost worker, from the last exchange.
//!
//! - `process`: a process, and what is said between the two. `serve`: its side. `remote`: it as a simulator of the worker.

mod process;
mod remote;
mod serve;

use dials_core::base::{AgentId, Seed};
use dials_core::domain::{Domain, LocalSimulator, Result};
use dials_learn::environments::makers::{GlobalCopies, GlobalCopy, InThisProcess, MakeSimulators, OwnCopy};

use process::{Begin, Role};
pub(super) use process::{SimulatorLost, take_cpu, take_footprint};
use remote::{RemoteCopy, RemoteForest};
pub use serve::serve_a_worker;

/// Makes simulators in as many processes as it takes.
pub(super) struct Apart {
    pub(super) config_json: String,
    pub(super) prepared: Option<Vec<u8>>,
    /// Number of simulators that may be computed at once.
    pub(super) at_once: usize,
}

impl Apart {
    fn begin(&self, role: Role) -> Begin {
        Begin { config_json: self.config_json.clone(), prepared: self.prepared.clone(), role }
    }
}

impl MakeSimulators for Apart {
    fn copies(&self, domain: &dyn Domain, copies: usize) -> Result<GlobalCopies> {
        if copies == 1 || domain.foreign_simulator().is_none() {
            return InThisProcess.copies(domain, copies);
        }
        // They load while this process does.
        let start = |copy| RemoteCopy::start(&self.begin(Role::Copy), copy, domain.kinds());
        if self.at_once > 1 {
            let boxed = |copy| Ok(Box::new(start(copy)?) as Box<dyn GlobalCopy + Send>);
            return Ok(GlobalCopies::Apart((0..copies).map(boxed).collect::<Result<_>>()?));
        }
        let others = (1..copies).map(start).collect::<Result<Vec<_>>>()?;
        let own = Box::new(OwnCopy(domain.global_simulator()?)) as Box<dyn GlobalCopy>;
        Ok(GlobalCopies::Here([own].into_iter().chain(others.into_iter().map(|other| Box::new(other) as _)).collect()))
    }

    fn apart(
        &self,
        domain: &dyn Domain,
        agents: &[AgentId],
        copies: usize,
        seed: Seed,
    ) -> Option<Result<Box<dyn LocalSimulator + Send>>> {
        let begin = self.begin(Role::Forest { agents: agents.to_vec(), copies, seed });
        let spec = &domain.kinds().of(agents[0]).spec;
        Some(RemoteForest::start(&begin, agents, copies, spec).map(|forest| Box::new(forest) as _))
    }
}
