//! Learning that has diverged: an error before the good files are overwritten.

use anyhow::Result;

use dials_core::base::Ragged;
use dials_core::domain::Kinds;
use dials_learn::algorithms;
use dials_learn::algorithms::imitation::ImitationLoss;
use dials_learn::config::Config;
use dials_learn::influence::AipLoss;
use dials_learn::training::answers::PolicyTraining;
use dials_learn::training::state::AgentsState;

/// The error about learning that has diverged. A resume would diverge again.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Diverged(String);

/// Returns an error that names the first agent whose policy has diverged. `begun`: timesteps per agent at the beginning
/// of the period.
pub(crate) fn check_policies(
    training: &PolicyTraining,
    state: &AgentsState,
    config: &Config,
    kinds: &Kinds,
    begun: u64,
) -> Result<()> {
    let algorithm = algorithms::of(config);
    let [first, last] = [begun + algorithm.steps_per_update() as u64, state.steps]
        .map(|steps| algorithm.learning_rate_key(config, steps));
    let key = if first == last { last.to_owned() } else { format!("{first} or {last}") };
    for (_, values) in training.metrics.of_agents.iter().filter(|_| training.updates > 0) {
        if let Some(agent) = values.iter().position(|value| !value.is_finite()) {
            return diverged("policy", agent, "a loss", state.steps, &key);
        }
    }
    if let Some(agent) = first_bad_row(&state.policies) {
        return diverged("policy", agent, "a parameter", state.steps, &key);
    }
    let learnt = kinds.iter().flat_map(|kind| algorithm.layout(config, kind, state.steps).numbers);
    for name in learnt.filter(|table| table.learnt).map(|table| table.name) {
        if let Some(agent) = first_bad_row(&state.learners.numbers[name]) {
            return diverged("policy", agent, &format!("a value of its table `{name}`"), state.steps, &key);
        }
    }
    Ok(())
}

/// Returns an error that names the first agent whose policy has diverged while it imitated a controller.
pub(crate) fn check_imitation(agents: &AgentsState, losses: &[ImitationLoss]) -> Result<()> {
    let bad_loss = |loss: &ImitationLoss| !loss.cross_entropy.iter().all(|value| value.is_finite());
    let key = "imitation.learning_rate";
    if let Some(agent) = losses.iter().position(bad_loss) {
        return diverged("imitation", agent, "a loss", agents.steps, key);
    }
    match first_bad_row(&agents.policies) {
        Some(agent) => diverged("imitation", agent, "a parameter", agents.steps, key),
        None => Ok(()),
    }
}

/// Returns an error that names the first agent whose AIP has diverged.
pub(crate) fn check_aips(agents: &AgentsState, losses: &[AipLoss]) -> Result<()> {
    for (agent, loss) in losses.iter().enumerate() {
        if !loss.training.iter().chain(&loss.held_out).flatten().all(|loss| loss.is_finite()) {
            return diverged("AIP", agent, "a loss", agents.steps, "aip.learning_rate");
        }
    }
    match first_bad_row(&agents.aips) {
        Some(agent) => diverged("AIP", agent, "a parameter", agents.steps, "aip.learning_rate"),
        None => Ok(()),
    }
}

fn first_bad_row(table: &Ragged<f32>) -> Option<usize> {
    table.iter().position(|row| !row.iter().all(|value| value.is_finite()))
}

fn diverged(whose: &str, agent: usize, what: &str, steps: u64, key: &str) -> Result<()> {
    Err(Diverged(format!(
        "agent {agent}: its {whose} diverged before step {steps}: {what} is no longer a finite number; it was not \
         written, so what was written before is intact; lower {key} and begin a new run, because a resume keeps the \
         settings"
    ))
    .into())
}
