//! The part of a config that defines a method.

use std::collections::BTreeMap;

use toml::{Table, Value};

use crate::config::RunConfig;
pub use crate::config::resume::differing;
use dials_core::domain::Scenario;
use dials_learn::algorithms;
use dials_learn::config::{Retrain, ShortForm};

/// A method: a way of training, whatever the seed and the scenario.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Method {
    /// Short form of simulator and predictor.
    pub simulator: String,
    pub retraining: Retraining,
    /// Keys of the config with their values as text, without seed, stop, scenario and keys that change nothing.
    pub keys: BTreeMap<String, String>,
}

impl Method {
    /// Returns the method of a config. `scenario`: scenario of the run, which has the checksums of its files.
    pub fn of(config: &RunConfig, scenario: &Scenario) -> Method {
        let table = Table::try_from(config).expect("a config is a table");
        let mut keys = BTreeMap::new();
        flatten("", &table, &mut keys);
        let form = config.learning.short_form();
        keys.remove("predictor");
        keys.insert("simulator".to_owned(), form.name.to_owned());
        if let Some(mut domain) = config.domain.clone() {
            // The same file has another path in every run, so its checksum replaces the path, if it is known.
            let paths: Vec<&str> = domain.table_mut().paths().into_iter().map(|(key, _)| key).collect();
            paths.into_iter().for_each(|key| drop(keys.remove(&domain.key(key))));
            keys.extend(scenario.files.clone());
            if form.predictor.is_none() {
                domain.table().local_keys().iter().for_each(|key| drop(keys.remove(&domain.key(key))));
            }
        }
        let aip = &config.learning.aip;
        let retraining = match aip.retrain {
            _ if !form.trains_predictors() => Retraining::Never,
            Retrain::Every => Retraining::Every(aip.retrain_every_steps),
            Retrain::Once => Retraining::Once,
            Retrain::Drift => Retraining::Drift,
        };
        let (_, other_algorithms) = algorithms::tables(&config.learning);
        let is_of_another = |key: &str| key.split_once('.').is_some_and(|(table, _)| other_algorithms.contains(&table));
        let imitates = keys.contains_key("policy.imitate");
        keys.retain(|key, _| {
            !is_no_method(key)
                && !is_of_another(key)
                && !form_ignores(form, key)
                && !is_of_others(&retraining, imitates, key)
        });
        Method { simulator: form.name.to_owned(), retraining, keys }
    }

    /// Returns whether this method would read a key, but leaves it out: then it is off.
    pub fn has_off(&self, key: &str) -> bool {
        let imitates = self.keys.contains_key("policy.imitate");
        !self.keys.contains_key(key) && !is_of_others(&self.retraining, imitates, key)
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

/// Returns whether a key changes nothing in the learning.
fn is_no_method(key: &str) -> bool {
    ["seed", "stop_at_steps"].contains(&key) || key.starts_with("logging.") || key.starts_with("checkpoints.")
}

/// Returns whether a key changes nothing with this simulator and predictor.
fn form_ignores(form: ShortForm, key: &str) -> bool {
    match key.split_once('.') {
        Some(("aip", key)) => !form.predictor.is_some_and(|predictor| predictor.kind().reads(key)),
        Some(("gs", _)) => form.predictor.is_some(),
        Some(("local_simulators", _)) => form.predictor.is_none(),
        _ => false,
    }
}

/// Returns whether a key changes nothing with this retraining, or without an imitation (`imitates`).
fn is_of_others(retraining: &Retraining, imitates: bool, key: &str) -> bool {
    match key {
        // Only retraining on drift depends on what these episodes measure.
        "evaluation.aip_loss_episodes" | "aip.drift_threshold" => *retraining != Retraining::Drift,
        "aip.retrain_every_steps" => !matches!(retraining, Retraining::Every(_)),
        key => key.starts_with("imitation.") && !imitates,
    }
}

/// When AIPs are retrained after step 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Retraining {
    /// The AIPs are never trained, or there are none.
    Never,
    /// Every F timesteps per agent, as in the paper.
    Every(u64),
    /// Only at step 0.
    Once,
    /// When the loss of the AIPs has grown.
    Drift,
}

/// Writes a number of steps: `1M`, `500K`, `128`. It rounds, because periods are whole updates: 150 016 is `150K`.
pub fn steps_text(steps: u64) -> String {
    let rounded = |unit: f64, decimals: f64| (steps as f64 / unit * decimals).round() / decimals;
    match steps {
        0..1_000 => steps.to_string(),
        1_000..100_000 => format!("{}K", rounded(1e3, 10.0)),
        100_000..1_000_000 => format!("{}K", rounded(1e3, 1.0)),
        _ => format!("{}M", rounded(1e6, 100.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn method_of(keys: &str) -> Method {
        let config: RunConfig = toml::from_str(&format!("{keys}\n[warehouse]\nagents_per_side = 2")).unwrap();
        Method::of(&config, &Scenario::new("ants", 4, 100))
    }

    #[test]
    fn a_key_makes_another_method_only_where_it_changes_the_learning() {
        let retrain = |when: &str, every: u64| format!("aip = {{ retrain = '{when}', retrain_every_steps = {every} }}");
        let measure =
            |when: &str, episodes: u64| format!("aip.retrain = '{when}'\nevaluation.aip_loss_episodes = {episodes}");
        let gs = |keys: &str| format!("simulator = 'gs'\n{keys}");
        let imitates = |keys: &str| format!("policy.imitate = 'oldest-item'\n{keys}");
        for (one, other, same) in [
            ("seed = 1".to_owned(), "seed = 2\nstop_at_steps = 500\ncheckpoints.every_steps = 200".to_owned(), true),
            (String::new(), "ppo.clip = 0.2".to_owned(), false),
            (gs("aip.epochs = 1"), gs("aip.epochs = 2"), true),
            (String::new(), "policy.share = 'kind'".to_owned(), false),
            (gs(""), gs("policy.share = 'kind'"), false),
            (String::new(), "imitation.epochs = 3".to_owned(), true),
            (String::new(), imitates(""), false),
            (imitates(""), imitates("imitation.epochs = 3"), false),
            (retrain("once", 100_000), retrain("once", 200_000), true),
            (retrain("every", 100_000), retrain("every", 200_000), false),
            (measure("every", 4), measure("every", 8), true),
            (measure("drift", 4), measure("drift", 8), false),
        ] {
            assert_eq!(method_of(&one) == method_of(&other), same, "{one} / {other}");
        }
        let base = method_of("");
        assert_eq!((base.simulator.as_str(), base.retraining), ("dials", Retraining::Every(1_000_000)));
        assert!(!base.keys.contains_key("aip.drift_threshold"));
        assert!(method_of(&measure("drift", 4)).keys.contains_key("aip.drift_threshold"));
    }

    #[test]
    fn another_local_network_is_another_method_except_on_the_gs() {
        let method = |simulator: &str, local_network: u32| {
            let traffic = "[traffic]\nnetwork = 'n'\nlocal_network = 'l'";
            let config = toml::from_str(&format!("{}{traffic}", ShortForm::called(simulator).unwrap().keys())).unwrap();
            let files = [("traffic.local_network".to_owned(), local_network)];
            Method::of(&config, &Scenario::new("traffic", 4, 100).with_files(files))
        };
        assert_ne!(method("dials", 1), method("dials", 2));
        assert_eq!(method("gs", 1), method("gs", 2));
    }
}
