//! The ways past SUMO's interface are taken, and stay taken once they were checked.

use libsumo::{CarTable, Simulation};

#[test]
fn a_version_that_was_tried_has_all_shortcuts_after_their_checks() {
    let data = format!("{}/examples/data/crossing", env!("CARGO_MANIFEST_DIR"));
    let files = ["--net-file", &format!("{data}.net.xml"), "--route-files", &format!("{data}.rou.xml")];
    let mut simulation = Simulation::load(&files).unwrap();
    let lanes = simulation.register_lanes(&["from_south_0", "from_west_0"]).unwrap();
    simulation.few_devices(true);
    simulation.seed_lanes(0, &[1, 2, 3]).unwrap();
    let (mut cars, mut seen) = (CarTable::new(), 0);
    for _ in 0..60 {
        simulation.step().unwrap();
        simulation.read_lanes(&lanes, &mut cars).unwrap();
        seen += cars.lane(0).len() + cars.lane(1).len();
    }
    assert!(seen > 0, "cars were read both ways");
    if libsumo::load().unwrap().version.is_tried() {
        assert_eq!(simulation.shortcuts(), ["devices", "generators", "lanes", "texts"]);
    }
}
