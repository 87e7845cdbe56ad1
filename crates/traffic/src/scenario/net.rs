//! Checks of the net of a scenario: what this program cannot simulate, ids that stand twice, and absurd sizes.

use std::collections::HashSet;
use std::path::Path;

use anyhow::{Result, ensure};

use super::place::Place;
use crate::network::roads::{TRAINS, is_of_trains};
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// Shortest and longest lane in metres, and fastest speed limit in metres per second.
const SHORTEST_M: f64 = 0.01;
const LONGEST_M: f64 = 100_000.0;
const FASTEST_MPS: f64 = 200.0;

/// Returns an error if the net cannot be simulated. `programs`: the lights' programs in other files.
pub fn check(file: &Path, net: &Element, programs: &[Place<'_>]) -> Result<()> {
    ensure!(
        net.name == "net",
        "{}: is no net of SUMO: its root is <{}>, not <net>",
        file.display(),
        excerpt(&net.name)
    );
    let own: Vec<Place<'_>> = net.all("tlLogic").map(|light| Place::new(file, light)).collect();
    let lights: HashSet<&str> = own.iter().chain(programs).filter_map(|light| light.element.attribute("id")).collect();
    ensure!(
        !lights.is_empty(),
        "{}: has no traffic light (<tlLogic>); make some with: netconvert -s {0} --tls.set JUNCTION,... -o NEW.net.xml",
        file.display()
    );
    // Cars that never cross a junction need none.
    let has_connections = net.all("connection").next().is_some();
    ensure!(
        !has_connections || net.all("edge").any(|edge| edge.attribute("function") == Some("internal")),
        "{}: has no internal lanes, so cars would jump over intersections; make the net without --no-internal-links",
        file.display()
    );
    let mut edges = HashSet::new();
    for edge in net.all("edge") {
        let place = Place::new(file, edge);
        ensure!(edges.insert(place.needed("id")?), place.fault("stands twice; remove one of them"));
        check_lanes(place)?;
    }
    let mut junctions = HashSet::new();
    for junction in net.all("junction") {
        let place = Place::new(file, junction);
        ensure!(junctions.insert(place.needed("id")?), place.fault("stands twice; remove one of them"));
        refuse_rail(place)?;
    }
    let mut known = HashSet::new();
    for place in own {
        let program = (place.needed("id")?, place.needed("programID")?);
        ensure!(
            known.insert(program),
            place.fault(format!("program {} stands twice; remove one of them", excerpt(program.1)))
        );
        refuse_rail(place)?;
    }
    // Without phases it is no program, but another offset for one.
    for place in programs.iter().filter(|place| place.element.all("phase").next().is_some()) {
        let program = (place.needed("id")?, place.element.attribute("programID").unwrap_or("0"));
        ensure!(
            known.insert(program),
            place.fault(format!(
                "there is another program {} of this light, in the net or in an earlier file; give this one another \
                 programID",
                excerpt(program.1)
            ))
        );
    }
    for connection in net.all("connection") {
        let place = Place::new(file, connection);
        for key in ["from", "to"] {
            let edge = place.needed(key)?;
            ensure!(edges.contains(edge), place.fault_in(key, "the net has no such edge"));
        }
        if let Some(light) = connection.attribute("tl") {
            ensure!(lights.contains(light), place.fault_in("tl", "there is no light (<tlLogic>) of this id"));
        }
    }
    Ok(())
}

fn check_lanes(place: Place<'_>) -> Result<()> {
    let mut lanes = 0;
    for lane in place.element.all("lane") {
        let place = place.within(lane);
        for (key, least, most) in [("length", SHORTEST_M, LONGEST_M), ("speed", 0.0, FASTEST_MPS)] {
            place.needed(key)?;
            place.number(key, least, most)?;
        }
        lanes += 1;
    }
    ensure!(lanes > 0, place.fault("has no lane; remove it from the net"));
    Ok(())
}

fn refuse_rail(place: Place<'_>) -> Result<()> {
    ensure!(!is_of_trains(place.element), place.fault_in("type", TRAINS));
    Ok(())
}
