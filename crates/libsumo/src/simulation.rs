//! The one simulation of this process.

use super::call::{self, Crossing, IdKind};
use super::error::{Error, Result};
use super::events::{DepartSpeed, Departure, Entering, Insertion, Placing, RouteNow, StepCounts};
use super::guard::{self, Limits};
use super::ids::{CarId, EdgeId, LaneId, LightId, RouteId, TypeId};
use super::library;
use super::shortcuts;
use super::signal::SignalState;
use super::table::CarTable;

/// A SUMO simulation: the guard of libsumo's globals, of which a process has one set. Dropping it closes SUMO.
///
/// It stays in its thread. Other threads that want to load wait for the drop.
///
/// # Errors
/// Every method returns [`Error::Refused`] with SUMO's own words if SUMO refuses the call, as for a number of another
/// simulation. After a [`step`](Self::step) or a [`reload`](Self::reload) that failed, every method but `reload` returns
/// [`Error::Broken`]; while nothing is loaded, [`Error::Unloaded`]. Other errors are named where they occur.
#[derive(Debug)]
pub struct Simulation {
    lights: Vec<LoadedLight>,
    state: State,
    steps_per_s: u32,
    /// Cars that left the road in this second before its last step.
    gone_before: Vec<CarId>,
    crossing: Crossing,
}

#[derive(Debug)]
enum State {
    Unloaded,
    Loaded,
    /// Reason why only a reload is allowed.
    Broken(String),
}

#[derive(Debug)]
struct LoadedLight {
    name: String,
    links: usize,
}

impl Simulation {
    /// Loads SUMO with the options of its command line, without the program's name, such as
    /// `["--net-file", "town.net.xml", "--seed", "1"]` or `["-c", "town.sumocfg"]`.
    ///
    /// Options that silence SUMO, and one that stops it from looking up XML schemas on the network, are added unless they are
    /// given. Waits while another thread holds a simulation.
    ///
    /// # Errors
    /// [`Error::Library`] if there is no libsumo; [`Error::AlreadyHeld`] if this thread holds a simulation; [`Error::Load`]
    /// if SUMO refuses the options or a file. After an error, a later load can succeed.
    pub fn load(options: &[impl AsRef<str>]) -> Result<Simulation> {
        let mut simulation = Simulation::unloaded()?;
        simulation.reload(options)?;
        Ok(simulation)
    }

    /// Takes the only place for a simulation without loading anything. The first [`reload`](Self::reload) loads. What is registered
    /// before is looked up then, so a name that the net does not have is an error of the reload.
    ///
    /// # Errors
    /// Like [`load`](Self::load), but for those of loading.
    pub fn unloaded() -> Result<Simulation> {
        let crossing = Crossing::wait()?;
        Ok(Simulation { lights: Vec::new(), state: State::Unloaded, steps_per_s: 1, gone_before: Vec::new(), crossing })
    }

    /// Loads again in place, to begin again or with another net. It takes less time than a drop and a [`load`](Self::load).
    /// Everything registered keeps its number, so the new net must have it, too.
    ///
    /// # Errors
    /// [`Error::Load`] if SUMO refuses the options or a file, or if a registered name is not in the net. The simulation
    /// is then broken until a reload succeeds.
    pub fn reload(&mut self, options: &[impl AsRef<str>]) -> Result<()> {
        self.gone_before.clear();
        let outcome = self.load_again(options);
        self.state = outcome.as_ref().map_or_else(|error| State::Broken(error.to_string()), |()| State::Loaded);
        outcome
    }

    /// Ends the simulation, so that SUMO writes the rest of its files. Everything registered keeps its number for the next
    /// [`reload`](Self::reload).
    pub fn unload(&mut self) -> Result<()> {
        self.gone_before.clear();
        self.state = State::Unloaded;
        self.crossing.unload()
    }

    /// Says what is simulated, such as a path, and what to do if it ends this process: SUMO may die, or never come back. The
    /// message of that begins with `error: ` and the name, and goes to standard error.
    pub fn name(&mut self, what: &str, way_out: &str) {
        guard::name(what, way_out);
    }

    /// Limits what a call of SUMO may take, from now on and in all of this process. Beyond that the process ends with a message and
    /// exit code 1: a call that computes for ever cannot be ended in another way.
    pub fn limit(&mut self, limits: Limits) {
        guard::limit(limits);
    }

    /// Registers lanes. The `i`-th id is that of the `i`-th name. Ids are valid as long as this simulation.
    ///
    /// # Errors
    /// Registers all or none: [`Error::Refused`] names the first name that is not in the net.
    pub fn register_lanes(&mut self, names: &[impl AsRef<str>]) -> Result<Vec<LaneId>> {
        self.register(IdKind::Lane, names, LaneId)
    }

    /// Registers lights, like [`register_lanes`](Self::register_lanes).
    pub fn register_lights(&mut self, names: &[impl AsRef<str>]) -> Result<Vec<LightId>> {
        let ids = self.register(IdKind::Light, names, LightId)?;
        let links = match self.state {
            // The reload counts them.
            State::Unloaded => vec![0; ids.len()],
            _ => self.count_links(&ids)?,
        };
        self.lights
            .extend(names.iter().zip(links).map(|(name, links)| LoadedLight { name: name.as_ref().to_owned(), links }));
        Ok(ids)
    }

    /// Registers routes, like [`register_lanes`](Self::register_lanes).
    pub fn register_routes(&mut self, names: &[impl AsRef<str>]) -> Result<Vec<RouteId>> {
        self.register(IdKind::Route, names, RouteId)
    }

    /// Registers vehicle types, like [`register_lanes`](Self::register_lanes).
    pub fn register_types(&mut self, names: &[impl AsRef<str>]) -> Result<Vec<TypeId>> {
        self.register(IdKind::Type, names, TypeId)
    }

    /// Registers edges, like [`register_lanes`](Self::register_lanes).
    pub fn register_edges(&mut self, names: &[impl AsRef<str>]) -> Result<Vec<EdgeId>> {
        self.register(IdKind::Edge, names, EdgeId)
    }

    /// Counts for each pair of edges the persons who stand on the first one and go to the second one next, such as a crossing.
    /// `waiting` becomes as long as `ways`.
    pub fn count_waiting(&mut self, ways: &[[EdgeId; 2]], waiting: &mut Vec<u32>) -> Result<()> {
        self.whole()?.count_waiting(ways, waiting)
    }

    /// Returns what SUMO wrote to the terminal in the last call, such as its warnings of a load. It is silent unless the options
    /// say otherwise: `["--no-warnings", "false"]`.
    pub fn heard(&self) -> String {
        self.crossing.heard()
    }

    /// Lets SUMO look for few devices when it makes a car, from now on and until this is dropped: those that write its trip, and those
    /// that find its way. For each of the others SUMO looks up options by name, a tenth to a fifth of the time of a simulation.
    ///
    /// **This touches SUMO's internals.** It is right where no option and no parameter of a vehicle or type asks for a device, such
    /// as `--device.fcd.probability` or `has.battery.device`, and no output but that of trips needs one. Whether this SUMO can do so
    /// is among the [`shortcuts`](Self::shortcuts). Otherwise it changes nothing.
    pub fn few_devices(&mut self, few: bool) {
        self.crossing.few_devices(few);
    }

    /// Returns the names of the [shortcuts](crate::shortcuts) that are taken.
    pub fn shortcuts(&self) -> Vec<&'static str> {
        shortcuts::names(self.crossing.shortcuts())
    }

    /// Simulates one step, of SUMO's option `--step-length`: 1 s unless it is given.
    ///
    /// # Errors
    /// An error leaves the step half-done, so every later call but [`reload`](Self::reload) is an error too. The usual
    /// reason is a car with an impossible route, which SUMO notices only when it inserts the car.
    pub fn step(&mut self) -> Result<()> {
        self.crossing.second += 1;
        self.step_until(0.0)
    }

    /// Says how many steps a second has, for [`second`](Self::second). It must be what SUMO's option `--step-length` says; 1
    /// unless this is called.
    ///
    /// # Panics
    /// If it is 0.
    pub fn set_steps_per_second(&mut self, steps: u32) {
        assert!(steps > 0, "a second has at least a step");
        self.steps_per_s = steps;
    }

    /// Returns the number of steps of a second.
    pub fn steps_per_second(&self) -> u32 {
        self.steps_per_s
    }

    /// Simulates a whole second. What is said of the last step elsewhere is then said of all its steps together.
    ///
    /// # Errors
    /// Like [`step`](Self::step).
    pub fn second(&mut self) -> Result<()> {
        self.gone_before.clear();
        match self.steps_per_s {
            1 => self.step(),
            _ => {
                self.crossing.second += 1;
                self.step_until(self.time_s()? + 1.0)
            }
        }
    }

    /// Simulates a second but for its last step; nothing if it has one. Cars that enter in that step have not moved at the end
    /// of the second.
    ///
    /// # Errors
    /// Like [`step`](Self::step).
    pub fn begin_second(&mut self) -> Result<()> {
        match self.steps_per_s {
            1 => Ok(()),
            steps => {
                self.step_until(self.time_s()? + 1.0 - 1.0 / f64::from(steps))?;
                self.gone_before = self.whole()?.gone()?;
                Ok(())
            }
        }
    }

    /// Simulates steps until this second, or one step if it is 0.
    fn step_until(&mut self, second: f64) -> Result<()> {
        let outcome = self.whole()?.step(second);
        if let Err(error) = &outcome {
            self.state = State::Broken(error.to_string());
        }
        outcome
    }

    /// Returns the simulated time in seconds.
    pub fn time_s(&self) -> Result<f64> {
        self.check_whole()?;
        self.crossing.time_s()
    }

    /// Reads the cars on `lanes` after the last step into `table`, in the order of `lanes`. The table's memory is used
    /// again.
    pub fn read_lanes(&mut self, lanes: &[LaneId], table: &mut CarTable) -> Result<()> {
        self.whole()?.read_lanes(lanes, table)
    }

    /// Shows `states[i]` at `lights[i]`, from the next step on until changed. The lights' own programs stop.
    ///
    /// # Errors
    /// [`Error::StateLength`] if a state has not one letter per link of its light; [`Error::UnknownLight`] for an id of
    /// another simulation. Then no light has changed.
    ///
    /// # Panics
    /// If there is not a state for each light.
    pub fn set_lights(&mut self, lights: &[LightId], states: &[&SignalState]) -> Result<()> {
        assert_eq!(lights.len(), states.len(), "a state for each light");
        self.check_whole()?;
        for (id, state) in lights.iter().zip(states) {
            let light = self.lights.get(id.0 as usize).ok_or(Error::UnknownLight { number: id.0 })?;
            if state.links() != light.links {
                return Err(Error::StateLength {
                    light: light.name.clone(),
                    links: light.links,
                    state: state.to_string(),
                });
            }
        }
        self.crossing.set_lights(lights, states)
    }

    /// Reads what `lights` show. `states` becomes as long as `lights`.
    pub fn read_lights(&mut self, lights: &[LightId], states: &mut Vec<SignalState>) -> Result<()> {
        let crossing = self.whole()?;
        states.truncate(lights.len());
        let mut done = 0;
        crossing.read_lights(lights, |letters| {
            match states.get_mut(done) {
                Some(state) => state.overwrite(letters)?,
                None => states.push(SignalState::new(letters)?),
            }
            done += 1;
            Ok(())
        })
    }

    /// Lets a program from the net or an additional file run `lights`. `program`: its `programID`.
    pub fn set_programs(&mut self, lights: &[LightId], program: &str) -> Result<()> {
        self.whole()?.set_programs(lights, program)
    }

    /// Lets cars of vehicle type `car` enter in the next step, on the first lane of their route. The net or the routes must
    /// have a vehicle type of that name. A car that finds no room waits until there is room or until
    /// [`clear_pending`](Self::clear_pending).
    ///
    /// # Errors
    /// [`Error::Insertion`] for a number, a position or a speed that is none; then no car is in. If SUMO refuses a car,
    /// the cars before it in `cars` are in and those after it are not.
    pub fn insert(&mut self, cars: &[Insertion]) -> Result<()> {
        let crossing = self.whole()?;
        cars.iter().try_for_each(check_insertion)?;
        crossing.insert(cars)
    }

    /// Lets cars enter in the next step, like [`insert`](Self::insert), each on its lane and with its type.
    pub fn enter(&mut self, cars: &[Entering]) -> Result<()> {
        let crossing = self.whole()?;
        cars.iter().try_for_each(check_entering)?;
        crossing.enter(cars)
    }

    /// Puts cars on the road at once, exactly there and as fast, also where SUMO would find no room: to rebuild a known
    /// state. They are of those that [`enter`](Self::enter) has let wait since the last step.
    ///
    /// # Errors
    /// [`Error::Insertion`] for a position or a speed that is none; then no car is placed. If SUMO refuses a car, those
    /// before it are placed.
    pub fn place(&mut self, cars: &[Placing]) -> Result<()> {
        let crossing = self.whole()?;
        cars.iter().try_for_each(check_placing)?;
        crossing.place(cars)
    }

    /// Seeds the random generators of lanes `first`, `first + 1` and so on, one per seed. SUMO numbers lanes from 0 in the
    /// order of loading.
    ///
    /// What drivers on a lane do at random comes from the lane's generator. SUMO has `--thread-rngs` generators, 64 unless it
    /// is given, and lanes take them in turn. Load with at least as many as there are lanes: then each lane has its own, and
    /// parts of a net that do not meet are independent, also of the order in which they are computed. A part can then be
    /// seeded again while the rest goes on.
    ///
    /// **This touches SUMO's internals.** libsumo has no such function. The generator of a lane is set by
    /// `MSLane::loadRNGState`, which SUMO uses to load a saved state, and which its library exports (1.15 to 1.28). A library
    /// without it is taken all the same, and refuses this call.
    pub fn seed_lanes(&mut self, first: u32, seeds: &[u32]) -> Result<()> {
        self.whole()?.seed_generators(first, seeds)
    }

    /// Drops all cars that wait to enter: those that found no room, and those inserted since the last step.
    ///
    /// **This depends on SUMO's internals.** SUMO's own `clearPending` drops only cars that a step has already tried to insert
    /// (measured with SUMO 1.15). So this crate keeps a list of the cars added since the last step, and removes these one
    /// by one.
    pub fn clear_pending(&mut self) -> Result<()> {
        self.whole()?.clear_pending()
    }

    /// Removes all cars from `lanes` at once. Cars that wait to enter are not on a lane. Removed cars do not count as
    /// arrived in [`counts`](Self::counts), but are in [`gone`](Self::gone).
    pub fn remove_cars(&mut self, lanes: &[LaneId]) -> Result<()> {
        self.whole()?.remove_cars(lanes)
    }

    /// Returns the cars that entered in the last step.
    pub fn departures(&mut self) -> Result<Vec<Departure>> {
        self.whole()?.departures()
    }

    /// Returns the numbers of the cars that entered in the last step. This takes less time than [`Self::departures`].
    pub fn departed(&mut self) -> Result<Vec<CarId>> {
        self.whole()?.departed()
    }

    /// Returns the numbers of the cars that ended their trip or began to teleport in the last step, and of those that were
    /// removed after it.
    pub fn gone(&mut self) -> Result<Vec<CarId>> {
        let mut gone = self.whole()?.gone()?;
        gone.extend(&self.gone_before);
        Ok(gone)
    }

    /// Returns the route of a car on the road as it is now: SUMO may have changed it since the car entered. `car`: its
    /// name in SUMO.
    pub fn route(&mut self, car: &str) -> Result<RouteNow> {
        self.whole()?.route(car)
    }

    /// Returns how many seconds each of these cars has lost so far by driving slower than it would alone: what SUMO writes as
    /// `timeLoss` of a trip. `cars`: names in SUMO of cars on the road.
    pub fn losses_s(&mut self, cars: &[impl AsRef<str>]) -> Result<Vec<f64>> {
        self.whole()?.losses_s(cars)
    }

    /// Returns whether each of these cars makes a stop of its plan now, such as a bus at its stop. `cars`: names in SUMO of
    /// cars on the road.
    pub fn at_stops(&mut self, cars: &[impl AsRef<str>]) -> Result<Vec<bool>> {
        self.whole()?.at_stops(cars)
    }

    /// Reads how much CO2 the cars on each lane emitted in the last step, in mg/s, by the emission class of their types. `co2`
    /// becomes as long as `lanes`.
    pub fn co2_mg_per_s(&mut self, lanes: &[LaneId], co2: &mut Vec<f64>) -> Result<()> {
        self.whole()?.co2_mg_per_s(lanes, co2)
    }

    /// Returns the counts of the last step.
    pub fn counts(&mut self) -> Result<StepCounts> {
        self.whole()?.counts()
    }

    /// Returns the version of the library in SUMO's words, such as `SUMO 1.15.0`. Needs no simulation and waits for none.
    ///
    /// # Errors
    /// [`Error::Library`] if there is no libsumo.
    pub fn version() -> Result<&'static str> {
        Ok(&library::load()?.name)
    }

    /// Returns the library whose `exp`, `ln` and so on SUMO and this program use, such as `glibc 2.36`; `unknown` if it is
    /// not GNU's. Versions of it differ in last bits, and so do simulations. Needs no libsumo.
    pub fn libm() -> String {
        let version = call::c_library();
        if version.is_empty() { "unknown".to_owned() } else { format!("glibc {version}") }
    }

    /// Returns the way to SUMO, unless the simulation is broken or unloaded.
    fn whole(&mut self) -> Result<&mut Crossing> {
        self.check_whole()?;
        Ok(&mut self.crossing)
    }

    fn check_whole(&self) -> Result<()> {
        match &self.state {
            State::Loaded => Ok(()),
            State::Unloaded => Err(Error::Unloaded),
            State::Broken(cause) => Err(Error::Broken { cause: cause.clone() }),
        }
    }

    fn load_again(&mut self, options: &[impl AsRef<str>]) -> Result<()> {
        self.crossing.load(options)?;
        let lights: Vec<LightId> = (0..self.lights.len() as u32).map(LightId).collect();
        let links = self.count_links(&lights)?; // The net can be another one.
        for (light, links) in self.lights.iter_mut().zip(links) {
            light.links = links;
        }
        Ok(())
    }

    fn register<Id>(&mut self, kind: IdKind, names: &[impl AsRef<str>], id: fn(u32) -> Id) -> Result<Vec<Id>> {
        let crossing = match self.state {
            State::Unloaded => &mut self.crossing,
            _ => self.whole()?,
        };
        let first = crossing.register(kind, names)?;
        Ok((first..).take(names.len()).map(id).collect())
    }

    /// Returns the number of links of each light. A light's state has a letter per link, whatever program shows it.
    fn count_links(&mut self, lights: &[LightId]) -> Result<Vec<usize>> {
        let mut links = Vec::with_capacity(lights.len());
        self.crossing.read_lights(lights, |letters| {
            links.push(letters.len());
            Ok(())
        })?;
        Ok(links)
    }
}

fn check_insertion(insertion: &Insertion) -> Result<()> {
    let Insertion { car, position_m, speed, .. } = *insertion;
    if car >= 1 << 63 {
        return Err(Error::Insertion { car, reason: "serials from 2^63 on are reserved for cars with names".into() });
    }
    check_position(car, position_m)?;
    match speed {
        DepartSpeed::Fixed(speed_mps) => check_speed(car, speed_mps),
        DepartSpeed::Max => Ok(()),
    }
}

fn check_entering(entering: &Entering) -> Result<()> {
    let Entering { insertion, speed_factor, end_m, .. } = *entering;
    check_insertion(&insertion)?;
    check_number(insertion.car, speed_factor, || format!("{speed_factor} is not a speed factor"))?;
    end_m.map_or(Ok(()), |end_m| check_position(insertion.car, end_m))
}

fn check_placing(placing: &Placing) -> Result<()> {
    check_position(placing.car, placing.position_m)?;
    check_speed(placing.car, placing.speed_mps)
}

fn check_position(car: u64, position_m: f64) -> Result<()> {
    check_number(car, position_m, || format!("position {position_m} m is not on the road"))
}

fn check_speed(car: u64, speed_mps: f64) -> Result<()> {
    check_number(car, speed_mps, || format!("{speed_mps} m/s is not a speed"))
}

/// Checks for values that SUMO would misread: it takes `nan` and `inf` as numbers, and counts a negative position from
/// the end.
fn check_number(car: u64, value: f64, reason: impl FnOnce() -> String) -> Result<()> {
    if value.is_finite() && value >= 0.0 { Ok(()) } else { Err(Error::Insertion { car, reason: reason() }) }
}
