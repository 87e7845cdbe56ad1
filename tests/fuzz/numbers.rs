//! Numbers of vehicle types and of SUMO's options. Each scenario is refused, or played to its end, or the death of SUMO is
//! reported.

use std::fs;

use anyhow::{Result, bail};

use super::of_project;
use super::place::Place;

/// The names that are numbers, as the program knows them.
const TABLE: &str = include_str!("../../crates/traffic/src/config/sumo_numbers/table.txt");
/// Number of names in an input: a change of one of many would seldom be of one that matters.
const TOGETHER: usize = 12;

const SCENARIO: &str = "<configuration><net-file value='net.net.xml'/><route-files value='cars.rou.xml'/>\
                        <additional-files value='types.add.xml'/><end value='60'/></configuration>";
const TYPE: &str = "<additional><vType id='car' length='5' minGap='2.5' maxSpeed='14' accel='2.6' decel='4.5' sigma='0.5' tau='1' \
                    speedFactor='normc(1,0.1,0.2,2)' actionStepLength='1' lcStrategic='1' jmSigmaMinor='0.1' scale='1'/></additional>";
const ROUTES: &str = "<routes><route id='r' edges='w0_r0c0 r0c0_r0c1 r0c1_e0'/>\
                      <flow id='f' type='car' begin='0' end='60' period='4' route='r'/>\
                      <flow id='g' type='car' begin='0' end='60' period='5' from='s0_r0c0' to='r1c0_n0'/></routes>";

/// Numbers of SUMO 1.15 that change traffic, mostly as they are without the option, some in each input.
const OPTIONS: &[&str] = &[
    "scale=1 time-to-teleport=300 max-depart-delay=-1 max-num-vehicles=-1 time-to-impatience=180 waiting-time-memory=100 \
     route-steps=200 random-depart-offset=0 startup-wait-threshold=2 ignore-junction-blocker=-1 collision.stoptime=0",
    "default.speeddev=0.1 default.action-step-length=0 weights.random-factor=1 weights.minor-penalty=1.5 weights.tls-penalty=0 \
     weights.priority-factor=0 weights.separate-turns=0 tls.yellow.min-decel=3 tls.actuated.jam-threshold=-1",
    "device.rerouting.probability=1 device.rerouting.period=10 device.rerouting.pre-period=60 device.rerouting.adaptation-steps=180 \
     device.rerouting.adaptation-interval=1 device.taxi.dispatch-period=60",
    "device.driverstate.probability=1 device.driverstate.initialAwareness=1 device.driverstate.minAwareness=0.1 \
     device.driverstate.errorTimeScaleCoefficient=100 device.driverstate.maximalReactionTime=-1 device.glosa.probability=1 \
     device.glosa.range=100 device.glosa.min-speed=5 device.bluelight.reactiondist=25 step-length=0.5",
];

/// Returns the names of a row of the table.
fn names(of: &str) -> Vec<&'static str> {
    let mut found = Vec::new();
    let mut is_of = false;
    for line in TABLE.lines() {
        let (head, names) = line.split_once(": ").unwrap_or(("", line));
        is_of = if head.is_empty() { is_of } else { head.starts_with(&format!("{of} ")) };
        found.extend(names.split_whitespace().filter(|_| is_of && !line.starts_with('#')));
    }
    found
}

pub(crate) fn vehicle_types_seeds(_: &Place) -> Vec<Vec<u8>> {
    vec![TYPE.into()]
}

/// Types with all attributes of the table, some in each.
pub(crate) fn all_of_a_type(_: &Place) -> Vec<Vec<u8>> {
    let of_some = |names: &[&str]| {
        let attributes: String = names.iter().map(|name| format!(" {name}='1'")).collect();
        format!("<additional><vType id='car'{attributes}/></additional>").into_bytes()
    };
    names("vType").chunks(TOGETHER).map(of_some).collect()
}

pub(crate) fn vehicle_types(place: &Place, bytes: &[u8]) -> Result<()> {
    play(place, "types.add.xml", bytes)
}

pub(crate) fn sumo_options_seeds(_: &Place) -> Vec<Vec<u8>> {
    let of_some = |options: &&str| {
        let elements: String = options
            .split_whitespace()
            .filter_map(|option| option.split_once('='))
            .map(|(name, value)| format!("<{name} value='{value}'/>"))
            .collect();
        SCENARIO.replace("<end value='60'/>", &format!("<end value='60'/>{elements}")).into_bytes()
    };
    OPTIONS.iter().map(of_some).collect()
}

pub(crate) fn sumo_options(place: &Place, bytes: &[u8]) -> Result<()> {
    play(place, "x.sumocfg", bytes)
}

/// Plays an episode with one file replaced.
fn play(place: &Place, name: &str, bytes: &[u8]) -> Result<()> {
    fs::copy(of_project("sumo_nets/grid_2x2.net.xml"), place.work().join("net.net.xml"))
        .expect("a file of this project");
    for (file, text) in [("x.sumocfg", SCENARIO), ("types.add.xml", TYPE), ("cars.rou.xml", ROUTES)] {
        place.file(file, text.as_bytes());
    }
    place.file(name, bytes);
    // A mutated end may be in a thousand years.
    let arguments = ["baseline", "x.sumocfg", "--controller", "program", "--episodes", "1", "--end", "60", "--json"];
    let played = place.program_or_sumos_death(&arguments);
    if played.code != 0 {
        bail!(played.stderr);
    }
    assert!(played.stdout.contains("\"departed\""), "an episode is measured: {}", played.stdout);
    Ok(())
}
