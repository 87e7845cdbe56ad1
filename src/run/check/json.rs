//! The figures of `check` as JSON for programs.

use serde_json::{Value, json};

use super::{Checked, together};
use dials_traffic::fidelity::agreement::Comparison;
use dials_traffic::fidelity::doubts::doubt;

/// Returns the whole object. Precision and recall compare the local simulator with the global one; in `other_seed`, two
/// local simulators.
pub(super) fn described(checked: &Checked) -> Value {
    let Checked { window, sigma, seed, lights, .. } = checked;
    let is_random = lights.iter().any(|light| light.other_seed.is_some());
    let other = is_random.then(|| together(lights, |light| light.other_seed.unwrap_or_default()));
    let each = lights.iter().map(|light| {
        json!({
            "id": light.light,
            "true_entries": entries(light.true_entries),
            "sampled_entries": entries(light.sampled_entries),
            "other_seed": light.other_seed.map(cells),
            "spillback": light.causes.spillback,
            "short_entries": light.causes.short_entries,
            "doubt": doubt(light),
        })
    });
    json!({
        "begin": window.start,
        "seconds": window.len(),
        "sigma": sigma,
        "seed": seed,
        "lights": each.collect::<Vec<_>>(),
        "all": {
            "true_entries": entries(together(lights, |light| light.true_entries)),
            "sampled_entries": entries(together(lights, |light| light.sampled_entries)),
            "other_seed": other.map(cells),
        },
    })
}

fn cells(comparison: Comparison) -> Value {
    let cells = comparison.cells;
    json!({
        "precision": cells.precision(),
        "recall": cells.recall(),
        "occupancy_ratio": cells.occupancy_ratio(),
    })
}

fn entries(comparison: Comparison) -> Value {
    let mut value = cells(comparison);
    let [gs, ls] = comparison.sums;
    let object = value.as_object_mut().expect("made as an object");
    object.insert("mean_speed_mps".into(), json!({ "gs": gs.mean_speed_mps(), "ls": ls.mean_speed_mps() }));
    object.insert("passed_per_h".into(), json!({ "gs": gs.passed_per_h(), "ls": ls.passed_per_h() }));
    object.insert("backlog".into(), json!(ls.backlog()));
    object.insert("waited_share".into(), json!(ls.waited_share()));
    object.insert("dropped_share".into(), json!(ls.dropped_share()));
    object.insert("lost".into(), json!(ls.lost));
    value
}
