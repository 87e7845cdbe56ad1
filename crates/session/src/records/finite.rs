//! Learning that has diverged: an error before the good files are overwritten.

use anyhow::Result;

use crate::config::RunConfig;
use dials_core::base::Ragged;
use dials_learn::influence::AipLoss;
use dials_learn::training::answers::PolicyTraining;
use dials_learn::training::imitation::ImitationLoss;
use dials_learn::training::state::AgentsState;

/// The error about learning that has diverged. A resume would diverge again.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Diverged(String);

/// Returns an error that names the first agent whose policy has diverged. `begun`: timesteps per agent at the beginning
/// of the period.
pub fn check_policies(training: &PolicyTraining, state: &AgentsState, config: &RunConfig, begun: u64) -> Result<()> {
    // At first only the critic learns, with the learning rate of the imitation.
    let critic_alone = |step| step < config.learning.critic_steps();
    let key = match (critic_alone(begun), critic_alone(state.steps.saturating_sub(config.learning.ppo.memory as u64))) {
        (_, true) => "imitation.learning_rate",
        (true, false) => "imitation.learning_rate or ppo.learning_rate",
        (false, false) => "ppo.learning_rate",
    };
    for (agent, training) in training.agents.iter().enumerate() {
        let losses = training.losses;
        if ![losses.surrogate, losses.value, losses.entropy, losses.kl].into_iter().all(f64::is_finite) {
            return diverged("policy", agent, "a loss", state.steps, key);
        }
    }
    let moments = [&state.moments.first, &state.moments.second].map(|table| (table, "a moment of its optimiser"));
    for (table, what) in std::iter::once((&state.policies, "a parameter")).chain(moments) {
        if let Some(agent) = first_bad_row(table) {
            return diverged("policy", agent, what, state.steps, key);
        }
    }
    Ok(())
}

/// Returns an error that names the first agent whose policy has diverged while it imitated a controller.
pub fn check_imitation(agents: &AgentsState, losses: &[ImitationLoss]) -> Result<()> {
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

/// Returns an error that names the first agent whose AIP (approximate influence predictor) has diverged.
pub fn check_aips(agents: &AgentsState, losses: &[AipLoss]) -> Result<()> {
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
