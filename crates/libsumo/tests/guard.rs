//! The death of SUMO, a call without an end, and one that takes all memory, each in a child of this test.

use std::env;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Output};

use libsumo::{Limits, Simulation};

/// The change of the shipped routes that a child plays: a text and what takes its place, with `=>` between.
const CHANGE: &str = "LIBSUMO_TEST_GUARD";

/// Plays the crossing with a change, in a child. It is no test of its own.
#[test]
fn child() {
    let Ok(change) = env::var(CHANGE) else { return };
    let (from, to) = change.split_once("=>").unwrap();
    let data = format!("{}/examples/data/crossing", env!("CARGO_MANIFEST_DIR"));
    let routes = fs::read_to_string(format!("{data}.rou.xml")).unwrap().replacen(from, to, 1);
    let file = env::temp_dir().join(format!("libsumo-guard-{}.rou.xml", std::process::id()));
    fs::write(&file, routes).unwrap();
    let mut simulation = Simulation::unloaded().unwrap();
    simulation.name("my crossing", "look at crossing.rou.xml");
    let step_s = if change.contains("scale") { 60 } else { 1 };
    simulation.limit(Limits { load_s: 60, step_s, memory_mib: 256 });
    let loaded =
        simulation.reload(&["--net-file", &format!("{data}.net.xml"), "--route-files", file.to_str().unwrap()]);
    fs::remove_file(&file).unwrap();
    loaded.unwrap();
    (0..60).for_each(|_| simulation.second().unwrap());
    println!("played to the end");
}

fn played_with(change: &str) -> Output {
    let mut command = Command::new(env::current_exe().unwrap());
    command.args(["--exact", "child", "--nocapture", "--test-threads", "1"]).env(CHANGE, change).output().unwrap()
}

fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout)
}

#[test]
fn a_simulation_that_goes_well_says_nothing() {
    let output = played_with("length=\"5\"=>length=\"6\"");
    assert!(output.status.success() && words(&output).contains("played to the end"), "{}", words(&output));
    assert!(!words(&output).contains("my crossing"), "{}", words(&output));
}

#[test]
fn a_step_without_an_end_is_ended_with_a_message() {
    // SUMO draws a speed factor until one is exactly 1.
    let output = played_with("length=\"5\"=>length=\"5\" speedFactor=\"normc(1,0.1,1,1)\"");
    let said = words(&output);
    assert!(said.contains("error: my crossing: SUMO did not come back "), "{said}");
    assert!(
        said.contains(" it has computed for ") && said.contains("\n  way out: look at crossing.rou.xml\n"),
        "{said}"
    );
    assert_eq!(output.status.code(), Some(1), "{said}");
}

#[test]
fn a_step_that_takes_all_memory_is_ended_with_a_message() {
    // SUMO makes ten million cars of one.
    let output = played_with("length=\"5\"=>length=\"5\" scale=\"10000000\"");
    let said = words(&output);
    assert!(said.contains("error: my crossing: SUMO took 256 MiB more memory in one call, "), "{said}");
    assert_eq!(output.status.code(), Some(1), "{said}");
}

#[test]
fn the_death_of_sumo_is_said_and_stays_its_death() {
    let output = played_with("length=\"5\"=>length=\"5\" jmSigmaMinor=\"nan\" decel=\"nan\"");
    let said = words(&output);
    if output.status.signal().is_none() {
        return eprintln!("this SUMO has its assertions off: {said}");
    }
    assert!(said.contains("error: my crossing: SUMO died "), "{said}");
    assert!(said.contains(" of signal 6; its last words, if it had some, are above\n  way out: look at"), "{said}");
    assert_eq!(output.status.signal(), Some(6), "{said}");
}
