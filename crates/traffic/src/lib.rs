//! The traffic domain: lights on SUMO, each an agent, on the paper's grids or on a scenario of the user.
//!
//! - [`agents`], [`side`]: what an agent is; [`light`], [`observe`], [`reward`], [`inflow`]: its actions, observations,
//!   rewards and influence sources; [`cars_at`]: the cars that they are made from; [`d_set`]: what its AIP sees on a
//!   scenario; `task`: all of it in words.
//! - [`paper_grid`]: the road networks of the paper; [`network`]: networks as files; [`cut`]: local regions cut out of
//!   them; [`scenario`]: the scenario of a user, a .sumocfg with its files.
//! - `road_network`: a grid or a scenario, and what differs between them.
//! - `domain`: traffic as the training asks for it; `trial`: SUMO judges what can be simulated.
//! - `prepared`: what local simulators of a scenario are made from, kept and sent as bytes.
//! - [`sim`]: the simulators, their recordings and replays.
//! - [`streets`]: the roads of a net, for maps.
//! - `own`: rewards and observations that are functions of the user.
//! - [`counts`]: from traffic counts to routes.
//! - [`controllers`]: hand-coded baselines; [`tuning`]: the search for the best fixed-time lights. [`timing`]: plans of
//!   them that plain SUMO plays.
//! - [`events`]: the event log of the street, as a signal controller writes it.
//! - [`fidelity`]: how far the local simulators are like the global one.
//!
//! # Words
//! - *GS*: the global simulator. *LS*: a local simulator. *AIP*: the approximate influence predictor, which predicts
//!   arrivals. *D-set*: the variables that it predicts from.
//! - *Intersection*: a place where roads cross under a light. *Junction* is SUMO's word, used only for SUMO's files, and
//!   so are *edge* (a road from one node to the next, in one direction) and *lane*. A *car* is SUMO's vehicle.
//! - *Local region*: an intersection and the roads that lead to it. Its agent sees nothing else.
//! - *Arrival*: a car came into a local region in this step. A sampled arrival without room on a grid is a *dropped arrival*.
//! - *Insertion*: SUMO's word for the order to let a car in. *Departure*: SUMO's word for the car that entered.
//! - *Light*: what a light shows. *Signal*: the light under its agent, with the time for which it has shown that.
//!
//! Only this crate opens [`libsumo`], which holds one simulation per process. So drop a simulator before the thread makes
//! the next one.

pub mod agents;
pub mod any_light;
mod cars_at;
pub mod config;
pub mod controllers;
pub mod counts;
pub mod cut;
mod d_set;
mod domain;
pub mod events;
pub mod fidelity;
mod inflow;
mod lane_sets;
pub mod light;
#[cfg(test)]
mod light_limits_test;
pub mod network;
mod observe;
mod own;
pub mod paper_grid;
mod prepared;
mod reward;
mod road_network;
pub mod scenario;
pub mod side;
pub mod sim;
pub mod streets;
mod task;
pub mod timing;
mod trial;
pub mod tuning;
#[cfg(test)]
mod watchdog;

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use anyhow::{Context, bail, ensure};

use crate::config::python::Functions;
use crate::config::{ScenarioConfig, TrafficConfig};
use agents::plan::{AgentPlan, Border, JointPlan};
use any_light::AnyLight;
use controllers::HandCoded;
use dials_core::base::{AgentId, RandomPurpose, Seed};
use dials_core::domain::road_trace::RoadMap;
use dials_core::domain::{Domain, GlobalSimulator, Result};
use events::EventLog;
use events::site::Site;
use libsumo::Simulation;
pub use libsumo::{Error as SumoError, Library as Sumo, Place as SumoPlace};
use own::Own;
use paper_grid::grid::Grid;
use road_network::{Files, RoadNetwork, open_grid, scenario as of_scenario};
use scenario::SumoScenario;
use scenario::closing::Detours;
use sim::control::SignalControl;
use sim::global::GlobalTraffic;
use sim::local::{Demand, LocalTraffic};
use sim::local_forest::{LocalForest, rows_of};
use sim::recording::{Recorder, Tape};
use sim::trace::map;
use sim::trace::route::Route;
use sim::visit_tables::VisitTables;
use sim::visits::Visits;
use sim::watched;

/// Largest number of episodes in which visits are recorded, if each plays one of several route files.
const MOST_WATCHED: usize = 5;

/// Returns the SUMO that this process simulates with.
pub fn sumo() -> std::result::Result<&'static Sumo, SumoError> {
    libsumo::load()
}

/// Returns the places where SUMO is looked for, in order.
pub fn sumo_places() -> Vec<SumoPlace> {
    libsumo::places()
}

/// Returns the file of a program of the same SUMO, such as `netconvert`.
pub fn sumo_program(name: &str) -> Option<PathBuf> {
    libsumo::program(name)
}

/// Returns a variable of the environment that lets a worker use the SUMO of this process. `None`: it has not used any yet.
pub fn sumo_for_children() -> Option<(&'static str, &'static Path)> {
    libsumo::variable_for_children()
}

/// Returns the library whose `exp`, `ln` and so on SUMO and this program use, such as `glibc 2.36`.
pub fn libm() -> String {
    Simulation::libm()
}

#[derive(Clone)]
pub struct Traffic {
    plan: Arc<JointPlan>,
    network: Arc<RoadNetwork>,
    tape: Option<Tape>,
    events: Option<EventLog>,
    visits: Arc<OnceLock<Arc<VisitTables>>>,
    /// Traffic on which controllers such as `webster` measure what they need. `None`: this one.
    planned_for: Option<Arc<Traffic>>,
    own: Own,
}

impl Traffic {
    /// Finds the networks of a grid and compares them with what this program makes. An error says which file is missing
    /// or wrong and how to make it. Cheap: [`Domain::try_out`] checks what only SUMO can say.
    pub fn open(config: &TrafficConfig) -> Result<Traffic> {
        let traffic = open_grid(config).map(Traffic::new)?;
        traffic.with_functions(&config.functions())
    }

    /// Reads a scenario of the user. An error says what is wrong and what to do. Cheap, like [`Traffic::open`].
    pub fn open_scenario(config: &ScenarioConfig) -> Result<Traffic> {
        let traffic = of_scenario::open(SumoScenario::read(config)?, config).map(Traffic::new)?;
        traffic.with_functions(&config.functions())
    }

    /// Reads a scenario of the user, in which all cars dawdle as much as `sigma` says: from 0, never, to 1.
    pub fn open_dawdling(config: &ScenarioConfig, sigma: f64) -> Result<Traffic> {
        let traffic = of_scenario::open(SumoScenario::read(config)?.dawdling(sigma)?, config).map(Traffic::new)?;
        traffic.with_functions(&config.functions())
    }

    fn new((network, plan): (RoadNetwork, JointPlan)) -> Traffic {
        Traffic {
            plan: Arc::new(plan),
            network: Arc::new(network),
            tape: None,
            events: None,
            visits: Arc::default(),
            planned_for: None,
            own: Own::default(),
        }
    }

    fn with_functions(self, names: &Functions<'_>) -> Result<Traffic> {
        Ok(Traffic { own: Own::of(names, &self.plan.kinds)?, ..self })
    }

    /// Returns the borders of the agents' regions, in their order. A grid of the paper has none.
    pub fn borders(&self) -> &[Border] {
        &self.plan.borders
    }

    /// Returns the visits to the regions of a scenario in one episode on the GS, always the same one, in which all lights
    /// follow their own programs. If each episode plays one of several route files, these are the visits of several episodes,
    /// with files from all over the list. They are played at the first call; then no other simulator may be loaded.
    pub fn visits(&self) -> Result<Arc<VisitTables>> {
        if let Some(known) = self.visits.get() {
            return Ok(known.clone());
        }
        let mut gs = self.off_tape().global(self.everywhere(HandCoded::OwnProgram))?;
        gs.record_visits()?;
        let actions = vec![light::KEEP; self.agents()];
        let files = self.network.route_files();
        let episodes = files.clamp(1, MOST_WATCHED);
        let mut visits: Option<Visits> = None;
        for episode in 0..episodes {
            gs.play_only(episode * files / episodes);
            gs.reset(Seed::new(0).fork(RandomPurpose::Visits))?;
            for _ in 0..self.network.horizon {
                gs.step(&actions)?;
            }
            let seen = gs.visits().context("only the regions of a scenario have visits")?.clone();
            match &mut visits {
                None => visits = Some(seen),
                Some(visits) => visits.extend(seen),
            }
        }
        let visits = visits.expect("at least one episode was played");
        let tables = Arc::new(VisitTables::new(visits, &self.plan.borders));
        Ok(self.visits.get_or_init(|| tables).clone())
    }

    /// Lets controllers that measure flows before an episode, such as `webster`, do so on other traffic with the same lights: so a
    /// plan for the usual demand can meet another one.
    pub fn planned_for(self, usual: Traffic) -> Traffic {
        Traffic { planned_for: Some(Arc::new(usual)), ..self }
    }

    /// Returns what becomes of vehicles because of closed edges. `None`: all edges are open.
    pub fn detours(&self) -> Option<Detours> {
        match &self.network.files {
            Files::Grid(_) => None,
            Files::Scenario(files) => files.files.detours(),
        }
    }

    /// Checks that the net has these edges.
    pub fn check_edges(&self, ids: &[String]) -> Result<()> {
        let Files::Scenario(files) = &self.network.files else { bail!("the edges of a grid cannot be closed") };
        files.files.check_edges(ids)
    }

    /// Returns the street of each of these edges; `None` for one whose street the net does not name. A grid names none.
    pub fn streets_of(&self, ids: &[String]) -> Result<Vec<Option<String>>> {
        match &self.network.files {
            Files::Grid(_) => Ok(vec![None; ids.len()]),
            Files::Scenario(files) => files.files.streets_of(ids),
        }
    }

    fn off_tape(&self) -> Traffic {
        Traffic { tape: None, events: None, ..self.clone() }
    }

    /// Makes the first episode of its simulators, global or local, go on this tape.
    pub fn record_on(self, tape: &Tape) -> Traffic {
        Traffic { tape: Some(tape.clone()), ..self }
    }

    /// Makes the episodes that its global simulators play and [measure in full](GlobalSimulator::measure_in_full) go into
    /// this log.
    pub fn log_events(self, log: &EventLog) -> Traffic {
        Traffic { events: Some(log.clone()), ..self }
    }

    /// Returns the lights with the phases and detectors that the event log knows.
    pub fn sites(&self) -> Result<Vec<Site>> {
        self.network.sites(&self.plan)
    }

    pub fn grid(&self) -> Option<Grid> {
        self.network.grid()
    }

    pub fn plans(&self) -> &[AgentPlan] {
        &self.plan.agents
    }

    /// Returns the route file that an episode plays, if each plays one of several.
    pub fn route_file_of(&self, episode: Seed) -> Option<PathBuf> {
        let Files::Scenario(files) = &self.network.files else { return None };
        let number = files.files.drawn_by(episode)?;
        files.files.drawn_files().nth(number).map(Path::to_owned)
    }

    /// Returns the policy of all agents as one for any light. `hidden`: widths of its layers. An error says why it is none.
    pub fn any_light(&self, hidden: &[usize], parameters: &[f32]) -> Result<AnyLight> {
        AnyLight::new(self.plans(), self.plan.decision_steps as u32, hidden, parameters)
    }

    pub fn global(&self, control: SignalControl) -> Result<GlobalTraffic> {
        if let Some(why) = self.network.refuses_actuated.as_ref().filter(|_| control.is_actuated()) {
            bail!("{why}");
        }
        GlobalTraffic::new(self.plan.clone(), self.network.clone(), control, self.tape.as_ref(), self.events.as_ref())
    }

    /// Returns the seconds of the simulation at which an episode begins and ends.
    pub(crate) fn window_s(&self) -> (u64, u64) {
        let begin_s = self.network.begin_s();
        (begin_s, begin_s + self.seconds() as u64)
    }

    pub fn seconds(&self) -> usize {
        self.network.horizon * self.plan.decision_steps
    }

    pub fn local_seconds(&self) -> usize {
        self.plan.kinds.specs().map(|spec| spec.local_horizon).max().unwrap_or(0) * self.plan.decision_steps
    }

    /// Reads the way along which pictures show the cars of a scenario: edges that follow each other, separated by commas.
    pub fn route(&self, edges: &str) -> Result<Route> {
        let Files::Scenario(files) = &self.network.files else {
            bail!(
                "only a scenario has routes to choose from; on a grid the middle row is drawn, so leave the option out"
            )
        };
        Route::read(edges, &files.files.roads()?).with_context(|| files.files.net_path().display().to_string())
    }

    /// Returns the map of a scenario. `None`: a grid, which needs none. No simulator is loaded.
    pub fn road_map(&self) -> Result<Option<RoadMap>> {
        let roads = self.network.recorded(&self.plan)?;
        Ok(roads.grid().is_none().then(|| map(&roads)))
    }

    /// Returns the controller that a name means. What it needs to know is measured first, on simulators of its own.
    pub fn hand_coded(&self, name: &str) -> Result<HandCoded> {
        // An episode in which a controller measures something before it begins does not go on the tape.
        let measured = self.planned_for.as_deref().unwrap_or(self).off_tape();
        controllers::recipe(name, self.plans())?(&measured)
    }

    pub fn everywhere(&self, by: HandCoded) -> SignalControl {
        SignalControl::HandCoded { by, agents: AgentId::all(self.agents()) }
    }

    /// Loads an LS of `rows` rows, all of the first region, with its own type.
    pub fn local(&self, rows: usize) -> Result<LocalTraffic> {
        self.load_local(&[AgentId(0)], rows, Seed::new(0))
    }

    fn load_local(&self, regions: &[AgentId], copies: usize, seed: Seed) -> Result<LocalTraffic> {
        ensure!(!regions.is_empty() && copies > 0, "a forest of 0 regions: needs at least one");
        let rows = rows_of(regions, copies, seed);
        let (demand, mut forest) = match &self.network.files {
            Files::Grid(files) => {
                // All intersections of a grid have the same local dynamics.
                let forest = LocalForest::of_grid(&files.local_network, &self.plan, &rows)?;
                (Demand::Rule(files.config.entry), forest)
            }
            Files::Scenario(files) => {
                let (parts, tables) = (files.local_parts()?, self.visits()?);
                let forest = LocalForest::of_scenario(&parts, &self.plan, &tables, &rows)?;
                (Demand::Visits(tables), forest)
            }
        };
        let record = |tape| {
            let (roads, prefix) = self.network.recorded_local(&self.plan, &forest)?;
            Recorder::new(tape, &mut forest.simulation, roads, prefix)
        };
        let recorder = self.tape.as_ref().map(record).transpose()?;
        Ok(LocalTraffic::new(self.plan.clone(), demand, forest, recorder, self.network.travellers()))
    }
}
