//! Where cars lose time: at which light, on which approach, in which movement.
//!
//! A car's trip is cut into pieces. Each ends when the car leaves the junction of a light, or comes to an [approach](ways) of one.
//! SUMO counts the time that a car loses; it is read at the end of each piece. So the pieces of a trip are what SUMO writes as its
//! `timeLoss`, to the last digit that is written. The second in which a car leaves a junction belongs to its light.

pub(crate) mod ways;

use std::collections::HashMap;
use std::sync::Arc;

use super::recorded_roads::RecordedRoads;
use super::trips::Trip;
use crate::agents::others_plan::PUBLIC;
use crate::network::roads::EdgeNo;
use dials_core::domain::Result;
use dials_core::domain::light_figures::{ApproachEpisode, CarSums, LightEpisode, LightsEpisode};
use libsumo::{CarId, CarTable, Departure, LaneId, Simulation};
use ways::{Ahead, MovementNo, Route, Ways};

/// Share of the seconds in which a queue is at most as long as the one that is shown.
const QUEUE_SHARE: f64 = 0.95;

/// Measures them on a GS.
pub(crate) struct LightDelays {
    pub(crate) ways: Ways,
    lanes: Vec<LaneId>,
    /// Edge of each lane; `None` within a junction.
    edges: Vec<Option<EdgeNo>>,
    cars: CarTable,
    routes: HashMap<Vec<String>, Arc<Route>>,
    drivers: Vec<Driver>,
    numbers: HashMap<CarId, usize>,
    pieces: Vec<Piece>,
    /// Number of seconds with each number of standing cars, per approach.
    queues: Vec<Vec<u32>>,
    /// Standing cars of this second, per approach.
    standing: Vec<u32>,
}

/// A car that has entered, on the piece of its trip that is under way.
struct Driver {
    name: String,
    is_public: bool,
    route: Arc<Route>,
    /// Place on the route.
    at: usize,
    /// Whether it was on a lane already. Before, it may be anywhere on its route.
    is_seen: bool,
    /// Time lost when the piece began.
    lost_s: f64,
    stops: u64,
    pace: Pace,
    /// The light that the last piece ended at.
    light: Option<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pace {
    Moves,
    /// Stands since this second.
    Halts,
    Stands,
    /// Makes a stop of its plan.
    AtStop,
}

/// A piece of a trip that is over.
#[derive(Clone, Copy, Debug)]
struct Piece {
    driver: usize,
    /// `None`: on other roads.
    movement: Option<MovementNo>,
    /// Whether the piece before ended at another light, or none.
    is_new_light: bool,
    lost_s: f64,
    stops: u64,
}

/// A car that came to another edge. `ends`: the movement of the piece that ends, `Some(None)` on other roads. `skipped`: further
/// movements that it crossed in the same second.
struct Change {
    driver: usize,
    ends: Option<Option<MovementNo>>,
    skipped: Vec<MovementNo>,
}

impl LightDelays {
    pub(crate) fn register(simulation: &mut Simulation, recorded: &RecordedRoads) -> Result<LightDelays> {
        let roads = &recorded.roads;
        let ways = Ways::of(roads, &recorded.lights);
        let edge_of = |lane: &String| {
            let edge = roads.lane(roads.lane_named(lane)?).edge;
            roads.edge(edge).ends.map(|_| edge)
        };
        Ok(LightDelays {
            lanes: simulation.register_lanes(&recorded.lanes)?,
            edges: recorded.lanes.iter().map(edge_of).collect(),
            cars: CarTable::new(),
            routes: HashMap::new(),
            drivers: Vec::new(),
            numbers: HashMap::new(),
            pieces: Vec::new(),
            queues: vec![Vec::new(); ways.approaches],
            standing: vec![0; ways.approaches],
            ways,
        })
    }

    pub(crate) fn begin(&mut self) {
        self.drivers.clear();
        self.numbers.clear();
        self.pieces.clear();
        self.queues.iter_mut().for_each(Vec::clear);
    }

    /// Notes where the cars are after a second. `counts_queues`: whether the warm-up is over.
    pub(crate) fn second(&mut self, simulation: &mut Simulation, counts_queues: bool) -> Result<()> {
        for departure in simulation.departures()? {
            self.enters(departure);
        }
        simulation.read_lanes(&self.lanes, &mut self.cars)?;
        let cars = std::mem::take(&mut self.cars);
        let (mut moved, mut asked) = (Vec::new(), Vec::new());
        for (lane, edge) in cars.iter().zip(&self.edges) {
            for (id, stands) in lane.standing() {
                let Some(&number) = self.numbers.get(&id) else { continue };
                let driver = &mut self.drivers[number];
                match edge {
                    Some(edge) if driver.route.edges.get(driver.at) != Some(edge) => moved.push((number, *edge)),
                    _ => driver.is_seen = true,
                }
                if driver.looks(stands) {
                    asked.push(number);
                }
            }
        }
        self.cars = cars;
        self.ask_for_stops(simulation, &asked)?;
        self.move_on(simulation, &moved)?;
        if counts_queues {
            self.count_queues();
        }
        Ok(())
    }

    fn enters(&mut self, departure: Departure) {
        let Departure { id, name, vehicle_class, edges, .. } = departure;
        let route = self.route(edges);
        self.numbers.insert(id, self.drivers.len());
        self.drivers.push(Driver {
            name,
            is_public: PUBLIC.contains(&&*vehicle_class),
            route,
            at: 0,
            is_seen: false,
            lost_s: 0.0,
            stops: 0,
            pace: Pace::Moves,
            light: None,
        });
    }

    fn route(&mut self, edges: Vec<String>) -> Arc<Route> {
        if let Some(known) = self.routes.get(&edges) {
            return known.clone();
        }
        let route = Arc::new(self.ways.route(&edges));
        self.routes.insert(edges, route.clone());
        route
    }

    /// Tells cars that stand in the traffic from those that make a stop of their plan.
    fn ask_for_stops(&mut self, simulation: &mut Simulation, asked: &[usize]) -> Result<()> {
        let names: Vec<&str> = asked.iter().map(|&number| &*self.drivers[number].name).collect();
        for (&number, is_planned) in asked.iter().zip(simulation.at_stops(&names)?) {
            let driver = &mut self.drivers[number];
            driver.pace = if is_planned { Pace::AtStop } else { Pace::Stands };
            driver.stops += u64::from(!is_planned);
        }
        Ok(())
    }

    /// Moves cars to their new edges, and ends the pieces of their trips that are over.
    fn move_on(&mut self, simulation: &mut Simulation, moved: &[(usize, EdgeNo)]) -> Result<()> {
        let mut changes = Vec::new();
        for &(number, edge) in moved {
            let at = self.drivers[number].at;
            let to = if self.drivers[number].route.edges.get(at + 1) == Some(&edge) {
                at + 1
            } else {
                // It crossed a whole edge in this second, was moved by SUMO, or goes another way than it meant to.
                let now = simulation.route(&self.drivers[number].name)?;
                self.drivers[number].route = self.route(now.edges);
                now.at.max(at)
            };
            changes.extend(self.drivers[number].goes_to(number, to));
        }
        let names: Vec<&str> = changes.iter().map(|change| &*self.drivers[change.driver].name).collect();
        let losses_s = simulation.losses_s(&names)?;
        for (Change { driver, ends, skipped }, loss_s) in changes.into_iter().zip(losses_s) {
            if let Some(movement) = ends {
                let lost_s = loss_s - self.drivers[driver].lost_s;
                self.end_piece(driver, movement, lost_s);
                self.drivers[driver].lost_s = loss_s;
            }
            skipped.into_iter().for_each(|movement| self.end_piece(driver, Some(movement), 0.0));
        }
        Ok(())
    }

    fn end_piece(&mut self, number: usize, movement: Option<MovementNo>, lost_s: f64) {
        self.pieces.push(self.piece(number, movement, lost_s));
        let driver = &mut self.drivers[number];
        driver.light = movement.map(|movement| self.ways.movements[movement.0].light);
        driver.stops = 0;
    }

    fn piece(&self, number: usize, movement: Option<MovementNo>, lost_s: f64) -> Piece {
        let driver = &self.drivers[number];
        let light = movement.map(|movement| self.ways.movements[movement.0].light);
        let is_new_light = light.is_some() && light != driver.light;
        Piece { driver: number, movement, is_new_light, lost_s, stops: driver.stops }
    }

    fn count_queues(&mut self) {
        self.standing.fill(0);
        // Drivers that have left are not on a lane.
        for car in self.cars.iter().flat_map(|lane| lane.standing()).filter(|&(_, stands)| stands) {
            let Some(driver) = self.numbers.get(&car.0).map(|&number| &self.drivers[number]) else { continue };
            if let (Some(ahead), true) = (driver.ahead(), driver.pace != Pace::AtStop) {
                self.standing[self.ways.movements[ahead.movement.0].queue] += 1;
            }
        }
        for (seconds, &cars) in self.queues.iter_mut().zip(&self.standing) {
            let cars = cars as usize;
            seconds.resize(seconds.len().max(cars + 1), 0);
            seconds[cars] += 1;
        }
    }

    /// Returns the figures of the episode, which is over. `trips`: the trips that are counted.
    pub(crate) fn figures<'a>(&self, trips: impl Iterator<Item = &'a Trip>) -> LightsEpisode {
        let mut found = LightsEpisode { lights: self.empty_figures(), ..LightsEpisode::default() };
        let numbered = self.drivers.iter().enumerate();
        let numbers: HashMap<&str, usize> = numbered.map(|(number, driver)| (&*driver.name, number)).collect();
        let mut last = Vec::new();
        let mut is_counted = vec![false; self.drivers.len()];
        for trip in trips {
            found.cars += 1;
            found.stops += trip.stops as u64;
            found.before_entering_s += trip.depart_delay_s;
            match numbers.get(&*trip.car) {
                Some(&number) => {
                    is_counted[number] = true;
                    // A car that has a light ahead has not come there before the end.
                    let driver = &self.drivers[number];
                    let movement = driver.ahead().map(|ahead| ahead.movement);
                    last.push(self.piece(number, movement, trip.loss_s - driver.lost_s));
                }
                // It was on the road for less than a second.
                None => found.elsewhere_s += trip.loss_s,
            }
        }
        for piece in self.pieces.iter().chain(&last).filter(|piece| is_counted[piece.driver]) {
            match piece.movement {
                Some(movement) => self.add(piece, movement, &mut found.lights),
                None => found.elsewhere_s += piece.lost_s,
            }
        }
        found
    }

    fn add(&self, piece: &Piece, movement: MovementNo, lights: &mut [LightEpisode]) {
        let movement = self.ways.movements[movement.0];
        let is_public = self.drivers[piece.driver].is_public;
        let sums = CarSums {
            cars: 1,
            delay_s: piece.lost_s,
            stops: piece.stops,
            buses: u64::from(is_public),
            bus_delay_s: if is_public { piece.lost_s } else { 0.0 },
        };
        let light = &mut lights[movement.light];
        let approach = &mut light.approaches[movement.approach];
        approach.movements[movement.movement].add(&sums);
        approach.sums.add(&sums);
        // A light at several stop lines, one behind the other, is one light.
        let (cars, buses) = if piece.is_new_light { (sums.cars, sums.buses) } else { (0, 0) };
        light.sums.add(&CarSums { cars, buses, ..sums });
    }

    fn empty_figures(&self) -> Vec<LightEpisode> {
        let mut queues = self.queues.iter().map(|seconds| longest_but_few(seconds));
        let lights = self.ways.lights.iter().map(|light| {
            let approaches = light.approaches.iter().map(|approach| ApproachEpisode {
                sums: CarSums::default(),
                queue_p95_cars: queues.next().unwrap_or(0.0),
                movements: vec![CarSums::default(); approach.movements.len()],
            });
            LightEpisode { sums: CarSums::default(), approaches: approaches.collect() }
        });
        lights.collect()
    }
}

impl Driver {
    fn ahead(&self) -> Option<Ahead> {
        self.route.ahead.get(self.at).copied().flatten()
    }

    /// Notes whether it stands now. Returns whether SUMO must be asked why.
    fn looks(&mut self, stands: bool) -> bool {
        let before = self.pace;
        self.pace = match (stands, before) {
            (true, Pace::Moves) => Pace::Halts,
            (true, pace) => pace,
            (false, _) => Pace::Moves,
        };
        // A stop of a plan takes longer than a second.
        self.stops += u64::from(!stands && before == Pace::Halts);
        stands && before == Pace::Halts
    }

    /// Goes to a place on its route. Returns what ends there, if anything does.
    fn goes_to(&mut self, number: usize, to: usize) -> Option<Change> {
        let ahead = self.ahead();
        let way = self.route.through.get(self.at..to).unwrap_or_default();
        let mut crossed: Vec<MovementNo> = way.iter().copied().flatten().collect();
        self.at = to;
        if !std::mem::replace(&mut self.is_seen, true) {
            // It entered in the middle of its route.
            return None;
        }
        let ends = match ahead {
            Some(ahead) if ahead.place < to => {
                crossed.remove(0);
                Some(Some(ahead.movement))
            }
            None if self.ahead().is_some() || !crossed.is_empty() => Some(None),
            _ => None,
        };
        (ends.is_some() || !crossed.is_empty()).then_some(Change { driver: number, ends, skipped: crossed })
    }
}

/// Returns the number of cars that is exceeded in a twentieth of the seconds at most. `seconds`: number of them by that of cars.
fn longest_but_few(seconds: &[u32]) -> f64 {
    let all: u32 = seconds.iter().sum();
    let least = f64::from(all) * QUEUE_SHARE;
    let mut so_far = 0;
    let enough = |count: &u32| {
        so_far += count;
        f64::from(so_far) >= least
    };
    seconds.iter().position(enough).unwrap_or(0) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_queue_is_the_one_that_is_exceeded_in_a_twentieth_of_the_seconds() {
        // 100 seconds: 90 with nobody, 5 with 3 cars, 5 with 8.
        assert_eq!(longest_but_few(&[90, 0, 0, 5, 0, 0, 0, 0, 5]), 3.0);
        assert_eq!(longest_but_few(&[89, 0, 0, 5, 0, 0, 0, 0, 6]), 8.0);
        assert_eq!(longest_but_few(&[]), 0.0);
    }

    fn driver(route: Route) -> Driver {
        let (name, route) = ("a".to_owned(), Arc::new(route));
        Driver {
            name,
            is_public: false,
            route,
            at: 0,
            is_seen: true,
            lost_s: 0.0,
            stops: 0,
            pace: Pace::Moves,
            light: None,
        }
    }

    #[test]
    fn a_stop_counts_once_however_long_it_is() {
        let mut car = driver(Route::default());
        // Halts for a second, moves, stands for three.
        let asked: Vec<bool> = [true, false, true, true].map(|stands| car.looks(stands)).to_vec();
        assert_eq!((asked, car.stops), (vec![false, false, false, true], 1));
        car.pace = Pace::Stands;
        assert!(!car.looks(true), "known already");
        assert!(!car.looks(false) && car.pace == Pace::Moves);
        assert_eq!(car.stops, 1, "whoever asked has counted the second one");
    }

    #[test]
    fn a_piece_ends_behind_a_light_and_where_an_approach_begins() {
        let ahead = |place, movement| Some(Ahead { place, movement: MovementNo(movement) });
        // Road 0 yields onto road 1; behind road 2 is light 7, behind road 3 light 8, and road 4 is the last.
        let route = || Route {
            edges: (0..5).map(EdgeNo).collect(),
            ahead: vec![None, ahead(2, 7), ahead(2, 7), ahead(3, 8), None],
            through: vec![None, None, Some(MovementNo(7)), Some(MovementNo(8)), None],
        };
        let ends = |steps: &[usize]| -> Vec<Vec<Option<usize>>> {
            let mut car = driver(route());
            let mut pieces = |to| {
                let change = car.goes_to(0, to);
                let change =
                    change.map(|Change { ends, skipped, .. }| ends.into_iter().chain(skipped.into_iter().map(Some)));
                change.into_iter().flatten().map(|movement| movement.map(|movement| movement.0)).collect()
            };
            steps.iter().map(|&to| pieces(to)).collect()
        };
        assert_eq!(ends(&[1, 2, 3, 4]), [vec![None], vec![], vec![Some(7)], vec![Some(8)]]);
        assert_eq!(ends(&[4]), [vec![None, Some(7), Some(8)]], "all in one second");
        assert_eq!(ends(&[2, 4]), [vec![None], vec![Some(7), Some(8)]]);
    }
}
