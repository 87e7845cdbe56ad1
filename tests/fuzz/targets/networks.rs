//! The files of SUMO networks. What the library lets through is loaded and played by the program.

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use dials_session::domains::DomainConfig;
use dials_traffic::Traffic;
use dials_traffic::config::TrafficTable;
use serde_json::Value;

use super::{of_project, read_all};
use crate::place::{empty, work};
use crate::program;
use crate::verdict::Verdict;

const CONFIG: &str = "[traffic]\nnetwork = 'grid_2x2'\nlocal_network = 'local'\nhorizon = 40\n\
                      [aip]\ndataset_steps = 200\nbatch = 8\n[evaluation]\nepisodes = 1\nfinal_episodes = 1\n";
const NETWORKS: [&str; 2] = ["grid_2x2", "local"];
const ENDINGS: [&str; 4] = ["net.xml", "rou.xml", "actuated.add.xml", "sumocfg"];

/// Whether another file of this kind may change what is simulated.
#[derive(PartialEq)]
enum Freedom {
    None,
    /// How often cars arrive.
    Arrivals,
}

/// Names the file of a target, and what of it the user chooses.
macro_rules! network_file {
    ($call:ident, $seeds:ident, $file:literal, $freedom:expr) => {
        pub fn $seeds() -> Vec<Vec<u8>> {
            read_all(&[concat!("sumo_nets/", $file)])
        }

        pub fn $call(bytes: &[u8]) -> Verdict {
            with_file($file, bytes, $freedom)
        }
    };
}

network_file!(net, net_seeds, "grid_2x2.net.xml", Freedom::None);
network_file!(local_net, local_net_seeds, "local.net.xml", Freedom::None);
network_file!(routes, routes_seeds, "grid_2x2.rou.xml", Freedom::Arrivals);
network_file!(local_routes, local_routes_seeds, "local.rou.xml", Freedom::None);
network_file!(actuated, actuated_seeds, "grid_2x2.actuated.add.xml", Freedom::None);

/// Elements in one another, so many that no stack holds a call for each.
pub fn deep_nest() -> Vec<Vec<u8>> {
    let depth = 500_000;
    vec![["<net>".repeat(depth), "</net>".repeat(depth)].concat().into_bytes()]
}

/// Simulates with one file of a network replaced. An accepted one simulates the same as the original.
fn with_file(file: &str, bytes: &[u8], freedom: Freedom) -> Verdict {
    static ORIGINAL: OnceLock<Vec<Value>> = OnceLock::new();
    // Beside the folder outside, because SUMO writes relative to the file that says where to.
    let nets = work();
    for (network, ending) in NETWORKS.iter().flat_map(|network| ENDINGS.map(|ending| (network, ending))) {
        let name = format!("{network}.{ending}");
        fs::copy(of_project("sumo_nets").join(&name), nets.join(&name)).expect("a file of this project");
    }
    let path = nets.join("config.toml");
    fs::write(&path, CONFIG).expect("a file to work with");
    let original = ORIGINAL.get_or_init(|| play().expect("our own network can be played"));
    fs::write(nets.join(file), bytes).expect("a file to work with");
    if let Err(error) = open(&path) {
        return Verdict::refused(error);
    }
    // It would be loaded in SUMO before the folder is found to be taken.
    let _ = empty("taken");
    let tried = program::run(&["train", "config.toml", "--out", "taken"]);
    assert_ne!(tried.code, 0, "the folder was taken");
    if !tried.stderr.contains("exists already") {
        return Verdict::Refused(tried.stderr);
    }
    match play() {
        Err(error) => Verdict::Refused(error),
        Ok(returns) => {
            assert!(freedom == Freedom::Arrivals || returns == *original, "it simulates something else: {returns:?}");
            Verdict::Accepted
        }
    }
}

fn open(config: &Path) -> anyhow::Result<()> {
    match dials_session::config::load(config, &[])?.domain {
        Some(DomainConfig::Traffic(TrafficTable::Grid(table))) => Traffic::open(&table).map(drop),
        _ => unreachable!("the config is of traffic"),
    }
}

/// Plays an episode under the actuated lights, which need every file, and returns the agents' figures.
fn play() -> Result<Vec<Value>, String> {
    let arguments = ["baseline", "config.toml", "--controller", "actuated", "--episodes", "1", "--json"];
    let played = program::run(&arguments);
    if played.code != 0 {
        return Err(played.stderr);
    }
    let json: Value = serde_json::from_str(&played.stdout).expect("the program prints JSON");
    let figures = json["per_agent"].as_array().expect("it has a list of agents").clone();
    Ok(figures)
}
