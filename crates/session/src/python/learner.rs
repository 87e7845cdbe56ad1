//! The learner of `algorithm = "outside"`, in the Python process that started this run.

use anyhow::{Context, Result};
use serde::Deserialize;
use serde_json::{Value, json};

use super::link::{Array, Link};
use crate::config::RunConfig;
use dials_core::domain::{Action, Domain};
use dials_learn::algorithms::outside::{self, Decisions, OutsideLearner, Rollout, Waiting};

/// Connects to the learner, if the config has one outside of this program and this process does not have it yet.
pub(crate) fn connect(config: &RunConfig, domain: &dyn Domain) -> Result<()> {
    if !config.learning.learns_outside() || outside::is_installed() {
        return Ok(());
    }
    let kinds = domain.kinds();
    let names = domain.names();
    let agents = names
        .iter()
        .zip(kinds.specs())
        .map(|(name, spec)| json!({ "name": name, "obs_dim": spec.obs_dim, "n_actions": spec.n_actions }));
    let mut kind_of = vec![0; kinds.agents()];
    for (number, kind) in kinds.iter().enumerate() {
        kind.agents.iter().for_each(|agent| kind_of[agent.0] = number);
    }
    let learning = &config.learning;
    let about = json!({
        "agents": agents.collect::<Vec<_>>(),
        "kinds": kind_of,
        "copies": learning.copies(),
        "horizon": kinds.horizon(),
        "local_horizon": kinds[0].spec.local_horizon,
        "on_gs": learning.predictor_in_use().is_none(),
        "update_every_steps": learning.outside.update_every_steps,
        "total_steps": learning.total_steps,
        "seed": learning.seed,
    });
    let link = Link::open("learner", &about)?;
    let Opened { metrics } = Opened::deserialize(&link.opened).context("the learner in Python was not described")?;
    outside::install(Box::new(InPython { link, metrics }));
    Ok(())
}

/// What the Python process says of its learner.
#[derive(Deserialize)]
struct Opened {
    metrics: Vec<String>,
}

struct InPython {
    link: Link,
    metrics: Vec<String>,
}

impl OutsideLearner for InPython {
    fn act(&mut self, waiting: &Waiting<'_>) -> Result<Vec<Action>> {
        let Waiting { agents, copies, obs, masks, uniform, training_steps } = *waiting;
        let rows = agents.len();
        let arrays = [
            Array::of("agents", &[rows], agents),
            Array::of("copies", &[rows], copies),
            Array::of("obs", &[rows, obs.width()], obs.as_slice()),
            Array::of("masks", &[rows, masks.width()], masks.as_slice()),
            Array::of("uniform", &[rows], uniform),
        ];
        self.link.ask("act", json!({ "steps": training_steps }), &arrays)?.array("actions", &[rows])
    }

    fn learn(&mut self, rollout: &Rollout<'_>) -> Result<Option<Vec<Vec<f64>>>> {
        let Rollout { agents, copies, decisions, steps } = *rollout;
        let Decisions { obs, masks, actions, rewards, ends, next_obs, next_masks } = decisions;
        let rows = agents.len();
        let count = actions.len() / rows;
        let (width, n_actions) = (obs.width(), masks.width());
        let arrays = [
            Array::of("agents", &[rows], agents),
            Array::of("copies", &[rows], copies),
            Array::of("obs", &[count, rows, width], obs.as_slice()),
            Array::of("masks", &[count, rows, n_actions], masks.as_slice()),
            Array::of("actions", &[count, rows], actions),
            Array::of("rewards", &[count, rows], rewards),
            Array::of("ends", &[count, rows], ends),
            Array::of("next_obs", &[count, rows, width], next_obs.as_slice()),
            Array::of("next_masks", &[count, rows, n_actions], next_masks.as_slice()),
        ];
        let answer = self.link.ask("learn", json!({ "steps": steps }), &arrays)?;
        if answer.values != Value::Bool(true) {
            return Ok(None);
        }
        let values: Vec<f64> = answer.array("metrics", &[self.metrics.len(), rows])?;
        Ok(Some(values.chunks_exact(rows).map(<[f64]>::to_vec).collect()))
    }

    fn metrics(&self) -> &[String] {
        &self.metrics
    }

    fn state(&mut self) -> Result<Vec<u8>> {
        Ok(self.link.ask("state", Value::Null, &[])?.any_array("state")?.1)
    }

    fn load(&mut self, state: &[u8]) -> Result<()> {
        self.link.ask("load", Value::Null, &[Array::of("state", &[state.len()], state)]).map(drop)
    }
}
