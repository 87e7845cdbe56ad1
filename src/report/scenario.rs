//! What is comparable: the scenario that agents live in, and what of a config makes a method.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use toml::{Table, Value};

use crate::config::Config;
use crate::traffic::network::files::NetworkFiles;

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

    /// As [`Scenario::title`], with what sets it apart from other scenarios of as many agents.
    pub fn title_among<'a>(&self, scenarios: impl Iterator<Item = &'a Scenario> + Clone) -> String {
        let alike = scenarios.filter(|other| (other.domain, other.agents) == (self.domain, self.agents));
        let mut title = self.title();
        if alike.clone().any(|other| other.horizon != self.horizon) {
            title += &format!(", {} steps", self.horizon);
        }
        if alike.clone().any(|other| other.network != self.network) {
            title += &self.network.map_or(", network unknown".to_owned(), |network| format!(", network {network:08x}"));
        }
        title
    }

    /// A word that no other scenario has: `traffic-4-300-1a2b3c4d`.
    pub fn id(&self) -> String {
        let network = self.network.map_or(String::new(), |network| format!("-{network:08x}"));
        format!("{}-{}-{}{network}", self.domain.name(), self.agents, self.horizon)
    }
}

/// Of a network whose files are there; a run keeps them byte by byte.
fn checksum(network: &Path) -> Result<Option<u32>> {
    let files = NetworkFiles::of(network);
    let there = files.net.is_file() && files.routes.is_file();
    there.then(|| files.checksum()).transpose()
}

const LOCAL_NETWORK: &str = "traffic.local_network";

/// What makes a method.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Method {
    /// As configs name it.
    pub simulator: String,
    pub retraining: Retraining,
    /// The keys of the config, as text: all but the seed, where it stops, the scenario, and what changes nothing.
    pub keys: BTreeMap<String, String>,
}

impl Method {
    pub fn of(config: &Config) -> Method {
        let table = Table::try_from(config).expect("a config is a table");
        let mut keys = BTreeMap::new();
        flatten("", &table, &mut keys);
        // The same file has another path in every run; one that is not there tells nothing.
        let local_network = config.traffic.as_ref().and_then(|traffic| checksum(&traffic.local_network).ok().flatten());
        keys.remove(LOCAL_NETWORK);
        keys.extend(local_network.map(|network| (LOCAL_NETWORK.to_owned(), format!("{network:08x}"))));
        Method::of_keys(config.simulator.name().to_owned(), keys)
    }

    fn of_keys(simulator: String, mut keys: BTreeMap<String, String>) -> Method {
        let retraining = match simulator.as_str() {
            "gs" | "untrained-dials" => Retraining::Never,
            _ => Retraining::of(&keys),
        };
        keys.retain(|key, _| !is_no_method(key) && !is_idle(&simulator, &retraining, key));
        Method { simulator, retraining, keys }
    }
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

/// What changes nothing in the learning.
fn is_no_method(key: &str) -> bool {
    let keys = ["seed", "stop_at_steps", "traffic.network"];
    keys.contains(&key) || key.starts_with("logging.") || key.starts_with("checkpoints.")
}

/// Keys that change nothing with this simulator, or with this way of training the AIPs again.
fn is_idle(simulator: &str, retraining: &Retraining, key: &str) -> bool {
    let Some(of_aips) = key.strip_prefix("aip.") else {
        return match key {
            // Only what they find on drift is acted upon.
            "evaluation.aip_loss_episodes" => *retraining != Retraining::Drift,
            "traffic.d_set" | "traffic.entry" | LOCAL_NETWORK => simulator == "gs",
            key => simulator == "gs" && key.starts_with("local_simulators."),
        };
    };
    match (simulator, of_aips) {
        ("gs", _) => true,
        ("untrained-dials", of_aips) => !["hidden", "recurrent"].contains(&of_aips),
        ("marginal-dials", "hidden" | "recurrent" | "learning_rate" | "batch" | "epochs") => true,
        (_, "retrain_every_steps") => !matches!(retraining, Retraining::Every(_)),
        (_, "drift_threshold") => *retraining != Retraining::Drift,
        _ => false,
    }
}

/// When AIPs are trained again after step 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Retraining {
    /// There is no training of AIPs at all.
    Never,
    /// Every F timesteps per agent, as in the paper.
    Every(u64),
    Once,
    /// When their loss has grown.
    Drift,
}

impl Retraining {
    /// As the keys of a config say.
    fn of(keys: &BTreeMap<String, String>) -> Self {
        match keys.get("aip.retrain").map(String::as_str) {
            Some("once") => Retraining::Once,
            Some("drift") => Retraining::Drift,
            _ => {
                Retraining::Every(keys.get("aip.retrain_every_steps").and_then(|every| every.parse().ok()).unwrap_or(0))
            }
        }
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
        let base = Method::of(&config("seed = 1\n[warehouse]\nagents_per_side = 2"));
        let stops = "stop_at_steps = 500\ncheckpoints.every_steps = 200";
        let other = Method::of(&config(&format!("seed = 2\n{stops}\n[warehouse]\nagents_per_side = 2")));
        assert_eq!(base, other);
        assert_eq!((base.simulator.as_str(), base.retraining), ("dials", Retraining::Every(1_000_000)));
        let gs = |epochs| {
            let aip = format!("aip = {{ epochs = {epochs}, retrain_every_steps = {epochs}000 }}");
            Method::of(&config(&format!("simulator = 'gs'\n{aip}\n[warehouse]\nagents_per_side = 2")))
        };
        assert_eq!(gs(1), gs(2));
        let clip = Method::of(&config("ppo.clip = 0.2\n[warehouse]\nagents_per_side = 2"));
        assert_ne!(base, clip);
    }

    #[test]
    fn f_matters_only_where_aips_are_trained_every_f_steps() {
        let method = |retrain: &str, every: &str| {
            let keys = [("aip.retrain", retrain), ("aip.retrain_every_steps", every), ("aip.drift_threshold", "1.5")];
            Method::of_keys("dials".to_owned(), keys.map(|(key, value)| (key.to_owned(), value.to_owned())).into())
        };
        assert_eq!(method("once", "100"), method("once", "200"));
        assert_eq!(method("drift", "100"), method("drift", "200"));
        assert_ne!(method("every", "100"), method("every", "200"));
        assert_eq!(method("every", "100").retraining, Retraining::Every(100));
        assert!(!method("once", "100").keys.contains_key("aip.drift_threshold"));
        assert!(method("drift", "100").keys.contains_key("aip.drift_threshold"));
    }

    #[test]
    fn the_episodes_that_measure_the_aips_matter_only_where_their_loss_decides() {
        let method = |retrain: &str, episodes: usize| {
            let text = format!(
                "aip.retrain = '{retrain}'\nevaluation.aip_loss_episodes = {episodes}\n[warehouse]\nagents_per_side = 2"
            );
            Method::of(&config(&text))
        };
        assert_eq!(method("every", 4), method("every", 8));
        assert_eq!(method("once", 4), method("once", 8));
        assert_ne!(method("drift", 4), method("drift", 8));
    }

    #[test]
    fn scenarios_of_as_many_agents_are_told_apart_by_what_differs() {
        let scenario = |horizon, network| Scenario { domain: Domain::Traffic, agents: 4, horizon, network };
        let titles = |scenarios: &[Scenario]| -> Vec<String> {
            scenarios.iter().map(|scenario| scenario.title_among(scenarios.iter())).collect()
        };
        assert_eq!(titles(&[scenario(300, Some(1))]), ["traffic, 4 agents"]);
        assert_eq!(
            titles(&[scenario(300, Some(1)), scenario(100, Some(1))]),
            ["traffic, 4 agents, 300 steps", "traffic, 4 agents, 100 steps"]
        );
        assert_eq!(
            titles(&[scenario(300, Some(0x1a)), scenario(300, None)]),
            ["traffic, 4 agents, network 0000001a", "traffic, 4 agents, network unknown"]
        );
    }

    #[test]
    fn another_local_network_is_another_method_except_on_the_gs() {
        let method = |simulator: &str, local: &str| {
            let nets = concat!(env!("CARGO_MANIFEST_DIR"), "/sumo_nets");
            let traffic = format!("[traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/{local}'");
            Method::of(&config(&format!("simulator = '{simulator}'\n{traffic}")))
        };
        assert_ne!(method("dials", "local"), method("dials", "grid_2x2"));
        assert_eq!(method("gs", "local"), method("gs", "grid_2x2"));
        assert_eq!(method("dials", "local"), method("dials", "../sumo_nets/local"), "the same file");
    }

    #[test]
    fn scenarios_have_names() {
        let config = config("[warehouse]\nagents_per_side = 5");
        let scenario = Scenario::of(&config, 25).unwrap();
        assert_eq!((scenario.title().as_str(), scenario.id().as_str()), ("warehouse, 25 agents", "warehouse-25-100"));
    }
}
