//! A config as JSON for programs.

use serde_json::{Value, json};

use super::Described;
use dials_core::outside::path_as_text;

/// Returns the whole object.
pub(super) fn described(described: &Described) -> Value {
    let Described { path, config, domain, tasks, work, workers, estimate } = described;
    let agents = tasks.iter().map(|agent| json!({ "agent": agent.agent.0, "name": agent.name, "task": agent.task }));
    let kinds = domain.kinds().specs().map(|spec| {
        json!({
            "observation_columns": spec.obs_dim,
            "actions": spec.n_actions,
            "sources": spec.sources.count(),
            "d_set_columns": spec.d_set_dim,
        })
    });
    json!({
        "config": path_as_text(path),
        "simulator": config.learning.short_form().name,
        "episode_steps": domain.kinds().horizon(),
        "not_simulated": domain.left_out(),
        "kinds": kinds.collect::<Vec<_>>(),
        "agents": agents.collect::<Vec<_>>(),
        "run": {
            "steps_per_agent": work.steps,
            "evaluations": work.evaluations + 1,
            "evaluation_episodes": work.evaluation_episodes,
            "final_episodes": work.final_episodes,
            "aip_trainings": work.retrainings,
            "dataset_episodes": work.dataset_episodes,
            "aip_epochs": work.epochs,
        },
        "cost": {
            "workers": workers,
            "seconds": estimate.seconds,
            "memory_mib": estimate.memory_mb,
            "measured_runs": estimate.measured_runs,
        },
    })
}
