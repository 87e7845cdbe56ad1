//! What an environment says of an agent.

use dials_core::domain::{Kind, Sets};
use serde_json::{Map, Value, json};

/// Describes an agent: its name, its kind, and the shapes of what it sees and does.
pub(crate) fn describe(name: &str, kind: &Kind) -> Map<String, Value> {
    let keys = [
        ("name", json!(name)),
        ("kind", json!(kind.name)),
        ("obs_dim", json!(kind.spec.obs_dim)),
        ("n_actions", json!(kind.spec.n_actions)),
        ("masks", json!(kind.spec.masks)),
        ("sets", json!(kind.spec.sets.as_ref().map(sets))),
    ];
    keys.map(|(key, value)| (key.to_owned(), value)).into_iter().collect()
}

/// Describes how sets lie in an observation. The room for items and choices is that of the observation.
pub(crate) fn sets(sets: &Sets) -> Value {
    json!({ "item_features": sets.item_features, "choice_features": sets.choice_features, "ways": sets.ways })
}
