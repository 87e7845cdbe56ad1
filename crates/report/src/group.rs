//! Groups of runs that differ only in their seed, and comparisons of the groups of one scenario.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::Result;

use dials_core::domain::{Map, Rules, ScenarioId};
use dials_session::records::find::{BaselineRecord, Found, LeftOut};
use dials_session::records::method::{Method, Retraining, steps_text};
use dials_session::records::run_record::{RunRecord, Status};

/// All groups of one scenario, in the order of the report: GS, DIALS by F, other simulators, variants last.
pub(crate) struct Comparison {
    pub(crate) scenario: ScenarioId,
    /// What the user calls the scenario, if all runs that recorded a name have the same.
    pub(crate) name: Option<String>,
    /// Title of the scenario, unique among the comparisons of a report: `traffic, 4 agents`, or `town, 20 agents`.
    pub(crate) title: String,
    /// Name of the scenario in file names, unique among the comparisons of a report: `traffic_4`, or `town_20`.
    pub(crate) slug: String,
    pub(crate) groups: Vec<Group>,
    /// Index of the reference of an ablation: the one group that has the value of most groups in every key.
    pub(crate) reference: Option<usize>,
    pub(crate) baselines: Vec<BaselineRecord>,
}

impl Comparison {
    pub(crate) fn heading(&self) -> String {
        let mut letters = self.title.chars();
        letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
    }

    pub(crate) fn runs(&self) -> impl Iterator<Item = &RunRecord> {
        self.groups.iter().flat_map(|group| &group.runs)
    }

    pub(crate) fn map(&self) -> Option<Map> {
        self.runs().find_map(|run| run.scenario().map)
    }

    /// Returns the rules by which the agents see and are rewarded, if a run recorded them.
    pub(crate) fn rules(&self) -> Option<&Rules> {
        self.runs().find_map(|run| run.scenario().rules.as_ref())
    }

    /// Returns the number of agents, with whatever else distinguishes the scenario from others.
    pub(crate) fn size(&self) -> String {
        let size = self.scenario.agents.to_string();
        self.title.replacen(&self.scenario.title(self.name.as_deref()), &size, 1)
    }

    /// Returns a label for a picture: without tables of keys if the rest is unique, nor the method of the reference.
    pub(crate) fn short_label(&self, group: &Group) -> String {
        let keys: BTreeSet<&String> =
            self.groups.iter().flat_map(|group| &group.overrides).map(|(key, _)| key).collect();
        let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
        let short = |key: &String| match keys.iter().filter(|other| last(other) == last(key)).count() {
            1 => last(key),
            _ => key.clone(),
        };
        if group.overrides.len() > MOST_KEYS {
            return group.label();
        }
        let overrides = group.overrides.iter().map(|(key, value)| format!("{}={value}", short(key)));
        let of_reference = self.reference.is_some_and(|reference| self.groups[reference].name() == group.name());
        let differs = group.overrides.iter().any(|(key, value)| !is_always_named(key, value));
        let name = (!of_reference || !differs).then(|| group.name());
        name.into_iter().chain(overrides).collect::<Vec<_>>().join(", ")
    }
}

const MOST_KEYS: usize = 8;

/// Runs of one method with several seeds; never empty.
pub(crate) struct Group {
    pub(crate) method: Method,
    /// Config keys that differ from most groups of the scenario, or are always named, with the values of this group.
    pub(crate) overrides: Vec<(String, String)>,
    pub(crate) runs: Vec<RunRecord>,
}

impl Group {
    /// Returns the paper's name of the method: `DIALS F=1M`.
    pub(crate) fn name(&self) -> String {
        method_name(self.simulator(), self.method.retraining)
    }

    pub(crate) fn simulator(&self) -> &str {
        &self.method.simulator
    }

    /// Returns the name and the overrides, or a run's directory if there are too many overrides to read.
    pub(crate) fn label(&self) -> String {
        if self.overrides.len() > MOST_KEYS {
            return format!("{}, as {}", self.name(), self.runs[0].dir.display());
        }
        let overrides = self.overrides.iter().map(|(key, value)| format!("{key}={value}"));
        std::iter::once(self.name()).chain(overrides).collect::<Vec<_>>().join(", ")
    }

    pub(crate) fn seeds(&self) -> Vec<u64> {
        self.runs.iter().map(|run| run.config.learning.seed).collect()
    }

    /// Returns the step of the final return and the runs that count for it: the finished runs with the most steps. If
    /// no run is finished, all evaluated runs count, at the last step at which all of them were evaluated.
    pub(crate) fn finals(&self) -> Option<(u64, Vec<&RunRecord>)> {
        let finished: Vec<&RunRecord> = self.runs.iter().filter(|run| run.status() == Status::Finished).collect();
        if let Some(furthest) = finished.iter().map(|run| last_step(run)).max() {
            return Some((furthest, finished.into_iter().filter(|run| last_step(run) == furthest).collect()));
        }
        let begun: Vec<&RunRecord> = self.runs.iter().filter(|run| run.status() != Status::Empty).collect();
        Some((*evaluated_together(&begun).last()?, begun))
    }

    fn order(&self) -> (usize, usize, String, Retraining, String) {
        let simulator = self.simulator();
        let kind = ["gs", "dials", "marginal-dials", "untrained-dials"].iter().position(|&kind| kind == simulator);
        let kind = kind.unwrap_or(usize::MAX);
        (self.overrides.len(), kind, simulator.to_owned(), self.method.retraining, self.label())
    }
}

/// Returns the paper's name of a method: the simulator, with F if it has one.
pub(crate) fn method_name(simulator: &str, retraining: Retraining) -> String {
    let name = if simulator == "gs" { "GS".to_owned() } else { simulator.replace("dials", "DIALS") };
    match retraining {
        Retraining::Never => name,
        Retraining::Every(steps) => format!("{name} F={}", steps_text(steps)),
        Retraining::Once => format!("{name} once"),
        Retraining::Drift => format!("{name} on drift"),
    }
}

fn last_step(run: &RunRecord) -> u64 {
    run.evaluations.last().map_or(0, |evaluation| evaluation.steps)
}

pub(crate) fn evaluated_together(runs: &[&RunRecord]) -> BTreeSet<u64> {
    let steps = |run: &&RunRecord| run.evaluations.iter().map(|evaluation| evaluation.steps).collect::<BTreeSet<u64>>();
    runs.iter().map(steps).reduce(|all, own| &all & &own).unwrap_or_default()
}

pub(crate) struct Sorted {
    pub(crate) comparisons: Vec<Comparison>,
    /// Planned runs that have not begun.
    pub(crate) missing: Vec<PathBuf>,
    pub(crate) left_out: Vec<LeftOut>,
}

pub(crate) fn sort(found: Found) -> Result<Sorted> {
    let mut left_out = found.unreadable;
    type Methods = BTreeMap<Method, Vec<RunRecord>>;
    let mut scenarios: BTreeMap<ScenarioId, (Methods, BTreeSet<String>)> = BTreeMap::new();
    for run in found.runs {
        let scenario = run.scenario().clone();
        let method = Method::of(&run.config, &scenario);
        let (methods, names) = scenarios.entry(scenario.id).or_default();
        methods.entry(method).or_default().push(run);
        names.extend(scenario.name);
    }
    let only = |names: &BTreeSet<String>| names.first().filter(|_| names.len() == 1).cloned();
    let all: Vec<(ScenarioId, Option<String>)> =
        scenarios.iter().map(|(id, (_, names))| (id.clone(), only(names))).collect();
    let named = all.iter().map(|(id, name)| (id, name.as_deref()));
    let mut comparisons = Vec::new();
    for ((scenario, (methods, _)), (_, name)) in scenarios.into_iter().zip(&all) {
        let plain = plain_slug(&scenario, name.as_deref());
        let unique = named.clone().filter(|&(other, name)| plain_slug(other, name) == plain).count() == 1;
        let distinguishing = keys_that_differ(&methods.keys().collect::<Vec<_>>());
        let mut groups: Vec<Group> = methods
            .into_iter()
            .map(|(method, runs)| group(method, &distinguishing, without_doubles(runs, &mut left_out)))
            .collect();
        groups.sort_by_key(Group::order);
        let reference = reference(&groups, &distinguishing);
        let baselines = found.baselines.iter().map(|(_, baseline)| baseline);
        let baselines = baselines.filter(|baseline| baseline.scenario == scenario.word()).cloned().collect();
        let title = scenario.title_among(name.as_deref(), named.clone());
        let slug = if unique { plain } else { scenario.word().replace('-', "_") };
        comparisons.push(Comparison { name: name.clone(), title, slug, scenario, groups, reference, baselines });
    }
    for (path, baseline) in found.baselines {
        if all.iter().all(|(scenario, _)| scenario.word() != baseline.scenario) {
            let reason = format!("was measured on {}, but there is no run of it", baseline.scenario);
            left_out.push(LeftOut { dir: path, reason });
        }
    }
    Ok(Sorted { comparisons, missing: found.missing, left_out })
}

fn plain_slug(scenario: &ScenarioId, name: Option<&str>) -> String {
    format!("{}_{}", name.unwrap_or(&scenario.domain), scenario.agents)
}

/// Returns the keys that distinguish these methods, each with the value that goes without saying, if there is one.
///
/// That value is "off" if some methods leave the key out and so turn it off. Otherwise it is the value of more than half
/// of the methods. If there is none, it is "off" for a key that labels name only when it is on.
fn keys_that_differ(methods: &[&Method]) -> BTreeMap<String, Option<String>> {
    let keys: BTreeSet<&String> = methods.iter().flat_map(|method| method.keys.keys()).collect();
    let mut differing = BTreeMap::new();
    for key in keys {
        let values: Vec<&String> = methods.iter().filter_map(|method| method.keys.get(key)).collect();
        let left_out = |method: &&Method| {
            let mut others = methods.iter().filter(|other| other.simulator == method.simulator);
            others.any(|other| other.keys.contains_key(key)) && method.has_off(key)
        };
        if methods.iter().any(left_out) {
            differing.insert(key.clone(), Some(OFF.to_owned()));
        } else if values.iter().any(|value| *value != values[0]) {
            let of_most =
                values.iter().find(|value| 2 * values.iter().filter(|other| other == value).count() > values.len());
            let off = || values.iter().find(|value| ALWAYS_NAMED.contains(&key.as_str()) && is_off(value));
            differing.insert(key.clone(), of_most.or_else(off).map(|value| (*value).clone()));
        }
    }
    differing
}

/// Returns the one group that has the common value of every differing key, if there are others, but none like it.
fn reference(groups: &[Group], distinguishing: &BTreeMap<String, Option<String>>) -> Option<usize> {
    let usual = |group: &Group| {
        let mut keys = distinguishing.iter();
        keys.all(|(key, common)| {
            common.is_some() && group.method.keys.get(key).is_none_or(|own| common.as_ref() == Some(own))
        })
    };
    let mut usual = (0..groups.len()).filter(|&index| usual(&groups[index]));
    let found = usual.next()?;
    (groups.len() > 1 && usual.next().is_none()).then_some(found)
}

/// Keys that a label names even if all groups have them, unless they are off. With one of them a method is another one.
const ALWAYS_NAMED: [&str; 6] = [
    "policy.imitate",
    "policy.average_every_steps",
    "traffic.clock",
    "traffic.clock_offsets",
    "traffic.until_first_switch",
    "policy.share",
];

/// How a key is written when it is off.
const OFF: &str = "false";

fn is_off(value: &str) -> bool {
    [OFF, "none"].contains(&value)
}

/// The same for one value of a key. Its others are the default of our configs and that of the paper's.
const ALWAYS_NAMED_VALUE: (&str, &str) = ("traffic.d_set", "cells+light");

fn is_always_named(key: &str, value: &str) -> bool {
    ALWAYS_NAMED.contains(&key) && !is_off(value) || (key, value) == ALWAYS_NAMED_VALUE
}

fn group(method: Method, distinguishing: &BTreeMap<String, Option<String>>, runs: Vec<RunRecord>) -> Group {
    let in_the_name = |key: &str| {
        let of_retraining = ["aip.retrain", "aip.retrain_every_steps"].contains(&key);
        key == "simulator" || (method.retraining != Retraining::Never && of_retraining)
    };
    let overrides = method.keys.iter().filter(|(key, value)| {
        let differs = || distinguishing.get(*key).is_some_and(|common| common.as_ref() != Some(value));
        !in_the_name(key) && (is_always_named(key, value) || differs())
    });
    let mut overrides: Vec<(String, String)> = overrides.map(|(key, value)| (key.clone(), value.clone())).collect();
    // These leave the policies as they are.
    overrides.sort_by_key(|(key, _)| key.starts_with("evaluation."));
    Group { overrides, method, runs }
}

/// Sorts runs by seed. Of several runs with the same seed, only the one with the most steps stays. Of equal ones it is
/// one that measured its AIPs on new episodes, if there is one.
fn without_doubles(mut runs: Vec<RunRecord>, left_out: &mut Vec<LeftOut>) -> Vec<RunRecord> {
    runs.sort_by_key(|run| (run.config.learning.seed, std::cmp::Reverse(last_step(run)), run.fresh_losses.is_empty()));
    let mut kept: Vec<RunRecord> = Vec::new();
    for run in runs {
        match kept.last() {
            Some(last) if last.config.learning.seed == run.config.learning.seed => {
                let reason = format!("is the same training as {}", last.dir.display());
                left_out.push(LeftOut { dir: run.dir, reason });
            }
            _ => kept.push(run),
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::fixtures::run;
    use dials_core::domain::Scenario;
    use dials_session::records::run_record::FreshLossRecord;

    /// Makes groups of the warehouse: our defaults, with one of these settings each.
    fn ablation(settings: &[&str]) -> Comparison {
        let runs = settings.iter().enumerate();
        let runs = runs.map(|(index, setting)| RunRecord { dir: format!("runs/{index}").into(), ..run(setting) });
        sort(Found { runs: runs.collect(), ..Found::default() }).unwrap().comparisons.remove(0)
    }

    #[test]
    fn scenarios_are_called_as_their_runs_call_them() {
        let run = |index: usize, (name, checksum): (Option<&str>, u32)| {
            let scenario = Scenario::new("traffic", 4, 100).with_checksum(checksum);
            let scenario = name.map_or(scenario.clone(), |name| scenario.with_name(name));
            RunRecord::empty(run(&format!("seed = {index}")).config, scenario)
        };
        let called = |runs: &[(Option<&str>, u32)]| {
            let runs = runs.iter().enumerate().map(|(index, &of)| run(index, of)).collect();
            let comparisons = sort(Found { runs, ..Found::default() }).unwrap().comparisons;
            let words =
                comparisons.into_iter().map(|comparison| [comparison.size(), comparison.title, comparison.slug]);
            words.collect::<Vec<_>>()
        };
        let town = ["4", "town, 4 agents", "town_4"];
        let plain = ["4", "traffic, 4 agents", "traffic_4"];
        assert_eq!(called(&[(Some("town"), 1), (Some("town"), 1)]), [town]);
        assert_eq!(called(&[(Some("town"), 1), (None, 1)]), [town], "copies may lose the name");
        assert_eq!(called(&[(Some("town"), 1), (Some("city"), 1)]), [plain], "one scenario, two names");
        assert_eq!(called(&[(Some("town"), 1), (None, 2)]), [town, plain]);
        let twice = called(&[(Some("town"), 1), (Some("town"), 2)]);
        let titles = ["town, 4 agents, checksum 00000001", "town, 4 agents, checksum 00000002"];
        assert_eq!([&twice[0][1], &twice[1][1]], titles);
        assert_ne!(twice[0][2], twice[1][2], "files of one name would overwrite each other");
    }

    #[test]
    fn an_ablation_has_a_reference_from_which_each_row_departs_in_few_words() {
        let ours = ["", "ppo.epochs = 1", "aip.epochs = 1", "local_simulators.copies = 2", "aip.retrain = 'once'"];
        let comparison = ablation(&ours);
        let reference = &comparison.groups[comparison.reference.unwrap()];
        assert_eq!(reference.label(), "DIALS F=1M");
        assert_eq!(short_labels(&comparison), ["DIALS F=1M", "DIALS once", "aip.epochs=1", "copies=2", "ppo.epochs=1"]);
        assert_eq!(ablation(&["", "ppo.clip = 0.2"]).reference, None, "neither is the usual one");
        assert_eq!(ablation(&["", "simulator = 'gs'", "predictor = 'untrained'"]).reference, None);
        assert_eq!(ablation(&[""]).reference, None, "there is nothing to compare it with");
    }

    #[test]
    fn of_two_equal_runs_the_one_that_measured_its_aips_stays() {
        let run = |name: &str, fresh_losses| RunRecord { dir: name.into(), fresh_losses, ..run("") };
        let loss = FreshLossRecord { steps: 0, after_training: false, loss: 0.1, marginals: 0.2 };
        let mut left_out = Vec::new();
        let kept = without_doubles(vec![run("a", Vec::new()), run("b", vec![loss])], &mut left_out);
        assert_eq!((kept.len(), kept[0].dir.as_path()), (1, Path::new("b")));
        assert_eq!(left_out[0].reason, "is the same training as b");
    }

    fn short_labels(comparison: &Comparison) -> Vec<String> {
        comparison.groups.iter().map(|group| comparison.short_label(group)).collect()
    }

    #[test]
    fn what_makes_another_method_is_named_even_if_all_groups_have_it() {
        let (gs, copy) = ("simulator = 'gs'", "policy.imitate = 'oldest-item'");
        let shared = "simulator = 'gs'\npolicy.share = 'kind'";
        let mean = "simulator = 'gs'\npolicy.average_every_steps = 10_000";
        for (settings, expected) in [
            (&[copy][..], &["DIALS F=1M, policy.imitate=oldest-item"][..]),
            (&[shared], &["GS, policy.share=kind"]),
            (&[gs], &["GS"]),
            (&[mean], &["GS, policy.average_every_steps=10000"]),
            (&[gs, shared], &["GS", "GS, policy.share=kind"]),
            (&[mean, gs], &["GS", "GS, policy.average_every_steps=10000"]),
            // A key that is off if it is not set distinguishes groups.
            (&["aip.patience = 3", ""], &["DIALS F=1M", "DIALS F=1M, aip.patience=3"]),
            (
                &["policy.recurrent = 8", "", gs, "policy.recurrent = 16"],
                &["GS", "DIALS F=1M", "DIALS F=1M, policy.recurrent=16", "DIALS F=1M, policy.recurrent=8"],
            ),
        ] {
            let labels: Vec<String> = ablation(settings).groups.iter().map(Group::label).collect();
            assert_eq!(labels, expected);
        }
        assert_eq!(ablation(&["aip.patience = 3", ""]).reference, Some(0), "most groups leave it out");
        let other = format!("{copy}\nevaluation.episodes = 3\nppo.gamma = 0.9");
        let comparison = ablation(&[copy, &format!("{copy}\nppo.clip = 0.2"), &other]);
        let short = ["DIALS F=1M, imitate=oldest-item", "imitate=oldest-item, clip=0.2"];
        assert_eq!(short_labels(&comparison), [&short[..], &["imitate=oldest-item, gamma=0.9, episodes=3"]].concat());
        let named = |value: &str| is_always_named("traffic.d_set", value);
        assert_eq!(["cells+light", "cells+arrivals", "cells"].map(named), [true, false, false]);
    }

    #[test]
    fn groups_that_differ_in_too_many_keys_to_read_are_named_by_a_run() {
        let many = "ppo = { clip = 0.2, epochs = 1, gamma = 0.9, memory = 64, minibatch = 16, entropy = 0.1, rollout_steps = 8 }
                    aip = { epochs = 1, batch = 8 }";
        let comparison = ablation(&["", "ppo.value_coefficient = 0.5", many]);
        let labels = short_labels(&comparison);
        assert_eq!(labels, ["DIALS F=1M", "value_coefficient=0.5", "DIALS F=1M, as runs/2"]);
        assert_eq!(comparison.groups[2].label(), labels[2]);
    }
}
