//! The traffic domain: a grid of intersections on SUMO, every light an agent.
//!
//! - [`grid`], [`net_file`], [`forest`]: the road networks, on paper and on disk.
//! - [`region`], [`signals`]: one intersection, pure: observation, d-set, reward; the light.
//! - [`global`]: the GS, a whole grid with inflow at its boundary; [`local`]: the LS, a forest of single intersections.
//! - [`controllers`]: hand-coded baselines, which see the [`junctions`].
//! - [`recording`], [`replay`]: an episode written down, and as files that SUMO plays.
//!
//! The only room that opens [`crate::sumo`]. libsumo holds one simulation per process: a simulator of this room
//! must be dropped before the thread makes the next one.

pub mod controllers;
pub mod forest;
pub mod global;
pub mod grid;
mod intersections;
pub mod junctions;
pub mod local;
mod metrics;
pub mod net_file;
pub mod recording;
pub mod region;
pub mod replay;
pub mod signals;
mod trips;

use anyhow::{Context, ensure};

use crate::base::{AgentId, Rows, Seed};
use crate::config::{PolicyConfig, TrafficConfig};
use crate::domain::{
    Baseline, Beginning, Bystander, Domain, GlobalSimulator, Kind, Kinds, LocalSimulator, Measures, Result,
};
use controllers::HandCoded;
use global::{GlobalTraffic, SignalControl};
use grid::Grid;
use local::LocalTraffic;
use net_file::NetworkFiles;
use recording::Tape;

/// The measure "share of the steps beginning with green in which the light was switched".
pub const P_SWITCH: &str = "p_switch_given_green";

/// An agent that switches this often is stuck: its lights are yellow most of the time. Agents that learn are near 0.1
/// to 0.3, the local optimum of switching almost always is near 1, and random weights are near 0.5.
const STUCK_ABOVE: f64 = 0.75;

/// What GS and LS have in common: steps of a second, and cars that wait for ever rather than teleport.
const SUMO_OPTIONS: [&str; 4] = ["--step-length", "1", "--time-to-teleport", "-1"];

/// A grid of traffic lights.
#[derive(Clone)]
pub struct Traffic {
    grid: Grid,
    network: NetworkFiles,
    local_network: NetworkFiles,
    config: TrafficConfig,
    switch_bias: f32,
    kinds: Kinds,
    tape: Option<Tape>,
}

impl Traffic {
    /// Finds the networks and holds them against what this program makes; an error says which file is missing or wrong and how
    /// to make it. Cheap: what only SUMO can say, [`Traffic::check_in_sumo`] asks.
    pub fn open(config: &TrafficConfig, policy: &PolicyConfig) -> Result<Traffic> {
        let (network, local_network) = (NetworkFiles::of(&config.network), NetworkFiles::of(&config.local_network));
        network.check()?;
        local_network.check()?;
        net_file::read_local(&local_network)?;
        net_file::for_sumo(&std::env::temp_dir()).context("forests of local simulators go there: set TMPDIR")?;
        let grid = net_file::read_grid(&network)?;
        Ok(Traffic {
            grid,
            network,
            local_network,
            config: config.clone(),
            switch_bias: policy.initial_switch_bias,
            kinds: Kinds::one(grid.agents().len(), region::spec(config.horizon, config.d_set)),
            tape: None,
        })
    }

    /// The first episode of its simulators, global or local, goes on this tape.
    pub fn record_on(self, tape: &Tape) -> Traffic {
        Traffic { tape: Some(tape.clone()), ..self }
    }

    /// Its intersections.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Loads both networks in SUMO and plays a step in each, so that what is wrong with them is told before a run begins.
    /// Tens of milliseconds; SUMO is closed again.
    pub fn check_in_sumo(&self) -> Result<()> {
        let way_out = net_file::cannot_be_simulated;
        self.try_global().with_context(|| way_out(&self.network))?;
        self.try_local().with_context(|| way_out(&self.local_network))
    }

    /// With the actuated lights, which takes all files of the network and more of them than the agents' control does.
    fn try_global(&self) -> Result<()> {
        let mut gs = self.global(self.everywhere(HandCoded::Actuated))?;
        gs.reset(Seed::new(0))?;
        gs.step(&vec![signals::KEEP; self.agents()])?;
        Ok(())
    }

    fn try_local(&self) -> Result<()> {
        let mut ls = self.local(1)?;
        ls.reset(&Beginning::first([0]))?;
        ls.step(&[signals::KEEP], &Rows::from_vec(vec![1; region::EDGES], region::EDGES))?;
        let dropped = ls.counters().into_iter().find(|(name, _)| *name == local::DROPPED).map_or(0, |(_, count)| count);
        ensure!(dropped == 0, "its empty edges let in all cars but {dropped}");
        Ok(())
    }

    pub fn networks(&self) -> [&NetworkFiles; 2] {
        [&self.network, &self.local_network]
    }

    /// The GS as itself, for what the trait does not tell.
    pub fn global(&self, control: SignalControl) -> Result<GlobalTraffic> {
        let TrafficConfig { horizon, d_set, .. } = self.config;
        GlobalTraffic::load(self.grid, &self.network, horizon, d_set, control, self.tape.as_ref())
    }

    /// All lights under hand-coded control.
    pub fn everywhere(&self, by: HandCoded) -> SignalControl {
        SignalControl::HandCoded { by, agents: self.grid.agents() }
    }

    /// An LS of so many rows as itself.
    pub fn local(&self, rows: usize) -> Result<LocalTraffic> {
        let TrafficConfig { horizon, d_set, entry, .. } = self.config;
        LocalTraffic::load(&self.local_network, rows, horizon, d_set, entry, self.tape.as_ref())
    }
}

impl Domain for Traffic {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>> {
        Ok(Box::new(self.global(SignalControl::Agents)?))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, _seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        // All intersections of a grid have the same local dynamics, so it does not matter which regions they are.
        Ok(Box::new(self.local(regions.len() * copies)?))
    }

    fn baselines(&self) -> &'static [&'static str] {
        controllers::NAMES
    }

    fn baseline(&self, name: &str) -> Result<Baseline> {
        // Hand-coded control sees more than an observation shows, so it lives in the simulator.
        let simulator = self.with_background(name, &self.grid.agents())?;
        Ok(Baseline { simulator, controller: Box::new(Bystander) })
    }

    fn check_baseline(&self, name: &str) -> Result<()> {
        controllers::recipe(name, self.grid).map(drop)
    }

    fn with_background(&self, name: &str, agents: &[AgentId]) -> Result<Box<dyn GlobalSimulator>> {
        // What a controller measures before it begins is no episode for the tape.
        let off_tape = Traffic { tape: None, ..self.clone() };
        let by = controllers::recipe(name, self.grid)?(&off_tape)?;
        Ok(Box::new(self.global(SignalControl::HandCoded { by, agents: agents.to_vec() })?))
    }

    /// DEVIATION 11: our configs begin with a bias against switching, so that fewer agents get stuck in switching always.
    fn initial_action_bias(&self, _kind: &Kind) -> Vec<f32> {
        vec![0.0, self.switch_bias]
    }

    fn stuck(&self, measures: &Measures) -> Vec<bool> {
        let (_, shares) =
            measures.per_agent.iter().find(|(name, _)| *name == P_SWITCH).expect("the traffic GS measures it");
        shares.iter().map(|&share| share > STUCK_ABOVE).collect()
    }
}
