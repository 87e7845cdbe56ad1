//! The room of SUMO from outside, on one crossroad with a traffic light, made here with `netconvert`.
//!
//! libsumo has one simulation per process. These tests run as threads of one process, so they wait for each other.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{LazyLock, mpsc};
use std::thread;
use std::time::Duration;

#[path = "traffic/free_car.rs"]
mod free_car;

use free_car::FREE_CAR;
use libsumo::{
    Car, CarId, CarTable, DepartSpeed, Entering, Error, Insertion, LaneId, LightId, Placing, RouteId, RouteNow,
    SignalState, Simulation, StepCounts,
};

/// The crossroad of the paper's traffic domain: 100 m edges, 10 m/s, straight on only. Lanes 3.2 m wide and a junction
/// radius of 6.2 m make internal lanes of 18.8 m. The light's links are north, east, south, west.
///
/// The tests share the folder, and statics are never dropped. So it is among the build's temporary files, under one
/// name. Tests may be processes that make it at the same time. So each file comes whole, by a new name.
static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sumo_room");
    fs::create_dir_all(&folder).expect("a writable folder");
    let mut nodes = String::from(r#"<nodes><node id="center" x="0" y="0" type="traffic_light" radius="6.2"/>"#);
    let mut edges = String::from("<edges>");
    for (side, x, y) in [("north", 0.0, 109.4), ("east", 109.4, 0.0), ("south", 0.0, -109.4), ("west", -109.4, 0.0)] {
        nodes += &format!(r#"<node id="{side}" x="{x}" y="{y}"/>"#);
        for (id, from, to) in [("in", side, "center"), ("out", "center", side)] {
            edges += &format!(
                r#"<edge id="{side}_{id}" from="{from}" to="{to}" numLanes="1" width="3.2" speed="10" length="100"/>"#
            );
        }
    }
    let mut connections = String::from("<connections>");
    for (from, to) in [("north", "south"), ("east", "west"), ("south", "north"), ("west", "east")] {
        connections += &format!(r#"<connection from="{from}_in" to="{to}_out"/>"#);
    }
    let unfinished = |name: &str| folder.join(format!("{}_{name}", std::process::id()));
    let finish = |name: &str| fs::rename(unfinished(name), folder.join(name)).expect("a file in the folder");
    let write = |name: &str, text: String| {
        fs::write(unfinished(name), text).expect("a file");
        finish(name);
    };
    write("road.nod.xml", nodes + "</nodes>");
    write("road.edg.xml", edges + "</edges>");
    write("road.con.xml", connections + "</connections>");
    write(
        "road.rou.xml",
        format!(
            r#"<routes>{CAR}
                 <route id="eastward" edges="west_in east_out"/>
                 <route id="northward" edges="south_in north_out"/>
                 <route id="impossible" edges="west_in north_out"/>
               </routes>"#
        ),
    );
    write(
        "named.rou.xml",
        format!(
            r#"<routes>{CAR}
                 <route id="eastward" edges="west_in east_out"/>
                 <vehicle id="007" type="car" route="eastward" depart="0" departPos="80"/>
                 <vehicle id="fo" type="car" route="eastward" depart="0" departPos="60"/>
                 <vehicle id="9223372036854775808" type="car" route="eastward" depart="0" departPos="40"/>
               </routes>"#
        ),
    );
    write(
        "crash.rou.xml",
        format!(
            r#"<routes>{CAR}
                 <route id="eastward" edges="west_in east_out"/>
                 <vehicle id="1" type="car" route="eastward" depart="0" departPos="20" departSpeed="0">
                   <stop lane="west_in_0" startPos="19" endPos="20" duration="1000"/>
                 </vehicle>
                 <vehicle id="2" type="car" route="eastward" depart="0" departPos="17" departSpeed="10"
                          insertionChecks="none"/>
               </routes>"#
        ),
    );
    write(
        "programs.add.xml",
        r#"<additional>
             <tlLogic id="center" type="static" programID="all_red" offset="0">
               <phase duration="60" state="rrrr"/>
             </tlLogic>
           </additional>"#
            .into(),
    );
    write("broken.net.xml", "<net version=\"1.9\">\n  <edge id=\"e\" from=\"a\">\n</net>\n".into());
    let made = Command::new(libsumo::program("netconvert").unwrap())
        .current_dir(&folder)
        .args(["-n", "road.nod.xml", "-e", "road.edg.xml", "-x", "road.con.xml", "-o"])
        .arg(unfinished("road.net.xml"))
        .args(["--no-turnarounds", "true"])
        .output()
        .expect("netconvert is installed with SUMO");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    finish("road.net.xml");
    folder
});

/// IDM, without random draws: `speedDev` is 0.
const CAR: &str = r#"<vType id="car" carFollowModel="IDM" accel="2.6" decel="7.5" tau="1.0" minGap="2.5" length="5"
                            maxSpeed="10" impatience="0.5" speedFactor="1" speedDev="0"/>"#;

fn path(name: &str) -> String {
    FOLDER.join(name).display().to_string()
}

fn options_with(net: &str, routes: &str, more: &[&str]) -> Vec<String> {
    let mut options = ["-n", &path(net), "-r", &path(routes), "--time-to-teleport", "-1"].map(String::from).to_vec();
    options.extend(more.iter().map(|option| option.to_string()));
    options
}

fn options() -> Vec<String> {
    options_with("road.net.xml", "road.rou.xml", &[])
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| name.to_string()).collect()
}

/// A loaded crossroad with its way from west to east, and horizontal green.
struct Road {
    simulation: Simulation,
    /// Lanes of the way: the west incoming lane, the internal lane behind it, the east outgoing lane.
    way: Vec<LaneId>,
    light: LightId,
    route: RouteId,
}

impl Road {
    fn load() -> Road {
        let mut simulation = Simulation::load(&options()).unwrap();
        let way = simulation.register_lanes(&names(&["west_in_0", ":center_3_0", "east_out_0"])).unwrap();
        let light = simulation.register_lights(&names(&["center"])).unwrap()[0];
        let route = simulation.register_routes(&names(&["eastward"])).unwrap()[0];
        let mut road = Road { simulation, way, light, route };
        road.show("rGrG");
        road
    }

    fn show(&mut self, letters: &str) {
        self.simulation.set_lights(&[self.light], &[&letters.parse().unwrap()]).unwrap();
    }

    /// Inserts a car by the rule of the reference implementation: at 6 m with 9.5 m/s.
    fn insert(&mut self, car: u64) {
        self.insert_at(car, 6.0, DepartSpeed::Fixed(9.5));
    }

    fn insert_at(&mut self, car: u64, position_m: f64, speed: DepartSpeed) {
        self.simulation.insert(&[Insertion { car, route: self.route, position_m, speed }]).unwrap();
    }

    fn step(&mut self) {
        self.simulation.step().unwrap();
    }

    fn read(&mut self) -> CarTable {
        let mut table = CarTable::new();
        self.simulation.read_lanes(&self.way, &mut table).unwrap();
        table
    }

    fn counts(&mut self) -> StepCounts {
        self.simulation.counts().unwrap()
    }
}

fn message(error: Error) -> String {
    error.to_string()
}

#[test]
fn a_missing_net_is_reported_in_sumos_words_and_a_good_load_works_afterwards() {
    let error = Simulation::load(&options_with("missing.net.xml", "road.rou.xml", &[])).unwrap_err();
    assert!(matches!(error, Error::Load { .. }));
    let text = message(error);
    assert!(text.contains("missing.net.xml' is not accessible"), "{text}");
    Road::load().step();
}

#[test]
fn malformed_xml_is_reported_with_sumos_line() {
    let text = message(Simulation::load(&options_with("broken.net.xml", "road.rou.xml", &[])).unwrap_err());
    assert!(text.contains("Attribute 'to' is missing in definition of edge 'e'."), "{text}");
    // `</net>` is in line 3, where `</edge>` is missing. SUMO 1.15 counts one line too many.
    assert!(text.contains("broken.net.xml' At line/column 4/3"), "{text}");
}

#[test]
fn a_name_that_the_net_does_not_have_is_in_the_error_and_registers_nothing() {
    let mut road = Road::load();
    let simulation = &mut road.simulation;
    let text = message(simulation.register_lanes(&names(&["west_in_0", "nowhere_0"])).unwrap_err());
    assert!(text.contains("'nowhere_0' is not known"), "{text}");
    let text = message(simulation.register_lights(&names(&["dark"])).unwrap_err());
    assert!(text.contains("'dark' is not known"), "{text}");
    let text = message(simulation.register_routes(&names(&["astray"])).unwrap_err());
    assert!(text.contains("'astray' is not known"), "{text}");
    let text = message(simulation.register_routes(&names(&["a\0b"])).unwrap_err());
    assert!(text.contains("zero byte"), "{text}");
    road.insert(1);
    road.step();
    assert_eq!(road.read().lane(0).len(), 1);
}

#[test]
fn a_state_of_wrong_length_or_with_wrong_letters_is_refused_before_sumo_sees_it() {
    let mut road = Road::load();
    let short: SignalState = "rG".parse().unwrap();
    let text = message(road.simulation.set_lights(&[road.light], &[&short]).unwrap_err());
    assert_eq!(text, "light `center` has 4 links, but the state `rG` has 2 letters");
    let text = message(SignalState::new("rGxG").unwrap_err());
    assert_eq!(text, "signal state `rGxG`: `x` is not a signal; SUMO's letters are rRyYgGuoOs");
    assert!(SignalState::new("").is_err());
    let mut shown = Vec::new();
    road.simulation.read_lights(&[road.light], &mut shown).unwrap();
    assert_eq!(shown, [SignalState::new("rGrG").unwrap()]);
}

#[test]
fn lights_show_what_they_are_told_until_a_program_takes_over() {
    let mut road = Road::load();
    let mut shown = vec![SignalState::new("ssss").unwrap(); 3];
    road.show("yryr");
    for _ in 0..100 {
        road.step();
    }
    road.simulation.read_lights(&[road.light], &mut shown).unwrap();
    assert_eq!(shown, [SignalState::new("yryr").unwrap()]);

    let more = ["-a", &path("programs.add.xml")];
    road.simulation.reload(&options_with("road.net.xml", "road.rou.xml", &more)).unwrap();
    road.simulation.set_programs(&[road.light], "all_red").unwrap();
    road.simulation.read_lights(&[road.light], &mut shown).unwrap();
    assert_eq!(shown[0].as_str(), "rrrr");
    let text = message(road.simulation.set_programs(&[road.light], "disco").unwrap_err());
    assert!(text.contains("'center'") && text.contains("'disco'"), "{text}");
}

#[test]
fn a_second_simulation_in_the_same_thread_is_an_error_and_no_deadlock() {
    let road = Road::load();
    assert!(matches!(Simulation::load(&options()), Err(Error::AlreadyHeld)));
    drop(road);
    Road::load().step();
}

#[test]
fn a_second_simulation_in_another_thread_waits_for_the_first() {
    let first = Road::load();
    let (says, hears) = mpsc::channel();
    let second = thread::spawn(move || {
        let mut second = Road::load();
        says.send(()).unwrap();
        second.step();
    });
    // This does not prove that it waits forever, but a load takes milliseconds.
    assert!(hears.recv_timeout(Duration::from_millis(300)).is_err());
    drop(first);
    // Simulations of other tests may be earlier in the queue.
    second.join().unwrap();
    assert!(hears.recv().is_ok());
}

#[test]
fn an_inserted_car_is_where_it_was_put_after_one_step_under_its_serial() {
    let mut road = Road::load();
    // 0.1 + 0.2 is not 0.3: numbers must arrive exact to the last bit.
    let largest = (1 << 63) - 1;
    road.insert_at(largest, 60.0 + (0.1 + 0.2), DepartSpeed::Fixed(1.0 / 3.0));
    road.insert_at(7, 5.0, DepartSpeed::Max);
    assert_eq!(road.read().cars(), 0, "it enters with the step");
    road.step();
    let table = road.read();
    assert_eq!(table.lanes(), 3);
    let cars: Vec<Car> = table.lane(0).iter().collect();
    assert_eq!(cars[0], Car { id: CarId(7), position_m: 5.0, speed_mps: 10.0 });
    assert_eq!(cars[1], Car { id: CarId(largest), position_m: 60.0 + (0.1 + 0.2), speed_mps: 1.0 / 3.0 });
    assert_eq!(cars.len(), table.cars());
    assert!(table.lane(1).is_empty() && table.lane(2).is_empty());
}

#[test]
fn a_car_is_placed_exactly_also_where_there_is_no_room_and_drives_on() {
    let mut road = Road::load();
    let kind = road.simulation.register_types(&names(&["car"])).unwrap()[0];
    let beside = road.simulation.register_lanes(&names(&["north_in_0"])).unwrap()[0];
    let west = road.way[0];
    let mut put = |car: u64, lane: LaneId, position_m: f64, speed_mps: f64| {
        let insertion = Insertion { car, route: road.route, position_m: 0.0, speed: DepartSpeed::Max };
        let entering = Entering { insertion, vehicle_type: kind, lane: None, speed_factor: 1.0, end_m: None };
        road.simulation.enter(&[entering]).unwrap();
        road.simulation.place(&[Placing { car, lane, position_m, speed_mps }])
    };
    // The second one is 1 m behind the first one, where SUMO would let it wait.
    put(1, west, 50.0, 8.0).unwrap();
    put(2, west, 44.0, 7.0).unwrap();
    assert!(matches!(put(3, beside, 10.0, 1.0), Err(Error::Refused { .. })), "that lane is not on its way");
    assert!(matches!(put(4, west, f64::NAN, 1.0), Err(Error::Insertion { .. })));
    // Of the four only those wait that have no place.
    road.simulation.clear_pending().unwrap();
    let mut cars = CarTable::new();
    road.simulation.read_lanes(&[west], &mut cars).unwrap();
    let seen: Vec<(f64, f64)> = cars.lane(0).iter().map(|car| (car.position_m, car.speed_mps)).collect();
    assert_eq!(seen, [(44.0, 7.0), (50.0, 8.0)]);
    road.simulation.step().unwrap();
    road.simulation.read_lanes(&[west], &mut cars).unwrap();
    assert_eq!(cars.lane(0).ids, [CarId(2), CarId(1)]);
    assert!(cars.lane(0).positions_m[1] > 50.0, "the first one drives on");
}

#[test]
fn a_departure_tells_all_that_it_takes_to_let_the_same_car_enter_again() {
    let mut simulation = Simulation::load(&options_with("road.net.xml", "named.rou.xml", &[])).unwrap();
    assert_eq!(simulation.departures().unwrap(), [], "nothing has entered before the first step");
    simulation.step().unwrap();
    let mut cars = simulation.departures().unwrap();
    cars.sort_by(|a, b| a.name.cmp(&b.name));
    let told: Vec<(&str, f64)> = cars.iter().map(|car| (car.name.as_str(), car.position_m)).collect();
    assert_eq!(told, [("007", 80.0), ("9223372036854775808", 40.0), ("fo", 60.0)]);
    for car in &cars {
        assert_eq!((car.vehicle_type.as_str(), car.route.as_str(), car.lane), ("car", "eastward", 0));
        assert_eq!((car.vehicle_class.as_str(), &*car.edges), ("passenger", &names(&["west_in", "east_out"])[..]));
        assert_eq!((car.speed_mps, car.speed_factor), (0.0, 1.0));
    }
    assert_eq!(cars[0].id, CarId(0xce7e_ef18_1d60_f22e));
    let mut departed = simulation.departed().unwrap();
    departed.sort();
    let mut all: Vec<CarId> = cars.iter().map(|car| car.id).collect();
    all.sort();
    assert_eq!(departed, all);
    simulation.step().unwrap();
    assert_eq!((simulation.departures().unwrap(), simulation.departed().unwrap()), (vec![], vec![]));
}

#[test]
fn the_route_of_a_car_tells_where_on_it_the_car_is() {
    let mut road = Road::load();
    road.insert(0);
    for t in 0..14 {
        road.step();
        // By the reference trajectory it is in the junction after steps 10 and 11.
        let expected = RouteNow { edges: names(&["west_in", "east_out"]), at: usize::from(t >= 12) };
        assert_eq!(road.simulation.route("0").unwrap(), expected, "step {t}");
    }
    assert!(matches!(road.simulation.route("1"), Err(Error::Refused { .. })), "there is no such car");
}

#[test]
fn a_car_with_a_name_has_the_hash_of_its_name_with_the_top_bit_set() {
    let mut simulation = Simulation::load(&options_with("road.net.xml", "named.rou.xml", &[])).unwrap();
    let lanes = simulation.register_lanes(&names(&["west_in_0"])).unwrap();
    let mut table = CarTable::new();
    simulation.step().unwrap();
    simulation.read_lanes(&lanes, &mut table).unwrap();
    // FNV-1a 64 of "fo" is 08985907b541d342 (Fowler, Noll, Vo: test vectors). 2^63 is decimal but does not fit 63 bits.
    // "007" is another car than "7", so it has a hash, too.
    let ids = table.lane(0).ids;
    assert_eq!(ids[1..], [CarId(0x8898_5907_b541_d342), CarId(0xce7e_ef18_1d60_f22e)]);
    assert!(ids[0] > CarId(1 << 63));
}

#[test]
fn insertions_that_sumo_would_misread_are_refused() {
    let mut road = Road::load();
    let good = Insertion { car: 1, route: road.route, position_m: 6.0, speed: DepartSpeed::Max };
    for bad in [
        Insertion { car: 1 << 63, ..good },
        Insertion { position_m: f64::NAN, ..good },
        Insertion { position_m: -6.0, ..good },
        Insertion { speed: DepartSpeed::Fixed(f64::INFINITY), ..good },
        Insertion { speed: DepartSpeed::Fixed(-1.0), ..good },
    ] {
        assert!(matches!(road.simulation.insert(&[good, bad]), Err(Error::Insertion { .. })), "{bad:?}");
    }
    // SUMO itself refuses a car that is faster than the road and one that exists already, and names it.
    let fast = Insertion { car: 3, speed: DepartSpeed::Fixed(11.0), ..good };
    let text = message(road.simulation.insert(&[fast]).unwrap_err());
    assert!(text.contains("'3'") && text.contains("too high"), "{text}");
    let text = message(road.simulation.insert(&[good, good]).unwrap_err());
    assert!(text.contains("'1'") && text.contains("already exists"), "{text}");
    road.step();
    assert_eq!(road.read().lane(0).ids, [CarId(1)]);
}

#[test]
fn a_car_without_room_waits_until_the_waiting_cars_are_dropped() {
    let mut road = Road::load();
    road.show("GrGr");
    road.insert_at(1, 6.0, DepartSpeed::Fixed(0.0));
    road.step();
    road.insert(2);
    for _ in 0..2 {
        road.step();
        assert_eq!(road.counts().pending, 1);
        assert_eq!(road.read().cars(), 1);
    }
    road.simulation.clear_pending().unwrap();
    assert_eq!(road.counts().pending, 0);
    for _ in 0..20 {
        road.step();
        assert_eq!(road.read().lane(0).ids, [CarId(1)]);
    }
}

#[test]
fn cars_inserted_since_the_last_step_are_dropped_with_the_waiting_ones() {
    let mut road = Road::load();
    road.insert(1);
    road.simulation.clear_pending().unwrap();
    road.step();
    assert_eq!((road.read().cars(), road.counts()), (0, StepCounts::default()));
    // Its serial is free again.
    road.insert(1);
    road.step();
    assert_eq!(road.read().lane(0).ids, [CarId(1)]);
}

#[test]
fn removing_cars_empties_the_lanes_at_once_and_is_no_arrival() {
    let mut road = Road::load();
    road.insert_at(1, 60.0, DepartSpeed::Max);
    road.insert_at(2, 6.0, DepartSpeed::Max);
    road.step();
    assert_eq!(road.read().cars(), 2);
    road.simulation.remove_cars(&road.way).unwrap();
    assert_eq!(road.read().cars(), 0);
    assert_eq!(road.counts(), StepCounts { departed: 2, ..StepCounts::default() });
    // Their places and serials are free again.
    road.insert_at(2, 60.0, DepartSpeed::Max);
    road.step();
    assert_eq!(road.read().lane(0).ids, [CarId(2)]);
    assert_eq!(road.counts(), StepCounts { departed: 1, ..StepCounts::default() });
}

#[test]
fn a_route_over_unconnected_edges_breaks_the_step_and_a_reload_heals() {
    let mut road = Road::load();
    let impossible = road.simulation.register_routes(&names(&["impossible"])).unwrap()[0];
    let car = Insertion { car: 5, route: impossible, position_m: 6.0, speed: DepartSpeed::Max };
    road.simulation.insert(&[car]).unwrap();
    let text = message(road.simulation.step().unwrap_err());
    assert!(text.contains("'5' has no valid route"), "{text}");

    // From now on every call reports this, even one with nothing to do.
    assert!(matches!(road.simulation.step(), Err(Error::Broken { .. })));
    assert!(matches!(road.simulation.insert(&[]), Err(Error::Broken { .. })));
    let text = message(road.simulation.time_s().unwrap_err());
    assert!(text.contains("'5' has no valid route") && text.contains("reload"), "{text}");

    road.simulation.reload(&options()).unwrap();
    assert_eq!((road.simulation.time_s().unwrap(), road.counts()), (0.0, StepCounts::default()));
    road.insert(5);
    road.step();
    assert_eq!(road.read().lane(0).ids, [CarId(5)]);
}

#[test]
fn a_failed_reload_leaves_nothing_but_another_reload() {
    let mut road = Road::load();
    assert!(road.simulation.reload(&options_with("missing.net.xml", "road.rou.xml", &[])).is_err());
    let text = message(road.simulation.step().unwrap_err());
    assert!(text.contains("missing.net.xml"), "{text}");
    // This net loads, but it has no route `eastward`, which is registered.
    let text = message(road.simulation.reload(&["-n".into(), path("road.net.xml")]).unwrap_err());
    assert!(text.contains("'eastward' is not known"), "{text}");
    assert!(road.simulation.step().is_err());
    road.simulation.reload(&options()).unwrap();
    road.step();
}

#[test]
fn the_episode_after_a_reload_is_bit_identical() {
    let mut road = Road::load();
    let episode = |road: &mut Road| {
        let mut records = Vec::new();
        for t in 0..120 {
            road.show(if t % 40 < 20 { "rGrG" } else { "GrGr" });
            if t % 4 == 0 {
                road.insert(t);
            }
            road.step();
            records.push((road.read(), road.counts()));
        }
        records
    };
    let first = episode(&mut road);
    road.simulation.reload(&options()).unwrap();
    let second = episode(&mut road);
    assert!(first.iter().any(|(table, _)| table.cars() > 5));
    assert!(first.iter().any(|(_, counts)| counts.pending > 0));
    assert!(first == second);
}

#[test]
fn a_free_car_drives_the_reference_trajectory() {
    let mut road = Road::load();
    road.insert(0);
    for (t, (lane, position_m, speed_mps)) in FREE_CAR.into_iter().enumerate() {
        road.step();
        let table = road.read();
        assert_eq!(table.cars(), 1, "step {t}");
        let car = table.lane(lane).iter().next().unwrap_or_else(|| panic!("step {t}: not on lane {lane}"));
        assert!((car.position_m - position_m).abs() < 6e-4 && (car.speed_mps - speed_mps).abs() < 6e-4, "{t}: {car:?}");
        assert_eq!(road.simulation.time_s().unwrap(), (t + 1) as f64);
    }
}

#[test]
fn departures_and_arrivals_are_counted_in_the_step_in_which_they_happen() {
    let mut road = Road::load();
    assert_eq!(road.counts(), StepCounts::default());
    road.insert(0);
    road.step();
    assert_eq!(road.counts(), StepCounts { departed: 1, ..StepCounts::default() });
    // The reference trajectory is at 96.969 m of the last lane after step 21, and gone after the next.
    for _ in 1..=21 {
        road.step();
        assert_eq!((road.counts(), road.simulation.gone().unwrap()), (StepCounts::default(), vec![]));
    }
    road.step();
    let arrived = StepCounts { arrived: 1, ..StepCounts::default() };
    assert_eq!((road.counts(), road.simulation.gone().unwrap()), (arrived, vec![CarId(0)]));
    road.step();
    assert_eq!((road.counts(), road.simulation.gone().unwrap()), (StepCounts::default(), vec![]));
}

#[test]
fn a_collision_is_counted_once_however_long_it_lasts() {
    // A car at 17 m with 10 m/s behind a standing one at 20 m that is 5 m long.
    let more = ["--collision.action", "warn"];
    let mut simulation = Simulation::load(&options_with("road.net.xml", "crash.rou.xml", &more)).unwrap();
    let collisions: Vec<u32> = (0..4)
        .map(|_| {
            simulation.step().unwrap();
            simulation.counts().unwrap().collisions
        })
        .collect();
    assert_eq!(collisions, [0, 1, 0, 0]);
    simulation.reload(&options_with("road.net.xml", "crash.rou.xml", &["--collision.action", "teleport"])).unwrap();
    simulation.step().unwrap();
    simulation.step().unwrap();
    assert_eq!(simulation.counts().unwrap(), StepCounts { collisions: 1, teleports: 1, ..StepCounts::default() });
    // Why this action is refused in a scenario: both cars count as arrived.
    simulation.reload(&options_with("road.net.xml", "crash.rou.xml", &["--collision.action", "remove"])).unwrap();
    let arrived: Vec<u32> = (0..4)
        .map(|_| {
            simulation.step().unwrap();
            simulation.counts().unwrap().arrived
        })
        .collect();
    assert_eq!(arrived, [0, 0, 2, 0]);
}

#[test]
fn empty_hands_are_no_error() {
    let mut road = Road::load();
    road.insert(1);
    road.step();
    let mut table = road.read();
    let mut states = vec![SignalState::new("r").unwrap()];
    let simulation = &mut road.simulation;
    simulation.insert(&[]).unwrap();
    simulation.set_lights(&[], &[]).unwrap();
    simulation.set_programs(&[], "none").unwrap();
    simulation.remove_cars(&[]).unwrap();
    simulation.read_lights(&[], &mut states).unwrap();
    simulation.read_lanes(&[], &mut table).unwrap();
    assert!(simulation.register_lanes(&[""; 0]).unwrap().is_empty());
    assert_eq!((states.len(), table.lanes(), table.cars()), (0, 0, 0));
}

#[test]
fn an_id_of_an_earlier_simulation_is_an_error_and_no_crash() {
    let Road { simulation, way, light, .. } = Road::load();
    drop(simulation);
    let mut simulation = Simulation::load(&options()).unwrap();
    let text = message(simulation.read_lanes(&way, &mut CarTable::new()).unwrap_err());
    assert!(text.contains("no lane is registered under number 0"), "{text}");
    let state = "rrrr".parse().unwrap();
    assert!(matches!(simulation.set_lights(&[light], &[&state]), Err(Error::UnknownLight { number: 0 })));
}

#[test]
fn a_panic_with_a_simulation_in_hand_leaves_room_for_the_next() {
    let panicked = thread::spawn(|| {
        let _road = Road::load();
        std::panic::resume_unwind(Box::new("on purpose")); // A panic without a message on the terminal.
    });
    assert!(panicked.join().is_err());
    Road::load().step();
}

#[test]
fn the_version_is_told_without_a_simulation() {
    assert!(Simulation::version().unwrap().starts_with("SUMO "));
}
