//! What of a config may change when a run is resumed. All other keys determine the trained policies.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::Result;
use serde_json::Value;

use super::RunConfig;
use dials_learn::config::Retrain;

/// The keys of the config that may change when a run is resumed, because the trained policies do not depend on them.
/// `evaluation.seed` is not among them: evaluations before and after would be of different episodes, but in one file.
pub const CHANGEABLE: [&str; 8] = [
    // It only moves the end: learning rate and clip range decay over `total_steps`.
    "stop_at_steps",
    // An evaluation leaves no trace in training.
    "evaluation.every_steps",
    "evaluation.episodes",
    "evaluation.final_episodes",
    "evaluation.aip_loss_episodes",
    // Neither do a checkpoint and a file more.
    "checkpoints.every_steps",
    "checkpoints.every_minutes",
    "logging.tensorboard",
];

/// Those that must stay with `aip.retrain = "drift"`, where evaluations decide when the AIPs are trained.
const FIXED_BY_DRIFT: [&str; 2] = ["evaluation.every_steps", "evaluation.aip_loss_episodes"];

/// A key that must be as it was, with both values as JSON. A key that is not set has no value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Difference {
    pub(crate) key: String,
    pub(crate) then: Option<Value>,
    pub(crate) now: Option<Value>,
}

/// Returns a config as JSON. The paths of the domain's files are empty: a run directory may be moved.
pub(crate) fn to_json(config: &RunConfig) -> Value {
    let mut config = config.clone();
    config.domain.iter_mut().flat_map(|domain| domain.table_mut().paths()).for_each(|(_, path)| *path = PathBuf::new());
    serde_json::to_value(config).expect("a config without paths is plain data")
}

/// Reads and checks a config of [`to_json`]. An unknown key is an error.
pub(crate) fn from_json(json: Value) -> Result<RunConfig> {
    let config: RunConfig = serde_json::from_value(json)?;
    config.check()?;
    Ok(config)
}

/// Returns the text of a config with another `stop_at_steps`. All other lines stay.
pub fn with_end(text: &str, stop_at_steps: u64) -> String {
    let top = text.lines().take_while(|line| !line.trim_start().starts_with('[')).count();
    let is_end = |line: &str| line.split_once('=').is_some_and(|(key, _)| key.trim() == "stop_at_steps");
    let mut lines = vec![format!("stop_at_steps = {stop_at_steps}")];
    let kept = text.lines().enumerate().filter(|(number, line)| *number >= top || !is_end(line));
    lines.extend(kept.map(|(_, line)| line.to_owned()));
    lines.join("\n") + "\n"
}

/// Lists the differences, by key, that forbid a run of `then` to continue with `now`, without those of files.
pub(crate) fn differences(then: &RunConfig, now: &RunConfig) -> Vec<Difference> {
    let drift = now.learning.trains_predictors() && now.learning.aip.retrain == Retrain::Drift;
    let may_change = |key: &str| CHANGEABLE.contains(&key) && !(drift && FIXED_BY_DRIFT.contains(&key));
    let mut found = differing_json(&to_json(then), &to_json(now));
    found.retain(|difference| !may_change(&difference.key));
    found
}

/// Lists all values in which two objects differ, in the order of their keys.
pub(crate) fn differing_json(then: &Value, now: &Value) -> Vec<Difference> {
    let [then, now] = [then, now].map(|json| {
        let mut values = BTreeMap::new();
        flatten("", json, &mut values);
        values
    });
    differing(&then, &now).into_iter().map(|(key, [then, now])| Difference { key, then, now }).collect()
}

/// Returns the keys whose values differ, in order. `None`: this side has no such key.
pub fn differing<V: Clone + PartialEq>(
    a: &BTreeMap<String, V>,
    b: &BTreeMap<String, V>,
) -> Vec<(String, [Option<V>; 2])> {
    let keys: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
    let differing = keys.into_iter().filter(|key| a.get(*key) != b.get(*key));
    differing.map(|key| (key.clone(), [a.get(key).cloned(), b.get(key).cloned()])).collect()
}

/// Adds the values of an object under their whole keys, such as `ppo.clip`. An empty table has no values.
fn flatten(key: &str, json: &Value, values: &mut BTreeMap<String, Value>) {
    let Value::Object(inner) = json else {
        values.insert(key.to_owned(), json.clone());
        return;
    };
    for (name, value) in inner {
        let place = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
        flatten(&place, value, values);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_learn::config::Predictor;
    use serde_json::json;

    /// Returns a config of the traffic domain in which every key has a value.
    fn config() -> RunConfig {
        toml::from_str(
            "stop_at_steps = 900_000\npolicy = { recurrent = 8, average_every_steps = 1000 }\nppo.max_gradient_norm = 0.75\n\
             aip = { recurrent = 8, batch = 8, patience = 3 }\ncheckpoints = { every_steps = 1000 }\n[traffic]\n\
             network = 'n'\nlocal_network = 'l'\nclock = 26\nclock_offsets = 'checkerboard'\nuntil_first_switch = 'program'\n",
        )
        .unwrap()
    }

    #[test]
    fn the_list_of_what_may_change_names_keys_that_exist() {
        let json = to_json(&config());
        assert_eq!(json["traffic"]["network"], json!(""), "the contents of files count, and not their places");
        let mut values = BTreeMap::new();
        flatten("", &json, &mut values);
        assert!(CHANGEABLE.iter().all(|key| values.contains_key(*key)), "{values:?}");
    }

    #[test]
    fn only_the_end_of_a_config_moves() {
        let text = "seed = 3\nstop_at_steps = 900\n[ppo]\nclip = 0.2\n";
        assert_eq!(with_end(text, 40), "stop_at_steps = 40\nseed = 3\n[ppo]\nclip = 0.2\n");
        assert_eq!(with_end("[ppo]\nclip = 0.2\n", 40), "stop_at_steps = 40\n[ppo]\nclip = 0.2\n");
    }

    #[test]
    fn with_drift_the_evaluations_that_decide_must_stay() {
        let mut then = config();
        then.learning.aip.retrain = Retrain::Drift;
        then.learning.evaluation.aip_loss_episodes = 4;
        let mut now = then.clone();
        let evaluation = &mut now.learning.evaluation;
        (evaluation.every_steps, evaluation.episodes, evaluation.aip_loss_episodes) = (50_000, 1, 5);
        let keys = |then: &RunConfig, now: &RunConfig| -> Vec<String> {
            differences(then, now).into_iter().map(|difference| difference.key).collect()
        };
        assert_eq!(keys(&then, &now), ["evaluation.aip_loss_episodes", "evaluation.every_steps"]);
        // Predictors that are never trained do not drift.
        [&mut then, &mut now].into_iter().for_each(|config| config.learning.predictor = Predictor::Untrained);
        assert_eq!(keys(&then, &now), [""; 0]);
    }

    #[test]
    fn numbers_come_back_from_json_to_the_last_bit() {
        let mut config = config();
        for index in 1..2000_u64 {
            config.learning.ppo.learning_rate = f64::from_bits(dials_core::base::scramble(index) >> 12 | 1022 << 52);
            let text = to_json(&config).to_string();
            let again = from_json(serde_json::from_str(&text).unwrap()).unwrap();
            assert_eq!(again.learning.ppo.learning_rate.to_bits(), config.learning.ppo.learning_rate.to_bits());
        }
    }

    #[test]
    fn the_guide_lists_what_may_change() {
        let guide = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/guide.md")).unwrap();
        let (_, rows) = guide.split_once("| may change | why |\n|---|---|\n").expect("the table");
        let listed: Vec<&str> =
            rows.lines().map_while(|row| row.strip_prefix("| `")?.split_once('`').map(|(key, _)| key)).collect();
        assert_eq!(listed, CHANGEABLE);
    }
}
