//! SUMO tries out a network and its demand: it judges what can be simulated.

use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};

use crate::controllers::HandCoded;
use crate::network::way_out::{Role, cannot_be_simulated};
use crate::road_network::Files;
use crate::sim::control::SignalControl;
use crate::sim::local::DROPPED;
use crate::sim::visit_tables::VisitTables;
use crate::sim::visits::Visits;
use crate::{Traffic, light};
use dials_core::base::{AgentId, Rows, Seed};
use dials_core::domain::{Beginning, Domain, GlobalSimulator, LocalSimulator, Result};

/// Longest time in which SUMO reads the demand of a scenario for a trial. The first episode tries what comes later.
const DEMAND_PATIENCE: Duration = Duration::from_secs(10);

/// Seed of the episode in which the GS is tried.
const TRIAL: u64 = 0;

impl Traffic {
    /// Tries the GS and the demand, and the local simulator of a grid. Returns what SUMO warns of.
    pub(crate) fn try_all(&self) -> Result<Vec<String>> {
        // That SUMO's library is missing, or too large for this process, is no fault of the network.
        libsumo::load()?;
        self.try_global().with_context(|| self.network.cannot_be_simulated(TRIAL))?;
        let warnings = self.try_demand()?;
        if let Files::Grid(files) = &self.network.files {
            self.try_local_step(&[AgentId(0)], 1)
                .with_context(|| cannot_be_simulated(&files.local_network.files.net, Role::Local))?;
        }
        Ok(warnings)
    }

    /// Tries the local simulators of a scenario, into which no car comes.
    pub(crate) fn try_empty_local(&self) -> Result<()> {
        // That of a grid was tried with its other files.
        if self.grid().is_some() {
            return Ok(());
        }
        let nobody =
            Visits { of_agents: vec![Vec::new(); self.agents()], drivers: Vec::new(), seconds: self.seconds() };
        let tables = Arc::new(VisitTables::new(nobody, &self.plan.borders));
        let traffic = Traffic { visits: Arc::new(OnceLock::from(tables)), ..self.clone() };
        traffic.try_local_step(&AgentId::all(self.agents()), 0)
    }

    /// Loads a local simulator of each of these regions and plays a step. `arrive`: 1 if cars arrive at all sources.
    fn try_local_step(&self, regions: &[AgentId], arrive: u8) -> Result<()> {
        let mut ls = self.off_tape().load_local(regions, 1, Seed::new(0))?;
        ls.reset(&Beginning::first(0..regions.len()))?;
        let sources = ls.spec().sources.count();
        let sources = Rows::from_vec(vec![arrive; regions.len() * sources], sources);
        ls.step(&vec![light::KEEP; regions.len()], &sources)?;
        let dropped = ls.counters().into_iter().find(|(name, _)| name == DROPPED).map_or(0, |(_, count)| count);
        ensure!(dropped == 0, "{dropped} cars did not fit on its empty edges");
        Ok(())
    }

    /// Tries the GS with the actuated lights, which need all files of the network and more of their content than the
    /// agents' control. Where SUMO refuses these lights, it tries the agents' control.
    fn try_global(&self) -> Result<()> {
        let control = match self.network.refuses_actuated {
            None => self.everywhere(HandCoded::Actuated),
            Some(_) => SignalControl::Agents,
        };
        let mut gs = self.global(control)?;
        gs.reset(Seed::new(TRIAL))?;
        gs.step(&vec![light::KEEP; self.agents()])?;
        Ok(())
    }

    /// Returns what SUMO warns of in the demand. Of several route files it tries as many as it has time for.
    fn try_demand(&self) -> Result<Vec<String>> {
        let files = self.network.route_files();
        if files == 0 {
            let tried = self.network.source(None).and_then(|source| source.try_demand(DEMAND_PATIENCE));
            return tried.with_context(|| self.network.cannot_be_simulated(TRIAL));
        }
        let begun = Instant::now();
        let mut warnings = Vec::new();
        for number in 0..files {
            let left = DEMAND_PATIENCE.saturating_sub(begun.elapsed());
            if left.is_zero() {
                warnings.push(format!(
                    "SUMO has tried {number} of {files} route files (traffic.routes); the others when an episode plays them"
                ));
                break;
            }
            let scenario = self.network.playing(number)?;
            let tried = self.network.source(Some(&scenario)).and_then(|source| source.try_demand(left));
            let found = tried.with_context(|| scenario.cannot_be_simulated())?;
            found.into_iter().for_each(|warning| {
                if !warnings.contains(&warning) {
                    warnings.push(warning)
                }
            });
        }
        Ok(warnings)
    }
}
