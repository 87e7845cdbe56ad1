//! Which values make sense. Each error names the key, the value and what is allowed; if useful, also the paper's value.

use std::sync::LazyLock;

use anyhow::{Result, bail, ensure};
use schemars::Schema;
use schemars::generate::SchemaSettings;
use serde_json::Value;

use super::{Config, Simulator, aip, imitation};
use crate::algorithms;

/// Largest number of copies of the GS: each may be a process.
const MOST_GLOBAL_COPIES: usize = 256;

impl Config {
    /// Checks what does not depend on the domain.
    pub fn check(&self) -> Result<()> {
        check_limits(self)?;
        check_schedule(self)?;
        ensure!(
            self.simulator == Simulator::Local || self.copies() <= MOST_GLOBAL_COPIES,
            "{} = {}: must be at most {MOST_GLOBAL_COPIES} on the global simulator, where each copy is a process; set gs.copies",
            self.key_of_copies(),
            self.copies()
        );
        algorithms::of(self).check(self)?;
        self.policy.check()?;
        aip::check(self)?;
        imitation::check(self)
    }

    /// Checks whether policies can read observations that are sets, as the key `observation` asks.
    pub fn check_for_sets(&self, observation: &str) -> Result<()> {
        let policy = &self.policy;
        for (key, is_set) in [("recurrent", policy.recurrent.is_some()), ("separate_critic", policy.separate_critic)] {
            ensure!(!is_set, "policy.{key}: does not go with {observation} = \"lanes\"; remove one of the two keys");
        }
        ensure!(
            !policy.hidden.is_empty(),
            "policy.hidden = []: with {observation} = \"lanes\" it has at least one width"
        );
        Ok(())
    }

    /// Checks the datasets: whether episodes of this many steps fill the batches.
    pub fn check_datasets(&self, horizon: usize) -> Result<()> {
        aip::check_datasets(self, horizon)?;
        imitation::check_episodes(self, horizon)
    }
}

/// Checks the limits of whole numbers, which stand at the fields. Larger values must be typing errors: they would need
/// more memory than any machine has, or overflow.
fn check_limits(config: &Config) -> Result<()> {
    static SCHEMA: LazyLock<Schema> = LazyLock::new(|| {
        let settings = SchemaSettings::draft07().with(|settings| settings.inline_subschemas = true);
        settings.into_generator().into_root_schema_for::<Config>()
    });
    check_table("", SCHEMA.as_value(), &serde_json::to_value(config)?)
}

fn check_table(prefix: &str, schema: &Value, values: &Value) -> Result<()> {
    for (name, value) in values.as_object().into_iter().flatten() {
        let (key, schema) = (format!("{prefix}{name}"), &schema["properties"][name]);
        check_table(&format!("{key}."), schema, value)?;
        let Some(number) = value.as_u64() else { continue };
        if let Some(least) = schema["minimum"].as_u64().filter(|&least| number < least) {
            let advice = match (schema["advice"].as_str(), &schema["default"], schema["source"].as_str()) {
                (Some(advice), ..) => advice.to_owned(),
                (_, Value::Null, _) => "or leave it out".to_owned(),
                (_, default, Some(_)) => format!("the paper uses {default}"),
                (_, default, None) => format!("{default} is the default"),
            };
            bail!("{key} = {number}: must be at least {least} ({advice})");
        }
        if let Some(most) = schema["maximum"].as_u64().filter(|&most| number > most) {
            bail!("{key} = {number}: must be at most {most}");
        }
    }
    Ok(())
}

/// Largest number of training periods in a run: each one starts simulators and writes a checkpoint.
const MOST_PERIODS: u64 = 1_000_000;

fn check_schedule(config: &Config) -> Result<()> {
    if let Some(steps) = config.stop_at_steps {
        ensure!(
            steps <= config.total_steps,
            "stop_at_steps = {steps}: is larger than total_steps = {}; to train longer raise total_steps, over which \
             learning rate and clip decay",
            config.total_steps
        );
    }
    let minutes = config.checkpoints.every_minutes;
    ensure!(
        minutes > 0.0 && minutes.is_finite(),
        "checkpoints.every_minutes = {minutes}: must be more than 0; a large number leaves only the checkpoints between periods"
    );
    let (key_of_updates, per_update) = algorithms::of(config).updates();
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
            every >= per_update,
            "{key} = {every}: must be at least {key_of_updates} = {per_update}, the timesteps between two updates of the policies"
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
        "policy.average_every_steps: does not go with policy.share = \"kind\", where all agents have one policy; remove \
         it, or set policy.share = \"none\""
    );
    Ok(())
}

/// Largest size of a network. Two layers of this width have 16 million parameters, and there is one network per agent.
const MOST_LAYERS: usize = 16;
const MOST_WIDTH: usize = 4096;

pub(super) fn check_hidden(key: &str, hidden: &[usize], least: usize) -> Result<()> {
    ensure!(
        hidden.len() >= least && hidden.iter().all(|&width| width > 0),
        "{key} = {hidden:?}: must list one positive width per hidden layer"
    );
    ensure!(
        hidden.len() <= MOST_LAYERS && hidden.iter().all(|&width| width <= MOST_WIDTH),
        "{key} = {hidden:?}: must list at most {MOST_LAYERS} layers, each at most {MOST_WIDTH} wide"
    );
    Ok(())
}

pub(super) fn check_recurrent(key: &str, width: Option<usize>) -> Result<()> {
    ensure!(
        width.is_none_or(|width| (1..=MOST_WIDTH).contains(&width)),
        "{key} = {}: must be from 1 to {MOST_WIDTH}; leave it out for a network without memory",
        width.unwrap_or(0)
    );
    Ok(())
}

/// Checks that a batch is not larger than what is trained on: `(episodes, horizon)` without the share that is held out,
/// in whole episodes for a network with a memory, else in samples.
pub(super) fn check_batch(
    key: &str,
    batch: usize,
    (episodes, horizon): (usize, usize),
    held_out: f64,
    by_episode: bool,
    dataset: &str,
) -> Result<()> {
    let training = episodes - held_out_episodes(episodes, held_out);
    let (training, what) = if by_episode { (training, "episodes") } else { (training * horizon, "samples") };
    ensure!(training >= batch, "{key} = {batch}: must not exceed the {training} training {what} of {dataset}");
    Ok(())
}

/// Returns how many of `episodes` are held out: at least one, and at least one is not.
pub fn held_out_episodes(episodes: usize, share: f64) -> usize {
    ((episodes as f64 * share) as usize).clamp(1, episodes - 1)
}

pub(crate) fn positive(key: &str, value: f64, advice: &str) -> Result<()> {
    ensure!(value > 0.0 && value.is_finite(), "{key} = {value}: must be a positive number ({advice})");
    Ok(())
}

pub(crate) fn not_negative(key: &str, value: f64, advice: &str) -> Result<()> {
    ensure!(value >= 0.0 && value.is_finite(), "{key} = {value}: must not be negative ({advice})");
    Ok(())
}

pub(crate) fn share(key: &str, value: f64, advice: &str) -> Result<()> {
    ensure!((0.0..=1.0).contains(&value), "{key} = {value}: must be between 0 and 1 ({advice})");
    Ok(())
}

pub(super) fn inner_share(key: &str, value: f64) -> Result<()> {
    ensure!(value > 0.0 && value < 1.0, "{key} = {value}: must be between 0 and 1, both excluded");
    Ok(())
}
