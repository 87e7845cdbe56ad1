//! The traffic domain: a grid of intersections on SUMO, every light an agent.
//!
//! - [`agents`], [`side`]: what an agent is; [`light`], [`observe`], [`arrivals`]: its actions, observations, rewards
//!   and influence sources; [`cars_at`]: the cars that they are made from.
//! - [`paper_grid`]: the road networks of the paper; [`network`]: networks as files; [`cut`]: local regions cut out of
//!   them.
//! - [`scenario`]: the scenario of a user, a .sumocfg with its files.
//! - [`sim`]: the simulators, their recordings and replays.
//! - [`controllers`]: hand-coded baselines; [`tuning`]: the search for the best fixed-time lights.
//!
//! # Words
//! - *Agent*: what runs the light of one intersection.
//! - *Intersection*: a place where roads cross under a light. *Junction* is SUMO's word, used only for SUMO's files.
//! - *Local region*: an intersection and its four incoming edges. Its agent sees nothing else.
//! - *Node*: an intersection or a dead end. *Edge*: a road from one node to the next, in one direction, with one
//!   *lane*. The three are SUMO's words.
//! - *Car*: what SUMO calls a vehicle.
//! - *Influence source*: an incoming edge of a local region, as the place where cars come in from outside.
//! - *GS*: the global simulator. *LS*: a local simulator. *AIP*: the approximate influence predictor, which predicts
//!   arrivals.
//! - *Arrival*: a car came in at a source in this step. The AIP predicts arrivals, and the GS observes them.
//! - *Placement*: where and how fast the LS puts an arriving car. A car that does not fit in is a *dropped arrival*.
//! - *Insertion*: SUMO's word for the order to let a car in. *Departure*: SUMO's word for the car that entered.
//! - *Entry*: in a recording, the car that entered and the order that SUMO got for it.
//! - *Light*: what a light shows. *Signal*: the light of one intersection under its agent, with the time that it was
//!   yellow.
//!
//! This is the only room of the library that opens [`crate::sumo`]. libsumo holds one simulation per process, so drop a
//! simulator of this room before the thread makes the next one.

pub mod agents;
pub mod arrivals;
pub mod cars_at;
pub mod controllers;
pub mod cut;
pub mod light;
pub mod network;
pub mod observe;
pub mod paper_grid;
pub mod scenario;
pub mod side;
pub mod sim;
pub mod tuning;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, ensure};

use crate::base::{AgentId, Rows, Seed};
use crate::config::TrafficConfig;
use crate::domain::{
    Baseline, Beginning, Bystander, Domain, FirstRow, GlobalSimulator, Kind, Kinds, LocalSimulator, Map, Measures,
    Result, RoughCosts, Scenario,
};
use crate::sumo::Simulation;
use agents::plan::JointPlan;
use agents::region;
use controllers::{HandCoded, Trials};
use network::contents::Network;
use network::files::NetworkFiles;
use network::way_out::{Role, cannot_be_simulated};
use paper_grid::grid::Grid;
use paper_grid::plans::joint_plan;
use paper_grid::recognise::{recognise_grid, recognise_local};
use sim::control::SignalControl;
use sim::global::GlobalTraffic;
use sim::local::{self, LocalTraffic};
use sim::recording::Tape;
use sim::tally::P_SWITCH;

/// Share of switches above which an agent is stuck: its lights are yellow most of the time. Agents that learn are near
/// 0.1 to 0.3. The local optimum of switching almost always is near 1, and random weights are near 0.5.
const STUCK_ABOVE: f64 = 0.75;

/// Returns the version of the linked SUMO, such as `SUMO 1.15.0`.
pub fn sumo_version() -> Result<String> {
    Ok(Simulation::version()?)
}

/// Returns the library whose `exp`, `ln` and so on SUMO and this program use, such as `glibc 2.36`.
pub fn libm() -> Result<String> {
    Ok(Simulation::libm()?)
}

/// Names of the two networks in a run directory, the same in every run directory.
const KEPT_AS: [&str; 2] = ["global", "local"];

/// Key of the network of the LS. Another network there is another way to train, not another scenario.
const LOCAL_NETWORK: &str = "traffic.local_network";

/// A grid of traffic lights.
#[derive(Clone)]
pub struct Traffic {
    grid: Grid,
    network: Network,
    local_network: Network,
    /// Nets that hold more than this program writes.
    strange: Vec<PathBuf>,
    config: TrafficConfig,
    plan: Arc<JointPlan>,
    tape: Option<Tape>,
}

impl Traffic {
    /// Finds the networks and compares them with what this program makes. An error says which file is missing or wrong
    /// and how to make it. Cheap: [`Traffic::check_in_sumo`] checks what only SUMO can say.
    pub fn open(config: &TrafficConfig) -> Result<Traffic> {
        let [global, local] = [&config.network, &config.local_network].map(|prefix| NetworkFiles::of(prefix));
        global.check()?;
        local.check()?;
        let local = recognise_local(&local)?;
        let global = recognise_grid(&global)?;
        let grid = global.grid;
        let strange = [&local, &global].into_iter().filter(|found| !found.is_ours);
        Ok(Traffic {
            grid,
            strange: strange.map(|found| found.network.files.net.clone()).collect(),
            network: global.network,
            local_network: local.network,
            config: config.clone(),
            plan: Arc::new(joint_plan(grid, config)),
            tape: None,
        })
    }

    /// Makes the first episode of its simulators, global or local, go on this tape.
    pub fn record_on(self, tape: &Tape) -> Traffic {
        Traffic { tape: Some(tape.clone()), ..self }
    }

    /// Returns the grid of intersections.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Loads both networks in SUMO and plays a step in each, so that a faulty network is reported before a run begins.
    /// Takes tens of milliseconds; SUMO is closed again.
    pub fn check_in_sumo(&self) -> Result<()> {
        self.try_global().with_context(|| cannot_be_simulated(&self.network.files.net, Role::Global))?;
        self.try_local().with_context(|| cannot_be_simulated(&self.local_network.files.net, Role::Local))
    }

    /// Tries the GS with the actuated lights, which need all files of the network and more of their content than the
    /// agents' control.
    fn try_global(&self) -> Result<()> {
        let mut gs = self.global(self.everywhere(HandCoded::Actuated))?;
        gs.reset(Seed::new(0))?;
        gs.step(&vec![light::KEEP; self.agents()])?;
        Ok(())
    }

    fn try_local(&self) -> Result<()> {
        let mut ls = self.local(1)?;
        ls.reset(&Beginning::first([0]))?;
        ls.step(&[light::KEEP], &Rows::from_vec(vec![1; region::EDGES], region::EDGES))?;
        let dropped = ls.counters().into_iter().find(|(name, _)| *name == local::DROPPED).map_or(0, |(_, count)| count);
        ensure!(dropped == 0, "{dropped} cars did not fit on its empty edges");
        Ok(())
    }

    /// Loads the GS with its own type, for what the trait does not offer.
    pub fn global(&self, control: SignalControl) -> Result<GlobalTraffic> {
        GlobalTraffic::load(self.plan.clone(), self.grid, &self.network, control, self.tape.as_ref())
    }

    /// Returns control of all lights by hand-coded control.
    pub fn everywhere(&self, by: HandCoded) -> SignalControl {
        SignalControl::HandCoded { by, agents: self.grid.agents() }
    }

    /// Loads an LS of `rows` rows with its own type.
    pub fn local(&self, rows: usize) -> Result<LocalTraffic> {
        LocalTraffic::load(&self.local_network, rows, &self.config, self.tape.as_ref())
    }
}

impl Trials for Traffic {
    fn load_gs(&self, by: HandCoded) -> Result<Box<dyn GlobalSimulator>> {
        Ok(Box::new(self.global(self.everywhere(by))?))
    }

    fn horizon(&self) -> usize {
        self.config.horizon
    }
}

impl Domain for Traffic {
    fn kinds(&self) -> &Kinds {
        &self.plan.kinds
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
        // An episode in which a controller measures something before it begins does not go on the tape.
        let off_tape = Traffic { tape: None, ..self.clone() };
        let by = controllers::recipe(name, self.grid)?(&off_tape)?;
        Ok(Box::new(self.global(SignalControl::HandCoded { by, agents: agents.to_vec() })?))
    }

    /// DEVIATION 11: our configs begin with a bias against switching, so that fewer agents get stuck in switching
    /// always.
    fn initial_action_bias(&self, _kind: &Kind) -> Vec<f32> {
        vec![0.0, self.config.initial_switch_bias]
    }

    fn scenario(&self) -> Result<Scenario> {
        let scenario = Scenario::new("traffic", self.agents(), self.config.horizon);
        let map = Map { rows: self.grid.rows(), columns: self.grid.cols(), first_row: FirstRow::Bottom };
        let local_network = (LOCAL_NETWORK.to_owned(), self.local_network.checksum());
        Ok(scenario.with_map(map).with_checksum(self.network.checksum()).with_files([local_network]))
    }

    fn rival(&self) -> Option<&'static str> {
        Some("actuated")
    }

    fn try_out(&self) -> Result<()> {
        self.check_in_sumo()
    }

    fn strange_files(&self) -> Vec<PathBuf> {
        self.strange.clone()
    }

    fn check_place(&self, folder: &Path) -> Result<()> {
        KEPT_AS.iter().try_for_each(|name| NetworkFiles::of(&folder.join(name)).check_paths())
    }

    fn keep_files(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        std::fs::create_dir(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        for (network, name) in [&self.network, &self.local_network].into_iter().zip(KEPT_AS) {
            network.copy_to(folder, name)?;
        }
        Ok(KEPT_AS.map(PathBuf::from).to_vec())
    }

    fn foreign_simulator(&self) -> Option<&'static str> {
        Some("SUMO")
    }

    /// Measured with traffic_4.toml and traffic_100.toml.
    fn rough_costs(&self) -> RoughCosts {
        RoughCosts {
            training_s: 37e-6,
            training_on_gs_s: 40e-6,
            influence_s: 1.6e-6,
            evaluation_s: 25e-6,
            process_mb: 120.0,
            agent_mb: 4.0,
        }
    }

    fn stuck(&self, kind: &Kind, measures: &Measures) -> Vec<bool> {
        let (_, shares) =
            measures.per_agent.iter().find(|(name, _)| *name == P_SWITCH).expect("the traffic GS measures it");
        kind.agents.iter().map(|agent| shares[agent.0] > STUCK_ABOVE).collect()
    }
}
