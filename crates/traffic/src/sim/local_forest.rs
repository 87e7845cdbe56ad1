//! Loads the local nets of a scenario into SUMO: text of the forest, routes, types and options, and numbers for all that
//! a row needs.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context;
use rand::Rng;

use super::handles::{IntersectionHandles, Place};
use super::options;
use super::visit_tables::VisitTables;
use super::ways::Ways;
use crate::agents::plan::JointPlan;
use crate::cut::local_net::LocalNet;
use crate::cut::mixed::{APART, MixedForest, prefix};
use crate::cut::names::prefixed;
use crate::network::loadable::explain;
use crate::network::memory_file::MemoryFile;
use crate::network::xml::{document, leaf};
use dials_core::base::{AgentId, Dice, Seed};
use dials_core::domain::Result;
use libsumo::{DepartSpeed, Entering, Insertion, LaneId, LightId, RouteId, Simulation, TypeId};

/// Type of a car if the recording has no car at all: SUMO's own one.
const OWN_TYPE: &str = "DEFAULT_VEHTYPE";

/// What local simulators of a scenario are made of.
pub(crate) struct LocalParts {
    /// Local net of each agent, in their order.
    pub(crate) nets: Vec<LocalNet>,
    /// Text of a file with all vehicle types.
    pub(crate) types: String,
    /// Options of SUMO that say how cars drive, without `--`.
    pub(crate) options: Vec<(String, String)>,
    /// The scenario, as the user knows it.
    pub(crate) name: String,
}

/// A loaded forest.
pub(crate) struct LocalForest {
    pub(crate) simulation: Simulation,
    pub(crate) rows: Vec<RowPlace>,
    /// Lights and approaches, one row each.
    pub(crate) handles: IntersectionHandles,
    /// Names of vehicle types, with their numbers. The first one is the usual one.
    types: Vec<(String, TypeId)>,
    /// Types and speed factors of the cars that entered on the road apart, one in each second so far.
    pub(crate) first: Vec<(String, f64)>,
}

/// What SUMO has of a row.
pub(crate) struct RowPlace {
    pub(crate) agent: AgentId,
    /// Root of the row's random streams.
    pub(crate) seed: Seed,
    /// All lanes, also those behind the exits. They have consecutive numbers.
    pub(crate) lanes: Vec<LaneId>,
    pub(crate) first_lane: u32,
    /// Lanes of the border plan, in its order.
    pub(crate) border: Vec<LaneId>,
    /// Lanes on which cars leave the light, in the order of the region plan.
    pub(crate) exits: Vec<LaneId>,
    pub(crate) gate: Option<RowGate>,
    pub(crate) ways: Arc<Ways>,
    /// Routes by their numbers in `ways`.
    pub(crate) routes: Vec<RouteId>,
}

/// The light at the exits of a row.
pub(crate) struct RowGate {
    pub(crate) light: LightId,
    /// Number of letters.
    pub(crate) letters: usize,
    /// Letter of each exit of the border plan.
    pub(crate) of_exit: Vec<Option<usize>>,
}

impl LocalForest {
    /// Loads `copies` of each of these regions, ordered by region, then copy.
    pub(crate) fn load(
        parts: &LocalParts,
        plan: &JointPlan,
        tables: &VisitTables,
        (regions, copies): (&[AgentId], usize),
        seed: Seed,
    ) -> Result<LocalForest> {
        let ways =
            |agent: &AgentId| Arc::new(Ways::of(agent.0, &plan.borders[agent.0].plan, &parts.nets[agent.0], tables));
        let ways_of: Vec<Arc<Ways>> = regions.iter().map(ways).collect();
        let rows: Vec<(usize, AgentId, usize)> = regions
            .iter()
            .enumerate()
            .flat_map(|(region, &agent)| (0..copies).map(move |copy| (region, agent, copy)))
            .collect();
        let nets: Vec<&LocalNet> = rows.iter().map(|(_, agent, _)| &parts.nets[agent.0]).collect();
        let forest = MixedForest::of(&nets);
        let routes = routes(rows.iter().map(|(region, ..)| &*ways_of[*region]));
        let [net, routes, types] = [&forest.net, &routes, &parts.types].map(|text| MemoryFile::new(text));
        let (net, routes, types) = (net?, routes?, types?);
        // The seed changes nothing: every reset seeds the lanes.
        let mut options = options::common(&net, &routes, 0);
        options.extend(["--additional-files".to_owned(), types.path()]);
        options.extend(forest.option());
        options.extend(local_options(parts).into_iter().flat_map(|(name, value)| [format!("--{name}"), value]));
        let made_of = [(&net, "LOCAL-NETS"), (&routes, "THEIR-ROUTES"), (&types, "VEHICLE-TYPES")];
        let mut simulation = Simulation::load(&options)
            .map_err(|error| explain(&error, made_of.map(|(file, name)| (file, Path::new(name)))))
            .with_context(|| format!("{}: SUMO could not load the surroundings of its lights", parts.name))?;
        let places = rows.iter().enumerate().map(|(row, (_, agent, _))| {
            let (plan, prefix) = (&plan.agents[agent.0], prefix(row));
            let approaches = plan.region.approaches.iter();
            Place {
                light: prefixed(&prefix, &plan.light),
                approaches: approaches.map(|approach| prefixed(&prefix, &approach.lane)).collect(),
                phases: plan.phases.clone(),
            }
        });
        let handles = IntersectionHandles::register(&mut simulation, places.collect())?;
        let mut places = Vec::with_capacity(rows.len());
        for (row, &(region, agent, copy)) in rows.iter().enumerate() {
            let (prefix, net, border) = (prefix(row), nets[row], &plan.borders[agent.0].plan);
            let named = |names: &mut dyn Iterator<Item = &str>| names.map(|name| prefixed(&prefix, name)).collect();
            let lanes: Vec<String> = named(&mut net.lanes());
            let of_border: Vec<String> = named(&mut border.lanes.iter().map(|lane| &*lane.lane));
            let exits: Vec<String> = named(&mut plan.agents[agent.0].region.exits.iter().map(|exit| &*exit.lane));
            let ways = ways_of[region].clone();
            let routes: Vec<String> = (0..ways.routes().len()).map(|way| route_name(row, way)).collect();
            let gate = match &net.gate {
                None => None,
                Some(gate) => {
                    let light = simulation.register_lights(&[prefixed(&prefix, &gate.light)])?[0];
                    let letter = |&lane: &usize| gate.lanes.iter().position(|other| *other == border.lanes[lane].lane);
                    Some(RowGate {
                        light,
                        letters: gate.lanes.len(),
                        of_exit: border.exits.iter().map(letter).collect(),
                    })
                }
            };
            places.push(RowPlace {
                agent,
                seed: seed.for_agent(agent).for_copy(copy),
                lanes: simulation.register_lanes(&lanes)?,
                first_lane: forest.first_lane[row],
                border: simulation.register_lanes(&of_border)?,
                exits: simulation.register_lanes(&exits)?,
                gate,
                ways,
                routes: simulation.register_routes(&routes)?,
            });
        }
        let names = type_names(tables);
        let numbers = simulation.register_types(&names)?;
        let speed_factor = send_extremes(&mut simulation, &numbers, tables)?;
        let first = names.iter().map(|name| (name.clone(), speed_factor)).collect();
        Ok(LocalForest { simulation, rows: places, handles, types: names.into_iter().zip(numbers).collect(), first })
    }

    /// Draws a seed for each lane of a row.
    pub(crate) fn draw_seeds(&self, row: usize, dice: &mut Dice) -> Vec<u32> {
        self.rows[row].lanes.iter().map(|_| dice.random()).collect()
    }

    /// Seeds the random generators of the lanes of a row.
    pub(crate) fn seed_lanes(&mut self, row: usize, seeds: &[u32]) -> Result<()> {
        Ok(self.simulation.seed_lanes(self.rows[row].first_lane, seeds)?)
    }

    /// Returns the number of a vehicle type. `None`: of the usual one.
    pub(crate) fn type_named(&self, name: Option<&str>) -> TypeId {
        let named = name.and_then(|name| self.types.iter().find(|(other, _)| other == name));
        named.unwrap_or(&self.types[0]).1
    }
}

/// Number of the first car that comes to a row. Smaller ones are of cars on the road apart.
pub(crate) const FIRST_CAR: u64 = 1 << 32;

/// Lets a car of each type with the largest speed factor enter on the road apart, one after the other, and takes it out
/// again. Returns that speed factor.
fn send_extremes(simulation: &mut Simulation, types: &[TypeId], tables: &VisitTables) -> Result<f64> {
    let road = simulation.register_lanes(&[format!("{APART}_0")])?;
    let route = simulation.register_routes(&[APART.to_owned()])?[0];
    let factors = tables.visits().of_agents.iter().flatten().map(|visit| visit.driver.speed_factor);
    let speed_factor = factors.fold(1.0, f64::max);
    for (car, &vehicle_type) in (0..).zip(types) {
        let insertion = Insertion { car, route, position_m: 500.0, speed: DepartSpeed::Fixed(0.0) };
        simulation.enter(&[Entering { insertion, vehicle_type, lane: Some(0), speed_factor, end_m: None }])?;
        simulation.step()?;
        simulation.remove_cars(&road)?;
    }
    Ok(speed_factor)
}

/// Returns the options of SUMO that say how cars drive in a local simulator, without `--`.
pub(crate) fn local_options(parts: &LocalParts) -> Vec<(String, String)> {
    let own = OPTIONS.map(|(name, value)| (name.to_owned(), value.to_owned()));
    parts.options.iter().cloned().chain(own).collect()
}

/// Options of local simulators, without `--`. A car that collides or has no way on would be moved, and a reset would not find it. A
/// car that finds no room must not keep others from the lanes beside it.
const OPTIONS: [(&str, &str); 3] =
    [("collision.action", "none"), ("ignore-route-errors", "true"), ("eager-insert", "true")];

/// Returns the options of a scenario that local simulators have, too: those that say how cars drive. Demand, routing and
/// what SUMO does with jams and collisions are not theirs.
pub(crate) fn driving_options(options: &[(String, String)]) -> Vec<(String, String)> {
    const KEPT: [&str; 6] = [
        "step-method.ballistic",
        "ignore-junction-blocker",
        "waiting-time-memory",
        "startup-wait-threshold",
        "lanechange.overtake-right",
        "time-to-impatience",
    ];
    let is_kept = |name: &str| KEPT.contains(&name) || name.starts_with("tls.") || name.starts_with("default.");
    options.iter().filter(|(name, _)| is_kept(name)).cloned().collect()
}

/// Returns the names of all vehicle types that were recorded, the usual one first.
fn type_names(tables: &VisitTables) -> Vec<String> {
    let usual = tables.usual_type().unwrap_or(OWN_TYPE);
    let all: BTreeSet<&str> =
        tables.visits().of_agents.iter().flatten().map(|visit| &*visit.driver.vehicle_type).collect();
    [usual].into_iter().chain(all.into_iter().filter(|name| *name != usual)).map(str::to_owned).collect()
}

/// Returns the text of a file with the routes of all rows.
fn routes<'a>(ways: impl Iterator<Item = &'a Ways>) -> String {
    let ways: Vec<&Ways> = ways.collect();
    document("routes", |xml| {
        leaf(xml, "route", [("id", APART), ("edges", APART)])?;
        ways.iter().enumerate().try_for_each(|(row, ways)| {
            let prefix = prefix(row);
            ways.routes().iter().enumerate().try_for_each(|(way, route)| {
                let edges: Vec<String> = route.edges.iter().map(|edge| prefixed(&prefix, edge)).collect();
                leaf(xml, "route", [("id", &*route_name(row, way)), ("edges", &edges.join(" "))])
            })
        })
    })
}

/// Returns the name of a route of a row.
pub(crate) fn route_name(row: usize, way: usize) -> String {
    format!("{}way{way}", prefix(row))
}
