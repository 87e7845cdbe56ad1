//! Learning that has diverged: an error before the good files are overwritten.

use anyhow::Result;

use dials_core::base::Ragged;
use dials_core::domain::Kinds;
use dials_learn::algorithms;
use dials_learn::algorithms::imitation::ImitationLoss;
use dials_learn::config::Config;
use dials_learn::predictors::AipLoss;
use dials_learn::state::AgentsState;
use dials_learn::steps::train_policies::PolicyTraining;

/// The error about learning that has diverged. A resume would diverge again.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Diverged(String);

/// Returns an error that names the first agent whose policy has diverged. `begun`: timestep at which the period began.
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
    let mut losses = training.metrics.of_agents.iter().filter(|_| training.updates > 0);
    let bad_loss = losses.find_map(|(_, values)| values.iter().position(|value| !value.is_finite()));
    check("policy", state.steps, &key, "a loss", bad_loss)?;
    check("policy", state.steps, &key, "a parameter", first_bad_row(&state.policies))?;
    let tables = kinds.iter().flat_map(|kind| algorithm.layout(config, kind, state.steps).numbers);
    for name in tables.filter(|table| table.learnt).map(|table| table.name) {
        let what = format!("a value of its table `{name}`");
        check("policy", state.steps, &key, &what, first_bad_row(&state.learners.numbers[name]))?;
    }
    Ok(())
}

/// Returns an error that names the first agent whose policy has diverged while it imitated a controller.
pub(crate) fn check_imitation(agents: &AgentsState, losses: &[ImitationLoss]) -> Result<()> {
    let bad_loss = losses.iter().position(|loss| !loss.cross_entropy.iter().all(|value| value.is_finite()));
    let key = "imitation.learning_rate";
    check("imitation", agents.steps, key, "a loss", bad_loss)?;
    check("imitation", agents.steps, key, "a parameter", first_bad_row(&agents.policies))
}

/// Returns an error that names the first agent whose AIP has diverged.
pub(crate) fn check_aips(agents: &AgentsState, losses: &[AipLoss]) -> Result<()> {
    let of_sources = |loss: &AipLoss| loss.training.iter().chain(&loss.held_out).flatten().all(|loss| loss.is_finite());
    let key = "aip.learning_rate";
    check("AIP", agents.steps, key, "a loss", losses.iter().position(|loss| !of_sources(loss)))?;
    check("AIP", agents.steps, key, "a parameter", first_bad_row(&agents.aips))
}

fn first_bad_row(table: &Ragged<f32>) -> Option<usize> {
    table.iter().position(|row| !row.iter().all(|value| value.is_finite()))
}

/// `bad`: the first agent for which `what` is no finite number. `key`: what to lower.
fn check(whose: &str, steps: u64, key: &str, what: &str, bad: Option<usize>) -> Result<()> {
    let Some(agent) = bad else { return Ok(()) };
    Err(Diverged(format!(
        "agent {agent}: its {whose} diverged before step {steps}: {what} is no longer a finite number; it was not \
         written, so what was written before is intact; lower {key} and begin a new run, because a resume keeps the \
         settings"
    ))
    .into())
}
