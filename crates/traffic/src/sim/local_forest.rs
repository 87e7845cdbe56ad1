//! Loads many local nets side by side into SUMO: copies of the one of a grid, or those of the lights of a scenario.

use std::collections::{BTreeSet, HashMap};
use std::io;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context;
use rand::Rng;

use super::lights::Lights;
use super::local_routes::LocalRoutes;
use super::options;
use super::visit_tables::VisitTables;
use crate::agents::plan::JointPlan;
use crate::cars_at::RowLanes;
use crate::cut::forest::{Forest, Region};
use crate::cut::local_net::{Gate, LocalNet};
use crate::cut::mixed::{APART, MixedForest, prefix};
use crate::cut::names::prefixed;
use crate::network::contents::Network;
use crate::network::loadable::{REMAKE, explain, way_out_of};
use crate::network::memory_file::MemoryFile;
use crate::network::xml::{Xml, document, leaf, nest};
use crate::scenario::stops::Stop;
use dials_core::base::{AgentId, Dice, Seed};
use dials_core::domain::Result;
use libsumo::{DepartSpeed, Entering, Insertion, LaneId, LightId, RouteId, Simulation, TypeId};

pub(crate) struct LocalParts {
    pub(crate) nets: Vec<LocalNet>,
    pub(crate) types: String,
    pub(crate) steps_per_s: u32,
    /// Whether vehicles may have devices.
    pub(crate) may_have_devices: bool,
    /// Options of SUMO that say how cars drive, without `--`.
    pub(crate) options: Vec<(String, String)>,
    pub(crate) name: String,
}

pub(crate) struct LocalForest {
    pub(crate) simulation: Simulation,
    pub(crate) rows: Vec<RowPlace>,
    pub(crate) lights: Lights,
    pub(crate) approaches: RowLanes,
    /// Names of vehicle types, with their numbers. The first one is the usual one. Empty on a grid, which has one type.
    types: Vec<(String, TypeId)>,
    /// Types and speed factors of the cars that entered on the road apart, one in each second so far.
    pub(crate) first: Vec<(String, f64)>,
}

/// The region of a row, and the root of the row's random streams.
pub(crate) type Row = (AgentId, Seed);

pub(crate) struct RowPlace {
    pub(crate) agent: AgentId,
    pub(crate) seed: Seed,
    /// All lanes that a reset has to clear. Those of a scenario have consecutive numbers.
    pub(crate) lanes: Vec<LaneId>,
    first_lane: u32,
    /// Lanes of the border plan, in its order; none on a grid.
    pub(crate) border: Vec<LaneId>,
    /// Lanes on which cars leave the light, in the order of the region plan.
    pub(crate) exits: Vec<LaneId>,
    /// Those within its junctions, for masks that mind trapped cars; none on a grid.
    pub(crate) inside: Vec<LaneId>,
    pub(crate) gate: Option<RowGate>,
    pub(crate) local_routes: Arc<LocalRoutes>,
    /// Routes by their numbers: those of `local_routes`, or one for each edge of a grid.
    pub(crate) routes: Vec<RouteId>,
}

pub(crate) struct RowGate {
    pub(crate) light: LightId,
    pub(crate) letters: usize,
    /// Letter of each exit of the border plan.
    pub(crate) of_exit: Vec<Option<usize>>,
}

/// Returns `copies` rows of each of these regions, ordered by region, then copy.
pub(crate) fn rows_of(regions: &[AgentId], copies: usize, seed: Seed) -> Vec<Row> {
    let copies_of = |&agent: &AgentId| (0..copies).map(move |copy| (agent, seed.for_agent(agent).for_copy(copy)));
    regions.iter().flat_map(copies_of).collect()
}

impl LocalForest {
    pub(crate) fn of_grid(local: &Network, plan: &JointPlan, rows: &[Row]) -> Result<LocalForest> {
        let forest = Forest::of(local, rows.len());
        let (net, routes) = (MemoryFile::new(&forest.net)?, MemoryFile::new(&forest.routes)?);
        let mut options = options::common(&net, &routes, "1");
        // On one lane without overtaking there are no collisions, and looking for them takes 3 % of a step. A test checks
        // that this option changes nothing, however dense the traffic.
        options.extend(["--collision.action".to_owned(), "none".to_owned()]);
        // SUMO reads both completely and never loads them again, so their memory is given back at once.
        let made_of = [(&net, &*local.files.net), (&routes, &*local.files.routes)];
        let place = format!("{}: {} copies of this network side by side", local.files.net.display(), rows.len());
        let mut simulation = Simulation::unloaded()?;
        simulation.name(&place, REMAKE);
        simulation.reload(&options).map_err(|error| explain(&error, made_of)).with_context(|| place)?;
        simulation.few_devices(true);
        drop((net, routes, forest));
        let regions = || (0..rows.len()).map(Region);
        let phases = rows.iter().map(|(agent, _)| plan.agents[agent.0].phases.clone());
        let lights = Lights::register(&mut simulation, regions().map(Region::light).zip(phases))?;
        let mut approaches = Vec::with_capacity(rows.len());
        let mut places = Vec::with_capacity(rows.len());
        for (region, &(agent, seed)) in regions().zip(rows) {
            let incoming = simulation.register_lanes(&region.incoming_lanes())?;
            let internal = simulation.register_lanes(&region.internal_lanes())?;
            let exits = simulation.register_lanes(&region.outgoing_lanes())?;
            places.push(RowPlace {
                agent,
                seed,
                lanes: [&incoming[..], &internal, &exits].concat(),
                first_lane: 0,
                border: Vec::new(),
                exits,
                inside: Vec::new(),
                gate: None,
                local_routes: Arc::default(),
                routes: simulation.register_routes(&region.routes())?,
            });
            approaches.push(incoming);
        }
        let approaches = RowLanes::new(approaches.iter().map(Vec::as_slice));
        Ok(LocalForest { simulation, rows: places, lights, approaches, types: Vec::new(), first: Vec::new() })
    }

    pub(crate) fn of_scenario(
        parts: &LocalParts,
        plan: &JointPlan,
        tables: &VisitTables,
        rows: &[Row],
    ) -> Result<LocalForest> {
        let mut routes_of: HashMap<AgentId, Arc<LocalRoutes>> = HashMap::new();
        let mut known = |&(agent, _): &Row| {
            let (border, net) = (&plan.borders[agent.0].plan, &parts.nets[agent.0]);
            routes_of.entry(agent).or_insert_with(|| Arc::new(LocalRoutes::of(agent.0, border, net, tables))).clone()
        };
        let local_routes: Vec<Arc<LocalRoutes>> = rows.iter().map(&mut known).collect();
        let nets: Vec<&LocalNet> = rows.iter().map(|(agent, _)| &parts.nets[agent.0]).collect();
        let forest = MixedForest::of(&nets);
        let [net, routes, types] =
            [&forest.net, &routes(&local_routes), &parts.types].map(|text| MemoryFile::new(text));
        let (net, routes, types) = (net?, routes?, types?);
        // Every reset seeds the lanes.
        let step_length = 1.0 / f64::from(parts.steps_per_s);
        let mut options = options::common(&net, &routes, &step_length.to_string());
        options.extend(["--additional-files".to_owned(), types.path()]);
        options.extend(forest.option());
        options.extend(local_options(parts).into_iter().flat_map(|(name, value)| [format!("--{name}"), value]));
        let made_of = [(&net, "LOCAL-NETS"), (&routes, "THEIR-ROUTES"), (&types, "VEHICLE-TYPES")];
        let mut simulation = Simulation::unloaded()?;
        simulation
            .name(&format!("{}: the surroundings of its lights", parts.name), &way_out_of(Path::new(&parts.name)));
        simulation
            .reload(&options)
            .map_err(|error| explain(&error, made_of.map(|(file, name)| (file, Path::new(name)))))
            .with_context(|| format!("{}: SUMO could not load the surroundings of its lights", parts.name))?;
        simulation.set_steps_per_second(parts.steps_per_s);
        simulation.few_devices(!parts.may_have_devices);
        let lights = rows.iter().enumerate().map(|(row, (agent, _))| {
            let plan = &plan.agents[agent.0];
            (prefixed(&prefix(row), &plan.light), plan.phases.clone())
        });
        let lights = Lights::register(&mut simulation, lights)?;
        let mut approaches = Vec::with_capacity(rows.len());
        let mut places = Vec::with_capacity(rows.len());
        for ((row, &(agent, seed)), local_routes) in rows.iter().enumerate().zip(local_routes) {
            let (prefix, net, border) = (prefix(row), nets[row], &plan.borders[agent.0].plan);
            let region = &plan.agents[agent.0].region;
            let mut lanes = |names: &mut dyn Iterator<Item = &str>| {
                simulation.register_lanes(&names.map(|name| prefixed(&prefix, name)).collect::<Vec<_>>())
            };
            approaches.push(lanes(&mut region.approaches.iter().map(|approach| &*approach.lane))?);
            let all = lanes(&mut net.lanes())?;
            let of_border = lanes(&mut border.lanes.iter().map(|lane| &*lane.lane))?;
            let exits = lanes(&mut region.exits.iter().map(|exit| &*exit.lane))?;
            let inside = lanes(&mut plan.agents[agent.0].lanes_inside().into_iter().map(String::as_str))?;
            let register = |gate: &Gate| -> Result<RowGate> {
                let light = simulation.register_lights(&[prefixed(&prefix, &gate.light)])?[0];
                let letter = |&lane: &usize| gate.lanes.iter().position(|other| *other == border.lanes[lane].lane);
                Ok(RowGate { light, letters: gate.lanes.len(), of_exit: border.exits.iter().map(letter).collect() })
            };
            let gate = net.gate.as_ref().map(register).transpose()?;
            let routes: Vec<String> = (0..local_routes.routes.len()).map(|route| route_name(row, route)).collect();
            places.push(RowPlace {
                agent,
                seed,
                lanes: all,
                first_lane: forest.first_lane[row],
                border: of_border,
                exits,
                inside,
                gate,
                local_routes,
                routes: simulation.register_routes(&routes)?,
            });
        }
        let approaches = RowLanes::new(approaches.iter().map(Vec::as_slice));
        let names = type_names(tables);
        let numbers = simulation.register_types(&names)?;
        let speed_factor = send_extremes(&mut simulation, &numbers, tables)?;
        let first = names.iter().map(|name| (name.clone(), speed_factor)).collect();
        let types = names.into_iter().zip(numbers).collect();
        Ok(LocalForest { simulation, rows: places, lights, approaches, types, first })
    }

    pub(crate) fn draw_seeds(&self, row: usize, dice: &mut Dice) -> Vec<u32> {
        self.rows[row].lanes.iter().map(|_| dice.random()).collect()
    }

    pub(crate) fn seed_lanes(&mut self, row: usize, seeds: &[u32]) -> Result<()> {
        Ok(self.simulation.seed_lanes(self.rows[row].first_lane, seeds)?)
    }

    /// Returns the name of the usual vehicle type. A grid has only one, without a number.
    pub(crate) fn usual_type(&self) -> Option<&str> {
        self.types.first().map(|(name, _)| &**name)
    }

    /// Returns the number of a vehicle type. `None`: of the usual one.
    pub(crate) fn type_named(&self, name: Option<&str>) -> TypeId {
        let named = name.and_then(|name| self.types.iter().find(|(other, _)| other == name));
        named.unwrap_or(&self.types[0]).1
    }
}

/// Number of the first car that comes to a row. Smaller ones are of cars on the road apart.
pub(crate) const FIRST_CAR: u64 = 1 << 32;

/// Lets a car of each type with the largest speed factor enter on the road apart and leave it. Returns that speed factor.
fn send_extremes(simulation: &mut Simulation, types: &[TypeId], tables: &VisitTables) -> Result<f64> {
    let road = simulation.register_lanes(&[format!("{APART}_0")])?;
    let route = simulation.register_routes(&[APART.to_owned()])?[0];
    let visits = tables.visits();
    let factors = visits.all().map(|visit| visits.driver(visit).speed_factor);
    let speed_factor = factors.fold(1.0, f64::max);
    for (car, &vehicle_type) in (0..).zip(types) {
        let insertion = Insertion { car, route, position_m: 500.0, speed: DepartSpeed::Fixed(0.0) };
        simulation.enter(&[Entering { insertion, vehicle_type, lane: Some(0), speed_factor, end_m: None }])?;
        simulation.second()?;
        simulation.remove_cars(&road)?;
    }
    Ok(speed_factor)
}

/// Returns the options of SUMO that say how cars drive in a local simulator, without `--`.
pub(crate) fn local_options(parts: &LocalParts) -> Vec<(String, String)> {
    // A car that collides or has no way on would be moved, and a reset would not find it. A car that finds no room must
    // not keep others from the lanes beside it.
    let own = [("collision.action", "none"), ("ignore-route-errors", "true"), ("eager-insert", "true")];
    let own = own.map(|(name, value)| (name.to_owned(), value.to_owned()));
    parts.options.iter().cloned().chain(own).collect()
}

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
    let (usual, _) = tables.usual();
    let visits = tables.visits();
    let all: BTreeSet<&str> = visits.all().map(|visit| &*visits.driver(visit).vehicle_type).collect();
    [usual].into_iter().chain(all.into_iter().filter(|name| *name != usual)).map(str::to_owned).collect()
}

fn routes(of_rows: &[Arc<LocalRoutes>]) -> String {
    document("routes", |xml| {
        leaf(xml, "route", [("id", APART), ("edges", APART)])?;
        of_rows.iter().enumerate().try_for_each(|(row, routes)| {
            let prefix = prefix(row);
            routes.routes.iter().enumerate().try_for_each(|(number, route)| {
                let edges: Vec<String> = route.edges.iter().map(|edge| prefixed(&prefix, edge)).collect();
                write_route(xml, &route_name(row, number), &edges.join(" "), &route.stops, &prefix)
            })
        })
    })
}

/// Writes a route with its stops. `prefix`: before the names of lanes.
pub(super) fn write_route(xml: &mut Xml, id: &str, edges: &str, stops: &[Stop], prefix: &str) -> io::Result<()> {
    let route = [("id", id), ("edges", edges)];
    if stops.is_empty() {
        return leaf(xml, "route", route);
    }
    nest(xml, "route", route, |xml| {
        stops.iter().try_for_each(|Stop { lane, end_cm, duration_s, parks }| {
            let attributes = [
                ("lane", prefixed(prefix, lane)),
                ("endPos", (f64::from(*end_cm) / 100.0).to_string()),
                ("duration", duration_s.to_string()),
                ("parking", parks.to_string()),
                ("friendlyPos", "true".to_owned()),
            ];
            leaf(xml, "stop", attributes)
        })
    })
}

pub(super) fn route_name(row: usize, number: usize) -> String {
    format!("{}way{number}", prefix(row))
}
