//! Runs that differ in nothing but their seed are a group; groups of one scenario stand beside each other.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Result;

use super::find::{Baseline, Found, LeftOut};
use super::run_dir::{RunRecord, Status};
use super::scenario::{Method, Retraining, Scenario};

/// All groups of one scenario, in the order in which they are told: GS, DIALS by F, other simulators, variants last.
pub struct Comparison {
    pub scenario: Scenario,
    /// Unique among the comparisons of a report, fit for file names: `traffic_4`.
    pub slug: String,
    pub groups: Vec<Group>,
    /// Hand-coded controllers that were measured here.
    pub baselines: Vec<Baseline>,
}

/// Runs of one method over several seeds.
pub struct Group {
    pub method: Method,
    /// Keys of the config that set it apart from most groups of the scenario, with its values.
    pub overrides: Vec<(String, String)>,
    /// By seed.
    pub runs: Vec<RunRecord>,
}

impl Group {
    /// As the paper names it: `DIALS F=1M`.
    pub fn name(&self) -> String {
        method_name(self.simulator(), self.method.retraining)
    }

    /// As configs name it.
    pub fn simulator(&self) -> &str {
        &self.method.simulator
    }

    /// The name and the overrides.
    pub fn label(&self) -> String {
        let overrides = self.overrides.iter().map(|(key, value)| format!("{key}={value}"));
        std::iter::once(self.name()).chain(overrides).collect::<Vec<_>>().join(", ")
    }

    pub fn seeds(&self) -> Vec<u64> {
        self.runs.iter().map(|run| run.config.seed).collect()
    }

    /// The runs that tell the final return, and the step at which they do: the finished ones that went furthest, or,
    /// where none is finished, all that were evaluated, at the last step that all of these have reached.
    pub fn finals(&self) -> Option<(u64, Vec<&RunRecord>)> {
        let finished: Vec<&RunRecord> = self.runs.iter().filter(|run| run.status() == Status::Finished).collect();
        if let Some(furthest) = finished.iter().map(|run| last_step(run)).max() {
            return Some((furthest, finished.into_iter().filter(|run| last_step(run) == furthest).collect()));
        }
        let begun: Vec<&RunRecord> = self.runs.iter().filter(|run| run.status() != Status::Empty).collect();
        Some((begun.iter().map(|run| last_step(run)).min()?, begun))
    }

    fn order(&self) -> (usize, usize, String, Retraining, String) {
        let simulator = self.simulator();
        let kind = ["gs", "dials", "marginal-dials", "untrained-dials"].iter().position(|&kind| kind == simulator);
        let kind = kind.unwrap_or(usize::MAX);
        (self.overrides.len().min(1), kind, simulator.to_owned(), self.method.retraining, self.label())
    }
}

/// As the paper names a simulator, with F for DIALS.
pub fn method_name(simulator: &str, retraining: Retraining) -> String {
    match (simulator, retraining) {
        ("gs", _) => "GS".to_owned(),
        ("dials", Retraining::Every(steps)) => format!("DIALS F={}", steps_text(steps)),
        ("dials", Retraining::Once) => "DIALS once".to_owned(),
        ("dials", Retraining::Drift) => "DIALS on drift".to_owned(),
        (other, _) => other.replace("dials", "DIALS"),
    }
}

/// Of the last evaluation.
fn last_step(run: &RunRecord) -> u64 {
    run.evaluations.last().map_or(0, |evaluation| evaluation.steps)
}

/// `1M`, `500K`, `150K` for 150 016, `128`: periods are whole updates of the policies, so steps are seldom round.
pub fn steps_text(steps: u64) -> String {
    let rounded = |unit: f64, decimals: f64| (steps as f64 / unit * decimals).round() / decimals;
    match steps {
        0..1_000 => steps.to_string(),
        1_000..100_000 => format!("{}K", rounded(1e3, 10.0)),
        100_000..1_000_000 => format!("{}K", rounded(1e3, 1.0)),
        _ => format!("{}M", rounded(1e6, 100.0)),
    }
}

/// Runs sorted into comparisons.
pub struct Sorted {
    pub comparisons: Vec<Comparison>,
    pub left_out: Vec<LeftOut>,
}

/// Sorts runs by scenario, method and seed.
pub fn sort(found: Found) -> Result<Sorted> {
    let mut left_out = found.unreadable;
    type Methods = BTreeMap<Method, Vec<RunRecord>>;
    let mut scenarios: BTreeMap<Scenario, Methods> = BTreeMap::new();
    for run in found.runs {
        match run.agents() {
            Some(agents) => {
                let scenario = Scenario::of(&run.config, agents)?;
                scenarios.entry(scenario).or_default().entry(Method::of(&run.config)).or_default().push(run);
            }
            None => left_out.push(LeftOut { dir: run.dir, reason: "not evaluated yet".to_owned() }),
        }
    }
    let plain_names: Vec<String> = scenarios.keys().map(plain_slug).collect();
    let mut comparisons = Vec::new();
    for (scenario, methods) in scenarios {
        let plain = plain_slug(&scenario);
        let unique = plain_names.iter().filter(|&name| *name == plain).count() == 1;
        let told_apart = keys_that_differ(methods.keys().map(|method| &method.keys));
        let mut groups: Vec<Group> = methods
            .into_iter()
            .map(|(method, runs)| group(method, &told_apart, without_doubles(runs, &mut left_out)))
            .collect();
        groups.sort_by_key(Group::order);
        let baselines = found.baselines.iter().filter(|baseline| baseline.scenario == scenario.id()).cloned().collect();
        let slug = if unique { plain } else { scenario.id().replace('-', "_") };
        comparisons.push(Comparison { slug, scenario, groups, baselines });
    }
    Ok(Sorted { comparisons, left_out })
}

fn plain_slug(scenario: &Scenario) -> String {
    format!("{}_{}", scenario.domain.name(), scenario.agents)
}

/// Every key that has more than one value among the methods, with the value that more than half of them have, if any.
fn keys_that_differ<'a>(
    methods: impl Iterator<Item = &'a BTreeMap<String, String>> + Clone,
) -> BTreeMap<String, Option<String>> {
    let keys: BTreeSet<&String> = methods.clone().flat_map(BTreeMap::keys).collect();
    let mut differing = BTreeMap::new();
    for key in keys {
        let values: Vec<&String> = methods.clone().filter_map(|method| method.get(key)).collect();
        if values.iter().any(|value| *value != values[0]) {
            let common =
                values.iter().find(|value| 2 * values.iter().filter(|other| other == value).count() > values.len());
            differing.insert(key.clone(), common.map(|value| (*value).clone()));
        }
    }
    differing
}

fn group(method: Method, told_apart: &BTreeMap<String, Option<String>>, runs: Vec<RunRecord>) -> Group {
    let in_the_name = |key: &str| {
        let of_retraining = ["aip.retrain", "aip.retrain_every_steps"].contains(&key);
        key == "simulator" || (method.simulator == "dials" && of_retraining)
    };
    let overrides = method.keys.iter().filter(|(key, value)| {
        !in_the_name(key) && told_apart.get(*key).is_some_and(|common| common.as_ref() != Some(value))
    });
    let overrides = overrides.map(|(key, value)| (key.clone(), value.clone())).collect();
    Group { overrides, method, runs }
}

/// By seed; of several runs with one seed the one that went furthest stays.
fn without_doubles(mut runs: Vec<RunRecord>, left_out: &mut Vec<LeftOut>) -> Vec<RunRecord> {
    runs.sort_by_key(|run| (run.config.seed, std::cmp::Reverse(last_step(run))));
    let mut kept: Vec<RunRecord> = Vec::new();
    for run in runs {
        match kept.last() {
            Some(last) if last.config.seed == run.config.seed => {
                let reason = format!("has the config and the seed of {}", last.dir.display());
                left_out.push(LeftOut { dir: run.dir, reason });
            }
            _ => kept.push(run),
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn methods(values: &[&str]) -> Vec<BTreeMap<String, String>> {
        values.iter().map(|&value| BTreeMap::from([("ppo.clip".to_owned(), value.to_owned())])).collect()
    }

    #[test]
    fn the_value_of_most_groups_goes_without_saying() {
        let common = |values: &[&str]| keys_that_differ(methods(values).iter()).remove("ppo.clip");
        assert_eq!(common(&["0.1", "0.1"]), None, "nothing differs");
        assert_eq!(common(&["0.1", "0.2", "0.1"]), Some(Some("0.1".to_owned())));
        assert_eq!(common(&["0.1", "0.2"]), Some(None), "neither is the usual one");
    }

    #[test]
    fn steps_are_told_as_the_paper_does() {
        assert_eq!(
            [4_000_000, 500_000, 1_500_000, 150_016, 12_500, 4_000_128, 128, 0].map(steps_text),
            ["4M", "500K", "1.5M", "150K", "12.5K", "4M", "128", "0"]
        );
    }
}
