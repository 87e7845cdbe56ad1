//! A crossing of two one-way streets for 100 seconds: a light that serves the longer queue, and the cars on each lane.
//!
//! `cargo run -p libsumo --example crossing`

use libsumo::{CarTable, Result, SignalState, Simulation};

/// Seconds that a street keeps its green, and its yellow after that.
const GREEN_S: usize = 10;
const YELLOW_S: usize = 3;

fn main() -> Result<()> {
    println!("{}", Simulation::version()?);
    let file = |name| format!("{}/examples/data/{name}", env!("CARGO_MANIFEST_DIR"));
    let (net, routes) = (file("crossing.net.xml"), file("crossing.rou.xml"));
    let mut simulation = Simulation::load(&["--net-file", &net, "--route-files", &routes, "--seed", "1"])?;

    // Names become numbers once. A step then passes only numbers.
    let lanes = simulation.register_lanes(&["from_south_0", "from_west_0"])?;
    let light = simulation.register_lights(&["middle"])?;
    // A letter per link: first the one from the south, then the one from the west.
    let greens = [SignalState::new("Gr")?, SignalState::new("rG")?];
    let yellows = [SignalState::new("yr")?, SignalState::new("ry")?];

    let mut cars = CarTable::new();
    let (mut open, mut arrived) = (0, 0);
    for second in 0..100 {
        simulation.read_lanes(&lanes, &mut cars)?;
        let queues = [0, 1].map(|lane| cars.lane(lane).halting());
        if second % 10 == 0 {
            let states = [0, 1].map(|lane| format!("{} cars, {} standing", cars.lane(lane).len(), queues[lane]));
            println!("{second:3} s  from the south: {};  from the west: {}", states[0], states[1]);
        }
        // Every 13 seconds: yellow if the other street has the longer queue, else green as before.
        let other = 1 - open;
        match second % (GREEN_S + YELLOW_S) {
            0 => simulation.set_lights(&light, &[&greens[open]])?,
            GREEN_S if queues[other] > queues[open] => {
                simulation.set_lights(&light, &[&yellows[open]])?;
                open = other;
            }
            _ => {}
        }
        simulation.step()?;
        arrived += simulation.counts()?.arrived;
    }
    println!("{arrived} cars have arrived");
    Ok(())
}
