//! The files of SUMO networks. What the library lets through is loaded and played by the program.

use std::fs;
use std::sync::OnceLock;

use anyhow::{Result, bail};
use dials_session::domains::DomainConfig;
use dials_traffic::Traffic;
use dials_traffic::config::TrafficTable;
use serde_json::Value;

use super::place::Place;
use super::{of_project, read_all};

const CONFIG: &str = "[traffic]\nnetwork = 'grid_2x2'\nlocal_network = 'local'\nhorizon = 40\n\
                      [aip]\ndataset_steps = 200\nbatch = 8\n[evaluation]\nepisodes = 1\nfinal_episodes = 1\n";

/// Names the file of a target, and whether another one may change how often cars arrive.
macro_rules! network_files {
    ($($call:ident, $seeds:ident, $file:literal, $may_change:literal;)*) => {
        $(pub(crate) fn $seeds(_: &Place) -> Vec<Vec<u8>> {
            read_all(&[concat!("sumo_nets/", $file)])
        }

        pub(crate) fn $call(place: &Place, bytes: &[u8]) -> Result<()> {
            with_file(place, $file, bytes, $may_change)
        })*
    };
}

network_files! {
    net, net_seeds, "grid_2x2.net.xml", false;
    local_net, local_net_seeds, "local.net.xml", false;
    routes, routes_seeds, "grid_2x2.rou.xml", true;
    local_routes, local_routes_seeds, "local.rou.xml", false;
    actuated, actuated_seeds, "grid_2x2.actuated.add.xml", false;
}

/// Elements in one another, so many that no stack holds a call for each.
pub(crate) fn deep_nest(_: &Place) -> Vec<Vec<u8>> {
    vec![["<net>", "</net>"].map(|tag| tag.repeat(500_000)).concat().into_bytes()]
}

/// Simulates with one file of a network replaced. An accepted one simulates the same as the original.
fn with_file(place: &Place, file: &str, bytes: &[u8], may_change: bool) -> Result<()> {
    static ORIGINAL: OnceLock<Value> = OnceLock::new();
    // Beside the folder outside, because SUMO writes relative to the file that says where to.
    for network in ["grid_2x2", "local"] {
        for ending in ["net.xml", "rou.xml", "actuated.add.xml", "sumocfg"] {
            let name = format!("{network}.{ending}");
            fs::copy(of_project("sumo_nets").join(&name), place.work().join(&name)).expect("a file of this project");
        }
    }
    let config = place.file("config.toml", CONFIG.as_bytes());
    let original = ORIGINAL.get_or_init(|| play(place).expect("our own network can be played"));
    place.file(file, bytes);
    let domain = dials_session::config::load(&config, &[])?.domain;
    let Some(DomainConfig::Traffic(TrafficTable::Grid(table))) = domain else { unreachable!("it is a grid") };
    Traffic::open(&table)?;
    // It would be loaded in SUMO before the folder is found to be taken.
    place.empty("taken");
    let tried = place.program(&["train", "config.toml", "--out", "taken"]);
    assert_ne!(tried.code, 0, "the folder was taken");
    if !tried.stderr.contains("exists already") {
        bail!(tried.stderr);
    }
    let played = play(place)?;
    assert!(may_change || played == *original, "it simulates something else: {played}");
    Ok(())
}

/// Plays an episode under the actuated lights, which need every file, and returns the agents' figures.
fn play(place: &Place) -> Result<Value> {
    let arguments = ["baseline", "config.toml", "--controller", "actuated", "--episodes", "1", "--json"];
    let played = place.program(&arguments);
    if played.code != 0 {
        bail!(played.stderr);
    }
    let json: Value = serde_json::from_str(&played.stdout).expect("the program prints JSON");
    Ok(json["per_agent"].clone())
}
