//! The traffic domain: lights on SUMO, each an agent, on the paper's grids or on a scenario of the user.
//!
//! - [`agents`], [`side`]: what an agent is; [`light`], [`observe`], [`reward`], [`arrivals`]: its actions, observations,
//!   rewards and influence sources; [`cars_at`]: the cars that they are made from.
//! - [`inflow`], [`d_set`]: influence sources of a scenario, and what its AIPs (approximate influence predictors) see.
//! - [`paper_grid`]: the road networks of the paper; [`network`]: networks as files; [`cut`]: local regions cut out of
//!   them.
//! - [`scenario`]: the scenario of a user, a .sumocfg with its files.
//! - `ground`: what differs between a grid and a scenario.
//! - [`sim`]: the simulators, their recordings and replays.
//! - `task`: what a light sees, does and is paid for, in words.
//! - [`controllers`]: hand-coded baselines; [`tuning`]: the search for the best fixed-time lights.
//! - [`fidelity`]: how far the local simulators are like the global one.
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
//! This is the only room of the library that opens [`libsumo`]. libsumo holds one simulation per process, so drop a
//! simulator of this room before the thread makes the next one.

pub mod agents;
mod arrivals;
mod cars_at;
pub mod config;
pub mod controllers;
pub mod cut;
mod d_set;
pub mod fidelity;
mod ground;
mod inflow;
pub mod light;
pub mod network;
mod observe;
pub mod paper_grid;
mod reward;
pub mod scenario;
pub mod side;
pub mod sim;
mod task;
pub mod tuning;

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use anyhow::{Context, Error, bail, ensure};

use crate::config::{ScenarioConfig, TrafficConfig};
use agents::plan::{AgentPlan, Border, JointPlan};
use controllers::HandCoded;
use controllers::timing_file::TimingFile;
use dials_core::base::{AgentId, RandomPurpose, Rows, Seed};
use dials_core::domain::road_trace::RoadMap;
use dials_core::domain::{
    Baseline, Beginning, Bystander, Domain, GlobalSimulator, Kind, Kinds, LocalSimulator, Measures, Result, RoughCosts,
    Scenario, Task,
};
use ground::on_grid::OnGrid;
use ground::on_scenario::OnScenario;
use ground::{About, Ground};
use libsumo::Simulation;
use paper_grid::grid::Grid;
use paper_grid::plans::joint_plan;
use scenario::SumoScenario;
use sim::control::SignalControl;
use sim::global::GlobalTraffic;
use sim::local::LocalTraffic;
use sim::local_scenario::LocalScenario;
use sim::recording::Tape;
use sim::tally::P_SWITCH;
use sim::trace::road_map;
use sim::trace::route::Route;
use sim::visit_tables::VisitTables;
use sim::visits::Visits;
use sim::visits_as_bytes;

/// Longest time in which SUMO reads the demand of a scenario for a trial. What comes later in an episode is tried by the
/// first one.
const DEMAND_PATIENCE: Duration = Duration::from_secs(10);

/// Returns the version of the linked SUMO, such as `SUMO 1.15.0`.
pub fn sumo_version() -> Result<String> {
    Ok(Simulation::version()?)
}

/// Returns the library whose `exp`, `ln` and so on SUMO and this program use, such as `glibc 2.36`.
pub fn libm() -> Result<String> {
    Ok(Simulation::libm()?)
}

/// Traffic lights on a road network.
#[derive(Clone)]
pub struct Traffic {
    plan: Arc<JointPlan>,
    ground: Arc<dyn Ground>,
    tape: Option<Tape>,
    /// Visits to the regions, once they were recorded.
    visits: Arc<OnceLock<Arc<VisitTables>>>,
}

impl Traffic {
    /// Finds the networks of a grid and compares them with what this program makes. An error says which file is missing
    /// or wrong and how to make it. Cheap: [`Traffic::check_in_sumo`] checks what only SUMO can say.
    pub fn open(config: &TrafficConfig) -> Result<Traffic> {
        let ground = OnGrid::open(config)?;
        Ok(Traffic {
            plan: Arc::new(joint_plan(ground.shape(), config)),
            ground: Arc::new(ground),
            tape: None,
            visits: Arc::default(),
        })
    }

    /// Reads a scenario of the user. An error says which file is missing or wrong, and what to do. Cheap, like
    /// [`Traffic::open`].
    pub fn open_scenario(config: &ScenarioConfig) -> Result<Traffic> {
        Ok(Traffic::on_scenario(OnScenario::open(config)?))
    }

    /// Reads a scenario of the user, in which all cars dawdle as much as `sigma` says: from 0, never, to 1.
    pub fn open_dawdling(config: &ScenarioConfig, sigma: f64) -> Result<Traffic> {
        Ok(Traffic::on_scenario(OnScenario::of(SumoScenario::read(config)?.dawdling(sigma), config)?))
    }

    fn on_scenario(ground: OnScenario) -> Traffic {
        Traffic { plan: Arc::new(ground.joint_plan()), ground: Arc::new(ground), tape: None, visits: Arc::default() }
    }

    /// Returns the borders of the agents' regions, in their order. A grid of the paper has none.
    pub fn borders(&self) -> &[Border] {
        &self.plan.borders
    }

    /// Returns the visits to the regions of a scenario in an episode on the GS (global simulator), in which all lights
    /// follow their own programs. The episode is always the same one. It is played at the first call; then no other
    /// simulator may be loaded.
    pub fn visits(&self) -> Result<Arc<VisitTables>> {
        if let Some(known) = self.visits.get() {
            return Ok(known.clone());
        }
        let off_tape = Traffic { tape: None, ..self.clone() };
        let mut gs = off_tape.global(self.everywhere(HandCoded::OwnProgram))?;
        gs.record_visits()?;
        gs.reset(Seed::new(0).fork(RandomPurpose::Visits))?;
        let actions = vec![light::KEEP; self.agents()];
        for _ in 0..self.about().horizon {
            gs.step(&actions)?;
        }
        let visits = gs.visits().context("only the regions of a scenario have visits")?.clone();
        let tables = Arc::new(VisitTables::new(visits, &self.plan.borders));
        Ok(self.visits.get_or_init(|| tables).clone())
    }

    fn about(&self) -> &About {
        self.ground.about()
    }

    /// Makes the first episode of its simulators, global or local, go on this tape.
    pub fn record_on(self, tape: &Tape) -> Traffic {
        Traffic { tape: Some(tape.clone()), ..self }
    }

    /// Returns the grid of intersections, if it is one.
    pub fn grid(&self) -> Option<Grid> {
        self.about().grid
    }

    /// Returns the plans of all agents, in their order.
    pub fn plans(&self) -> &[AgentPlan] {
        &self.plan.agents
    }

    /// Loads everything in SUMO and plays a step, and lets SUMO read the demand of a scenario, so that what is wrong is
    /// reported before a run begins. For a grid it takes tens of milliseconds; SUMO is closed again.
    pub fn check_in_sumo(&self) -> Result<()> {
        // That SUMO's library is missing, or too large for this process, is no fault of the network.
        libsumo::load()?;
        let tried = self.try_global().and_then(|()| self.ground.source()?.try_demand(DEMAND_PATIENCE));
        tried.with_context(|| self.about().cannot_be_simulated.clone())?;
        self.ground.try_local()
    }

    /// Tries the GS with the actuated lights, which need all files of the network and more of their content than the
    /// agents' control. Where SUMO refuses these lights, it tries the agents' control.
    fn try_global(&self) -> Result<()> {
        let control = match self.about().refuses_actuated {
            None => self.everywhere(HandCoded::Actuated),
            Some(_) => SignalControl::Agents,
        };
        let mut gs = self.global(control)?;
        gs.reset(Seed::new(0))?;
        gs.step(&vec![light::KEEP; self.agents()])?;
        Ok(())
    }

    /// Loads the GS with its own type, for what the trait does not offer.
    pub fn global(&self, control: SignalControl) -> Result<GlobalTraffic> {
        let tape = self.tape.as_ref().map(|tape| Ok::<_, Error>((tape, self.ground.recorded()?))).transpose()?;
        if let Some(why) = self.about().refuses_actuated.as_ref().filter(|_| control.is_actuated()) {
            bail!("{why}");
        }
        Ok(GlobalTraffic::load(self.plan.clone(), self.ground.source()?, control, tape)?.on(self.ground.clone()))
    }

    /// Returns the length of an episode in seconds.
    pub fn seconds(&self) -> usize {
        self.about().horizon * self.plan.decision_steps
    }

    /// Returns the length of an episode of the local simulators in seconds.
    pub fn local_seconds(&self) -> usize {
        self.plan.kinds.specs().map(|spec| spec.local_horizon).max().unwrap_or(0) * self.plan.decision_steps
    }

    /// Reads the way along which pictures show the cars of a scenario: edges that follow each other, separated by commas.
    pub fn route(&self, edges: &str) -> Result<Route> {
        self.ground.route(edges)
    }

    /// Returns the map of a scenario. `None`: a grid, which needs none. No simulator is loaded.
    pub fn road_map(&self) -> Result<Option<RoadMap>> {
        Ok(road_map(&self.ground.recorded()?))
    }

    /// Returns control of all lights by hand-coded control.
    pub fn everywhere(&self, by: HandCoded) -> SignalControl {
        SignalControl::HandCoded { by, agents: AgentId::all(self.agents()) }
    }

    /// Loads an LS of `rows` rows of a grid with its own type.
    pub fn local(&self, rows: usize) -> Result<LocalTraffic> {
        self.ground.local(rows, self.tape.as_ref())
    }
}

impl Domain for Traffic {
    fn kinds(&self) -> &Kinds {
        &self.plan.kinds
    }

    fn agent_name(&self, agent: AgentId) -> String {
        self.plan.agents[agent.0].light.clone()
    }

    fn task(&self, agent: AgentId) -> Task {
        task::task(&self.plan, agent)
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>> {
        Ok(Box::new(self.global(SignalControl::Agents)?))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        if let Some(parts) = self.ground.local_parts()? {
            let ls = LocalScenario::load(&parts, &self.plan, self.visits()?, regions, copies, seed)?;
            let recorded = match &self.tape {
                Some(tape) => ls.record_on(tape, &parts)?,
                None => ls,
            };
            return Ok(Box::new(recorded));
        }
        // All intersections of a grid have the same local dynamics. Only their clocks may differ.
        let clock_of = |agent: &AgentId| self.plan.agents[agent.0].sensor.clock_ahead;
        let clocks_ahead = regions.iter().flat_map(|agent| vec![clock_of(agent); copies]).collect();
        Ok(Box::new(self.local(regions.len() * copies)?.with_clocks_ahead(clocks_ahead)))
    }

    fn baselines(&self) -> &'static [&'static str] {
        controllers::NAMES
    }

    fn baseline(&self, name: &str) -> Result<Baseline> {
        // Hand-coded control sees more than an observation shows, so it lives in the simulator.
        let simulator = self.with_background(name, &AgentId::all(self.agents()))?;
        Ok(Baseline { simulator, controller: Box::new(Bystander) })
    }

    fn check_baseline(&self, name: &str) -> Result<()> {
        controllers::recipe(name, self.plans()).map(drop)
    }

    fn baseline_checksum(&self, name: &str) -> Result<Option<u32>> {
        controllers::file_of(name)?.map(TimingFile::checksum).transpose()
    }

    fn with_background(&self, name: &str, agents: &[AgentId]) -> Result<Box<dyn GlobalSimulator>> {
        // An episode in which a controller measures something before it begins does not go on the tape.
        let off_tape = Traffic { tape: None, ..self.clone() };
        let by = controllers::recipe(name, self.plans())?(&off_tape)?;
        Ok(Box::new(self.global(SignalControl::HandCoded { by, agents: agents.to_vec() })?))
    }

    fn initial_action_bias(&self, kind: &Kind) -> Vec<f32> {
        let mut biases = vec![0.0; kind.spec.n_actions];
        if let Some(bias) = biases.get_mut(usize::from(light::SWITCH)) {
            *bias = self.about().switch_bias;
        }
        biases
    }

    fn scenario(&self) -> Result<Scenario> {
        Ok(self
            .ground
            .scenario(self.agents())?
            .with_rules(task::rules(&self.plan), self.about().unusual_reward.clone()))
    }

    fn rival(&self) -> Option<&'static str> {
        Some(self.about().rival)
    }

    fn try_out(&self) -> Result<()> {
        self.check_in_sumo()
    }

    fn try_local(&self) -> Result<()> {
        // That of a grid was tried with its other files.
        let Some(parts) = self.ground.local_parts()? else { return Ok(()) };
        let nobody = Visits { of_agents: vec![Vec::new(); self.agents()], seconds: self.seconds() };
        let tables = Arc::new(VisitTables::new(nobody, &self.plan.borders));
        let all = AgentId::all(self.agents());
        let mut ls = LocalScenario::load(&parts, &self.plan, tables, &all, 1, Seed::new(0))?;
        ls.reset(&Beginning::first(0..all.len()))?;
        let no_arrival = Rows::new(all.len(), ls.spec().sources.count());
        ls.step(&vec![0; all.len()], &no_arrival)?;
        Ok(())
    }

    fn strange_files(&self) -> Vec<PathBuf> {
        self.about().strange_files.clone()
    }

    fn left_out(&self) -> Vec<String> {
        self.about().left_out.clone()
    }

    fn check_place(&self, folder: &Path) -> Result<()> {
        self.ground.check_place(folder)
    }

    fn keep_files(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        self.ground.keep_files(folder)
    }

    fn prepare(&self) -> Result<Option<Vec<u8>>> {
        let differ = self.ground.local_parts()?.is_some();
        differ.then(|| visits_as_bytes::to_bytes(self.visits()?.visits())).transpose()
    }

    fn take_prepared(&self, prepared: &[u8]) -> Result<()> {
        let visits = visits_as_bytes::from_bytes(prepared)?;
        ensure!(visits.of_agents.len() == self.agents(), "these are visits to other regions");
        self.visits.get_or_init(|| Arc::new(VisitTables::new(visits, &self.plan.borders)));
        Ok(())
    }

    fn simulator_steps_per_timestep(&self) -> usize {
        self.plan.decision_steps
    }

    fn foreign_simulator(&self) -> Option<&'static str> {
        Some("SUMO")
    }

    fn rough_costs(&self) -> RoughCosts {
        self.about().rough_costs
    }

    fn stuck(&self, kind: &Kind, measures: &Measures) -> Vec<bool> {
        let (_, shares) =
            measures.per_agent.iter().find(|(name, _)| *name == P_SWITCH).expect("the traffic GS measures it");
        kind.agents.iter().map(|agent| (self.about().is_stuck)(shares[agent.0])).collect()
    }
}
