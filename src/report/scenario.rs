//! What is comparable: the scenario that agents live in, and what of a config makes a method.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use serde::Serialize;
use toml::{Table, Value};

use crate::config::Config;

/// The two domains of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Domain {
    Traffic,
    Warehouse,
}

impl Domain {
    pub fn name(self) -> &'static str {
        match self {
            Domain::Traffic => "traffic",
            Domain::Warehouse => "warehouse",
        }
    }
}

/// Where returns mean the same.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Scenario {
    pub domain: Domain,
    pub agents: usize,
    pub horizon: usize,
    /// Checksum of the GS's network, where there is one.
    pub network: Option<u32>,
}

impl Scenario {
    /// The scenario of a config with so many agents, with the network files that the config names where they are there.
    pub fn of(config: &Config, agents: usize) -> Result<Scenario> {
        let (domain, network) = match &config.traffic {
            Some(traffic) => (Domain::Traffic, checksum(&traffic.network)?),
            None => (Domain::Warehouse, None),
        };
        Ok(Scenario { domain, agents, horizon: config.horizon(), network })
    }

    /// `traffic, 4 agents`
    pub fn title(&self) -> String {
        format!("{}, {} agents", self.domain.name(), self.agents)
    }

    /// A word that no other scenario has: `traffic-4-300-1a2b3c4d`.
    pub fn id(&self) -> String {
        let network = self.network.map_or(String::new(), |network| format!("-{network:08x}"));
        format!("{}-{}-{}{network}", self.domain.name(), self.agents, self.horizon)
    }
}

/// Of the files that `nets` writes for the GS. A run keeps them byte by byte.
fn checksum(network: &Path) -> Result<Option<u32>> {
    let mut hasher = crc32fast::Hasher::new();
    for ending in ["net.xml", "rou.xml"] {
        let mut name = network.as_os_str().to_owned();
        name.push(format!(".{ending}"));
        let path = Path::new(&name);
        if !path.is_file() {
            return Ok(None);
        }
        hasher.update(&std::fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))?);
    }
    Ok(Some(hasher.finalize()))
}

/// What policies train on, as configs name it.
pub fn simulator(config: &Config) -> String {
    let value = Value::try_from(config.simulator).expect("a word");
    value.as_str().expect("a word").to_owned()
}

/// The keys of a config that make a method, as text: all but the seed, where it stops, the scenario, and what its
/// simulator does not look at.
pub fn method(config: &Config) -> BTreeMap<String, String> {
    let table = Table::try_from(config).expect("a config is a table");
    let mut keys = BTreeMap::new();
    flatten("", &table, &mut keys);
    let simulator = simulator(config);
    keys.retain(|key, _| !is_no_method(key) && !is_idle(&simulator, key));
    keys
}

fn flatten(prefix: &str, table: &Table, keys: &mut BTreeMap<String, String>) {
    for (name, value) in table {
        let key = format!("{prefix}{name}");
        match value {
            Value::Table(inner) => flatten(&format!("{key}."), inner, keys),
            Value::String(text) => drop(keys.insert(key, text.clone())),
            value => drop(keys.insert(key, value.to_string())),
        }
    }
}

fn is_no_method(key: &str) -> bool {
    ["seed", "stop_at_steps", "traffic.network", "traffic.local_network"].contains(&key)
}

/// Keys that change nothing with this simulator.
fn is_idle(simulator: &str, key: &str) -> bool {
    let training_of_aips = key.starts_with("aip.") && !["aip.hidden", "aip.recurrent"].contains(&key);
    match simulator {
        "gs" => {
            key.starts_with("aip.")
                || key.starts_with("local_simulators.")
                || ["traffic.d_set", "traffic.entry"].contains(&key)
        }
        "untrained-dials" => training_of_aips,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(text: &str) -> Config {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn seeds_and_stops_are_no_methods_and_neither_is_what_a_simulator_ignores() {
        let base = method(&config("seed = 1\n[warehouse]\nagents_per_side = 2"));
        let other = method(&config("seed = 2\nstop_at_steps = 500\n[warehouse]\nagents_per_side = 2"));
        assert_eq!(base, other);
        assert_eq!(base["aip.retrain_every_steps"], "1000000");
        let gs = |epochs| {
            method(&config(&format!("simulator = 'gs'\naip.epochs = {epochs}\n[warehouse]\nagents_per_side = 2")))
        };
        assert_eq!(gs(1), gs(2));
        let clip = method(&config("ppo.clip = 0.2\n[warehouse]\nagents_per_side = 2"));
        assert_ne!(base, clip);
    }

    #[test]
    fn scenarios_have_names() {
        let config = config("[warehouse]\nagents_per_side = 5");
        let scenario = Scenario::of(&config, 25).unwrap();
        assert_eq!((scenario.title().as_str(), scenario.id().as_str()), ("warehouse, 25 agents", "warehouse-25-100"));
    }
}
