//! The run that a checkpoint belongs to, and what about it may not have changed since.

use std::path::Path;

use anyhow::Result;
use serde_json::{Value, json};

use crate::config::Config;
use crate::config::resume::{Difference, differences, differing};
use crate::domain::{Domain, Kinds};
use crate::outside::Printable;
use crate::records::files;
use crate::records::run_json::RunJson;

/// The run in a directory: its config, what it simulates, and its agents.
#[derive(Clone, Debug)]
pub struct Owner {
    pub config: Config,
    /// The scenario, as in `run.json`: with the checksums of the networks.
    pub scenario: Value,
    pub kinds: Kinds,
}

/// A checkpoint that is sound, but not of this run as it is now. A usage error: the message says what differs, and the
/// way out.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct NotOfThisRun(pub String);

impl Owner {
    pub fn of(config: &Config, domain: &dyn Domain) -> Result<Owner> {
        let scenario = serde_json::to_value(domain.scenario()?)?;
        Ok(Owner { config: config.clone(), scenario, kinds: domain.kinds().clone() })
    }

    /// Returns an error if the `run.json` in `dir` describes another seed or scenario. A run without a checkpoint begins
    /// again, but as the run that was described.
    pub fn check_described(&self, dir: &Path) -> Result<()> {
        let about = RunJson::read_if_there(dir)?;
        let now = json!({ "seed": self.config.seed, "scenario": self.scenario });
        let mut then = now.clone();
        if let Some(seed) = about.seed {
            then["seed"] = json!(seed);
        }
        if let Some(scenario) = about.scenario {
            then["scenario"] = serde_json::to_value(scenario)?;
        }
        refuse(&format!("{}: ", dir.join(files::RUN).display()), &differing(&then, &now)).map_err(Into::into)
    }

    /// Returns an error if training with `config` and on `scenario` cannot continue as this run. `until`: the step that
    /// it has come to.
    pub fn check(&self, config: &Config, scenario: &Value, until: u64) -> Result<(), NotOfThisRun> {
        let mut found = differences(config, &self.config);
        found.extend(
            differing(scenario, &self.scenario)
                .into_iter()
                .map(|difference| Difference { key: format!("scenario.{}", difference.key), ..difference }),
        );
        refuse("", &found)?;
        if until > self.config.last_step() {
            return Err(NotOfThisRun(format!(
                "stop_at_steps = {}: training has come to step {until} already; set it to {until} or more, or leave it \
                 out",
                self.config.last_step()
            )));
        }
        Ok(())
    }
}

fn refuse(place: &str, differences: &[Difference]) -> Result<(), NotOfThisRun> {
    if differences.is_empty() {
        return Ok(());
    }
    let lines: Vec<String> = differences.iter().map(line).collect();
    Err(NotOfThisRun(format!(
        "{place}was written with other settings or networks than this run directory has now:\n  {}\n  put them back to \
         resume, or begin a new run (`scenario` is the domain, with checksums of the files in networks/)",
        lines.join("\n  ")
    )))
}

fn line(difference: &Difference) -> String {
    let text = |value: &Option<Value>| value.as_ref().map_or("not set".to_owned(), Value::to_string);
    let Difference { key, then, now } = difference;
    Printable(format_args!("{key}: {} there, {} here", text(then), text(now))).to_string()
}
