//! The run that a checkpoint belongs to, and what about it may not have changed since.

use std::path::Path;

use anyhow::{Result, bail};
use serde_json::{Value, json};

use crate::config::RunConfig;
use crate::config::resume::{Difference, differences, differing_json};
use crate::records::files;
use crate::records::run_json::RunJson;
use dials_core::domain::{Domain, Kinds, Scenario};
use dials_core::outside::Printable;

/// The run in a directory: its config, what it simulates, and its agents.
#[derive(Clone, Debug)]
pub struct Owner {
    pub(crate) config: RunConfig,
    /// The scenario, as in `run.json`: with the checksums of the networks. Without its name, which copies of it have lost.
    pub(crate) scenario: Value,
    pub(crate) kinds: Kinds,
}

/// A sound checkpoint, but not of this run as it is now. A usage error that says what differs, and the way out.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct NotOfThisRun(pub String);

impl Owner {
    pub fn of(config: &RunConfig, domain: &dyn Domain) -> Result<Owner> {
        let scenario = without_name(domain.scenario()?)?;
        Ok(Owner { config: config.clone(), scenario, kinds: domain.kinds().clone() })
    }

    /// Checks that the `run.json` in `dir` describes this seed and scenario, for a run that begins again.
    pub(crate) fn check_described(&self, dir: &Path) -> Result<()> {
        let about = RunJson::read(dir)?;
        let [then, now] = [about.seed, self.config.learning.seed].map(|seed| json!({ "seed": seed }));
        let found = [differing_json(&then, &now), self.changes_since(dir, &about)?].concat();
        refuse(Some(dir), &found, TO_RESUME)
    }

    /// Checks that the networks and the domain's keys are those of the `run.json` in `dir`. The rules may be others.
    pub(crate) fn check_unchanged(&self, dir: &Path) -> Result<()> {
        let mut found = self.changes_since(dir, &RunJson::read(dir)?)?;
        found.retain(|difference| !difference.key.starts_with("scenario.rules."));
        refuse(Some(dir), &found, TO_PLAY)
    }

    /// Lists what differs from the domain that `about` describes. `dir`: the directory of the run.
    fn changes_since(&self, dir: &Path, about: &RunJson) -> Result<Vec<Difference>> {
        let mut found = about.kept.changed_keys(&self.config)?;
        let mut of_scenario = self.differences_from(&without_name(about.scenario.clone())?);
        if !of_scenario.is_empty() {
            found.extend(about.kept.changed_files(dir)?);
        }
        // A checksum says less than the key or the file.
        let is_checksum = |key: &str| key == "scenario.checksum" || key.starts_with("scenario.files.");
        of_scenario.retain(|difference| found.is_empty() || !is_checksum(&difference.key));
        found.extend(of_scenario);
        Ok(found)
    }

    fn differences_from(&self, scenario: &Value) -> Vec<Difference> {
        let differing = differing_json(scenario, &self.scenario).into_iter();
        differing.map(|found| Difference { key: format!("scenario.{}", found.key), ..found }).collect()
    }

    /// Checks that training with `config` on `scenario`, which has come to the step `until`, can continue as this run.
    pub(crate) fn check(&self, config: &RunConfig, scenario: &Value, until: u64) -> Result<()> {
        let mut found = differences(config, &self.config);
        found.extend(self.differences_from(scenario));
        refuse(None, &found, TO_RESUME)?;
        if until > self.config.learning.last_step() {
            bail!(NotOfThisRun(format!(
                "stop_at_steps = {} (`--steps`): training has come to step {until} already; ask for {until} or more, or \
                 leave it out",
                self.config.learning.last_step()
            )));
        }
        Ok(())
    }
}

/// Like [`Owner::check_unchanged`], for readers of figures, who need neither the domain nor the networks.
pub(crate) fn check_kept(dir: &Path, config: &RunConfig, about: &RunJson) -> Result<()> {
    let mut found = about.kept.changed_keys(config)?;
    // A copy of a run may leave out the networks.
    let is_there = |difference: &Difference| difference.then.is_some() && difference.now.is_some();
    found.extend(about.kept.changed_files(dir)?.into_iter().filter(is_there));
    refuse(Some(dir), &found, TO_READ)
}

/// The way out for a resume, for whoever plays the policies, and for whoever reads the figures.
const TO_RESUME: &str = "put them back to resume, or begin a new run";
const TO_PLAY: &str = "put them back, for example from a copy; or leave this run as it was, and play its policies on another \
                       scenario with: dials-traffic baseline CONFIG --compare RUN";
const TO_READ: &str = "put them back, for example from a copy: the figures of this run were measured with them";

fn without_name(scenario: Scenario) -> Result<Value> {
    Ok(serde_json::to_value(Scenario { name: None, ..scenario })?)
}

/// Returns an error that lists the differences, if there are any. `dir`: the directory whose `run.json` says how it was.
fn refuse(dir: Option<&Path>, differences: &[Difference], way_out: &str) -> Result<()> {
    if differences.is_empty() {
        return Ok(());
    }
    let place = dir.map_or(String::new(), |dir| format!("{}: ", dir.join(files::RUN).display()));
    let text = |value: &Option<Value>| value.as_ref().map_or("not set".to_owned(), Value::to_string);
    let line = |Difference { key, then, now }: &Difference| {
        Printable(format_args!("{key}: {} there, {} here", text(then), text(now))).to_string()
    };
    bail!(NotOfThisRun(format!(
        "{place}was written with other settings or networks than this run directory has now:\n  {}\n  {way_out} \
         (`scenario` is the domain, with checksums of the files in networks/)",
        differences.iter().map(line).collect::<Vec<_>>().join("\n  ")
    )))
}
