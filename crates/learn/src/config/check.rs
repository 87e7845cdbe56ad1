//! Which values make sense. Each error names the key, the value and what is allowed; if useful, also the paper's value.

use anyhow::{Result, ensure};

use super::{Config, Retrain, imitation, ppo};

impl Config {
    /// Checks what does not depend on the domain.
    pub fn check(&self) -> Result<()> {
        check_sizes(self)?;
        check_schedule(self)?;
        ppo::check(self)?;
        check_networks(self)?;
        check_aip(self)?;
        imitation::check(self)
    }

    /// Checks the datasets: whether episodes of this many steps fill the batches.
    pub fn check_datasets(&self, horizon: usize) -> Result<()> {
        if self.trains_predictors() {
            check_datasets(self, horizon)?;
        }
        imitation::check_episodes(self, horizon)
    }
}

/// Rejects sizes that must be typing errors: they would need more memory than any machine has, or overflow.
fn check_sizes(config: &Config) -> Result<()> {
    let Config { ppo, aip, imitation, .. } = config;
    let sizes = [
        (1_000_000_000_000_000, "total_steps", config.total_steps),
        (10_000, "local_simulators.copies", config.local_simulators.copies as u64),
        (1_000_000, "ppo.rollout_steps", ppo.rollout_steps as u64),
        (1_000_000, "ppo.memory", ppo.memory as u64),
        (100_000, "ppo.epochs", ppo.epochs as u64),
        (10_000_000, "aip.dataset_steps", aip.dataset_steps as u64),
        (100_000, "aip.epochs", aip.epochs as u64),
        (100_000, "aip.patience", aip.patience.unwrap_or(0) as u64),
        (10_000_000, "imitation.dataset_steps", imitation.dataset_steps as u64),
        (100_000, "imitation.epochs", imitation.epochs as u64),
        (100_000, "evaluation.episodes", config.evaluation.episodes as u64),
        (100_000, "evaluation.final_episodes", config.evaluation.final_episodes as u64),
        (100_000, "evaluation.aip_loss_episodes", config.evaluation.aip_loss_episodes as u64),
    ];
    sizes.into_iter().try_for_each(|(most, key, value)| {
        ensure!(value <= most, "{key} = {value}: must be at most {most}");
        Ok(())
    })
}

/// Largest number of training periods in a run: each one starts simulators and writes a checkpoint.
const MOST_PERIODS: u64 = 1_000_000;

fn check_schedule(config: &Config) -> Result<()> {
    at_least(1, "total_steps", config.total_steps, "the paper uses 4000000")?;
    if let Some(steps) = config.stop_at_steps {
        at_least(1, "stop_at_steps", steps, "leave it out to train for total_steps")?;
        ensure!(
            steps <= config.total_steps,
            "stop_at_steps = {steps}: is larger than total_steps = {}; to train longer raise total_steps, over which \
             learning rate and clip decay",
            config.total_steps
        );
    }
    at_least(1, "local_simulators.copies", config.local_simulators.copies as u64, "the paper uses 1")?;
    at_least(1, "evaluation.every_steps", config.evaluation.every_steps, "100000 gives the paper's curves")?;
    at_least(1, "evaluation.episodes", config.evaluation.episodes as u64, "20 give a standard error near 1")?;
    at_least(1, "evaluation.final_episodes", config.evaluation.final_episodes as u64, "100 is the default")?;
    at_least(1, "aip.retrain_every_steps", config.aip.retrain_every_steps, "the paper uses 100000 to 4000000")?;
    let memory = config.ppo.memory as u64;
    let checkpoints = config.checkpoints.every_steps.map(|every| ("checkpoints.every_steps", every));
    let averages = config.policy.average_every_steps.map(|every| ("policy.average_every_steps", every));
    for (key, every) in [
        ("evaluation.every_steps", config.evaluation.every_steps),
        ("aip.retrain_every_steps", config.aip.retrain_every_steps),
    ]
    .into_iter()
    .chain(checkpoints)
    .chain(averages)
    {
        ensure!(
            every >= memory,
            "{key} = {every}: must be at least ppo.memory = {memory}, the timesteps between two updates of the policies"
        );
        let periods = config.last_step() / every;
        ensure!(
            periods <= MOST_PERIODS,
            "{key} = {every}: would cut {} timesteps into {periods} periods, but at most {MOST_PERIODS} are allowed; \
             raise it",
            config.last_step()
        );
    }
    if let Some((key, every)) = averages {
        ensure!(
            every <= config.total_steps,
            "{key} = {every}: is larger than total_steps = {}; lower it, or leave it out",
            config.total_steps
        );
    }
    ensure!(
        averages.is_none() || !config.shares_policies(),
        "policy.average_every_steps: does not go with gs.shared_policy = true, where all agents have one policy; remove \
         one of the two keys"
    );
    Ok(())
}

/// Largest size of a network. Two layers of this width have 16 million parameters, and there is one network per agent.
const MOST_LAYERS: usize = 16;
const MOST_WIDTH: usize = 4096;

fn check_networks(config: &Config) -> Result<()> {
    for (key, hidden, least) in [("policy.hidden", &config.policy.hidden, 1), ("aip.hidden", &config.aip.hidden, 0)] {
        ensure!(
            hidden.len() >= least && hidden.iter().all(|&width| width > 0),
            "{key} = {hidden:?}: must list one positive width per hidden layer"
        );
        ensure!(
            hidden.len() <= MOST_LAYERS && hidden.iter().all(|&width| width <= MOST_WIDTH),
            "{key} = {hidden:?}: must list at most {MOST_LAYERS} layers, each at most {MOST_WIDTH} wide"
        );
    }
    for (key, width) in [("policy.recurrent", config.policy.recurrent), ("aip.recurrent", config.aip.recurrent)] {
        ensure!(
            width.is_none_or(|width| (1..=MOST_WIDTH).contains(&width)),
            "{key} = {}: must be from 1 to {MOST_WIDTH}; leave it out for a network without memory",
            width.unwrap_or(0)
        );
    }
    Ok(())
}

fn check_aip(config: &Config) -> Result<()> {
    let aip = &config.aip;
    at_least(1, "aip.epochs", aip.epochs as u64, "for AIPs that are never trained: predictor = \"untrained\"")?;
    at_least(1, "aip.dataset_steps", aip.dataset_steps as u64, "the paper uses 10000")?;
    at_least(1, "aip.batch", aip.batch as u64, "the paper uses 128")?;
    positive("aip.learning_rate", aip.learning_rate, "the paper uses 1e-4")?;
    if let Some(patience) = aip.patience {
        at_least(1, "aip.patience", patience as u64, "leave it out to train all epochs")?;
    }
    not_negative("aip.weight_decay", aip.weight_decay, "0 is the default")?;
    ensure!(
        aip.weight_decay * aip.learning_rate < 1.0,
        "aip.weight_decay = {}: multiplied by aip.learning_rate = {} it must be less than 1",
        aip.weight_decay,
        aip.learning_rate
    );
    not_negative("aip.drift_threshold", aip.drift_threshold, "percent of the loss; 1.5 is the default")?;
    ensure!(
        !(config.trains_predictors() && aip.retrain == Retrain::Drift) || config.evaluation.aip_loss_episodes > 0,
        "aip.retrain = \"drift\": needs the loss of the AIPs at evaluations; set evaluation.aip_loss_episodes, to 4 \
         for traffic or 20 for the warehouse"
    );
    ensure!(
        aip.held_out > 0.0 && aip.held_out < 1.0,
        "aip.held_out = {}: must be between 0 and 1, both excluded",
        aip.held_out
    );
    Ok(())
}

fn check_datasets(config: &Config, horizon: usize) -> Result<()> {
    let aip = &config.aip;
    if !config.predictor().reads("batch") {
        return Ok(());
    }
    let episodes = config.dataset_episodes(horizon);
    let episodes = episodes - held_out_episodes(episodes, aip.held_out);
    let (training, what) = match aip.recurrent {
        Some(_) => (episodes, "episodes"),
        None => (episodes * horizon, "samples"),
    };
    ensure!(
        training >= aip.batch,
        "aip.batch = {}: must not exceed the {training} training {what} of a dataset",
        aip.batch
    );
    Ok(())
}

/// Returns how many of `episodes` are held out: at least one, and at least one is not.
pub fn held_out_episodes(episodes: usize, share: f64) -> usize {
    ((episodes as f64 * share) as usize).clamp(1, episodes - 1)
}

pub(super) fn at_least(least: u64, key: &str, value: u64, advice: &str) -> Result<()> {
    ensure!(value >= least, "{key} = {value}: must be at least {least} ({advice})");
    Ok(())
}

pub(super) fn positive(key: &str, value: f64, advice: &str) -> Result<()> {
    ensure!(value > 0.0 && value.is_finite(), "{key} = {value}: must be a positive number ({advice})");
    Ok(())
}

pub(super) fn not_negative(key: &str, value: f64, advice: &str) -> Result<()> {
    ensure!(value >= 0.0 && value.is_finite(), "{key} = {value}: must not be negative ({advice})");
    Ok(())
}

pub(super) fn share(key: &str, value: f64, advice: &str) -> Result<()> {
    ensure!((0.0..=1.0).contains(&value), "{key} = {value}: must be between 0 and 1 ({advice})");
    Ok(())
}
