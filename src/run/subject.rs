//! The players of `evaluate` and `baseline`: hand-coded controllers by name, and the policies of run directories.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};
use serde_json::json;

use super::plan::PLAN;
use dials_core::base::AgentId;
use dials_core::domain::{Baseline, Domain};
use dials_core::outside::{did_you_mean, excerpt, path_as_text};
use dials_learn::evaluation::Player;
use dials_learn::policy::Selection;
use dials_session::directory::{self, TrainedRun};
use dials_session::records::files;
use dials_session::records::run_json::RunJson;
use dials_session::terminal::warn;
use dials_traffic::controllers::check_name;
use dials_traffic::controllers::plan_file::{controller_of, is_plan, plan_of};

/// Largest number of agents that an error names, from the first one on.
const MOST_NAMES: usize = 8;

/// A controller or a run, as the command line names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Subject {
    Controller(String),
    Run { dir: PathBuf, greedy: bool, background: Option<Background> },
}

/// A hand-coded controller for all agents except those that use their policies.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Background {
    pub controller: String,
    pub policies_of: Vec<AgentId>,
}

impl Background {
    fn words(&self) -> String {
        let agents: Vec<String> = self.policies_of.iter().map(|agent| agent.0.to_string()).collect();
        format!("agents {}; others {}", agents.join(","), self.controller)
    }

    fn hand_coded(&self, domain: &dyn Domain) -> Vec<AgentId> {
        let agents = AgentId::all(domain.agents()).into_iter();
        agents.filter(|agent| !self.policies_of.contains(agent)).collect()
    }
}

/// Returns the words of a list of subjects. `key=value` belongs to the name before it.
fn words(text: &str) -> Result<Vec<String>> {
    let mut words: Vec<String> = Vec::new();
    for word in text.split(',') {
        let is_key = |key: &str| key.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '-');
        let goes_on = word.split_once('=').is_some_and(|(key, _)| is_key(key));
        match words.last_mut() {
            Some(before) if goes_on && before.contains(':') => *before = format!("{before},{word}"),
            _ => words.push(word.to_owned()),
        }
    }
    ensure!(words.iter().all(|word| !word.is_empty()), "--compare `{text}`: a name is empty");
    Ok(words)
}

impl Subject {
    /// Reads a list of subjects, separated by commas.
    ///
    /// A word with a `/` in its name is a run. So is a directory, unless a controller of `domain` has the same name. A directory with a
    /// plan is the controller that plays it.
    /// The parameters of a controller are separated by commas, too: `key=value` belongs to the name before it.
    pub(super) fn list(text: &str, greedy: bool, domain: &dyn Domain) -> Result<Vec<Subject>> {
        let words = words(text)?;
        let is_run = |word: &str| {
            let is_path = word.split(':').next().is_some_and(|name| name.contains('/'));
            is_path || Path::new(word).is_dir() && domain.check_baseline(word).is_err()
        };
        let subject = |word: String| match is_run(&word) {
            true if is_plan(Path::new(&word)) => controller_of(Path::new(&word)).map(Subject::Controller),
            true => Ok(Subject::Run { dir: word.into(), greedy, background: None }),
            false => Ok(Subject::Controller(word)),
        };
        words.into_iter().map(subject).collect()
    }

    /// Checks the names in a list for a scenario before anything of it is read, which may take long: each is that of a
    /// controller or of a directory.
    pub(super) fn check_names(text: &str) -> Result<()> {
        for word in words(text)? {
            let is_there = Path::new(&word).is_dir();
            let is_path = word.split(':').next().is_some_and(|name| name.contains('/'));
            ensure!(is_there || !is_path, "{word}: no such run directory; correct the path");
            if !is_there {
                check_name(&word)?;
            }
        }
        Ok(())
    }

    pub(super) fn label(&self) -> String {
        match self {
            Subject::Controller(name) => name.clone(),
            Subject::Run { dir, greedy, background } => {
                let background = background.as_ref().map(Background::words);
                let how: Vec<String> = greedy.then(|| "greedy".to_owned()).into_iter().chain(background).collect();
                let dir = dir.display();
                if how.is_empty() { dir.to_string() } else { format!("{dir} ({})", how.join("; ")) }
            }
        }
    }

    /// Returns the subject as findings describe it. `domain`: where it plays.
    pub(super) fn player(&self, domain: &dyn Domain) -> Result<Player> {
        let (policies, others, keys) = match self {
            Subject::Controller(name) => {
                let file = controller_file(domain, name)?.map(|checksum| ("controller_file_crc32", json!(checksum)));
                let plan = plan_of(name).map(|dir| (PLAN, json!(dir)));
                (None, None, [("controller", json!(name))].into_iter().chain(file).chain(plan).collect())
            }
            Subject::Run { dir, greedy, background } => {
                let mut keys = vec![("run", json!(path_as_text(dir))), ("greedy", json!(greedy))];
                if let Some(Background { controller, policies_of }) = background {
                    let agents: Vec<usize> = policies_of.iter().map(|agent| agent.0).collect();
                    keys.extend([("background", json!(controller)), ("policies_of", json!(agents))]);
                }
                (Some(selection(*greedy)), background.as_ref().map(Background::words), keys)
            }
        };
        Ok(Player { label: self.label(), keys, policies, others })
    }

    /// Checks what needs neither a trial of the files nor those of a run: the names of controllers, with their parameters.
    pub(super) fn check_controller(&self, domain: &dyn Domain) -> Result<()> {
        match self {
            Subject::Controller(_) => self.check(domain),
            Subject::Run { background: Some(background), .. } => domain.check_baseline(&background.controller),
            Subject::Run { background: None, .. } => Ok(()),
        }
    }

    /// Checks that the subject can be played on the global simulator (GS) of `domain`.
    pub(super) fn check(&self, domain: &dyn Domain) -> Result<()> {
        match self {
            Subject::Controller(name) => domain.check_baseline(name).map_err(|unknown| {
                if !Path::new(name).join(files::CONFIG).is_file() {
                    return unknown;
                }
                anyhow!("{name}: is a run directory, not a controller; use `evaluate`, `replay` or --compare")
            }),
            Subject::Run { dir, background, .. } => {
                if let Some(Background { controller, .. }) = background {
                    domain.check_baseline(controller)?;
                }
                fitting(dir, domain)?;
                check_rules(dir, domain)?;
                warn_of_other_sumo(dir)
            }
        }
    }

    /// Says what somebody should know who plays the subject here.
    pub(super) fn warn(&self, domain: &dyn Domain) -> Result<()> {
        let names = match self {
            Subject::Controller(name) => Some(name),
            Subject::Run { background, .. } => background.as_ref().map(|background| &background.controller),
        };
        let warnings = names.map_or(Ok(Vec::new()), |name| domain.baseline_warnings(name))?;
        warnings.iter().for_each(|warning| warn(format_args!("warning: {warning}")));
        Ok(())
    }

    /// Opens the subject and the GS of `domain`. A process can hold only one SUMO simulation at a time.
    pub(super) fn open(&self, domain: &dyn Domain) -> Result<Baseline> {
        match self {
            Subject::Controller(name) => domain.baseline(name),
            Subject::Run { dir, greedy, background } => {
                let run = fitting(dir, domain)?;
                run.note_still_trained(dir);
                let controller = Box::new(run.controller(selection(*greedy)));
                let simulator = match background {
                    None => domain.global_simulator()?,
                    Some(background) => {
                        domain.with_background(&background.controller, &background.hand_coded(domain))?
                    }
                };
                Ok(Baseline { simulator, controller })
            }
        }
    }
}

pub(super) fn selection(greedy: bool) -> Selection {
    if greedy { Selection::Greedy } else { Selection::Sampled }
}

/// Warns if the run was trained by other rules than those of `domain`; other observations are an error.
fn check_rules(dir: &Path, domain: &dyn Domain) -> Result<()> {
    let recorded = RunJson::read(dir)?.scenario.rules;
    let (Some(theirs), Some(ours)) = (recorded, domain.scenario()?.rules) else { return Ok(()) };
    let path = dir.display();
    ensure!(
        theirs.observation == ours.observation,
        "{path}: its policies know other observations ({}) than those here ({}); use a config like the run's",
        theirs.observation,
        ours.observation
    );
    let differences = theirs.differences(&ours, ["its training", "this command"]);
    if !differences.is_empty() {
        warn(format_args!(
            "warning: {path}: learned by other rules than those of this command\n  {}\n  \
             all returns below are by the rules of this command; compare another figure, too",
            differences.join("\n  ")
        ));
    }
    Ok(())
}

/// Warns if the run was trained with another SUMO than the one here.
fn warn_of_other_sumo(dir: &Path) -> Result<()> {
    let run = RunJson::read(dir)?;
    let theirs = run.sumo();
    if theirs.is_empty() {
        return Ok(());
    }
    let ours = &dials_traffic::sumo()?.name;
    if theirs.iter().any(|theirs| theirs != ours) {
        let theirs = theirs.into_iter().collect::<Vec<_>>().join(" and ");
        let path = dir.display();
        warn(format_args!(
            "warning: {path}: was trained with {theirs}, and is evaluated with {ours}, which may have other numbers"
        ));
    }
    Ok(())
}

/// Returns the CRC-32 of the file that a hand-coded controller reads, in hexadecimal. If it reads none: `None`.
pub(super) fn controller_file(domain: &dyn Domain, name: &str) -> Result<Option<String>> {
    Ok(domain.baseline_checksum(name)?.map(|checksum| format!("{checksum:08x}")))
}

/// Finds the agent that `option` names, by its number or its name.
pub(super) fn agent_called(domain: &dyn Domain, word: &str, option: &str) -> Result<AgentId> {
    let last = domain.agents() - 1;
    domain.agent_called(word).with_context(|| {
        let names: Vec<String> =
            AgentId::all(domain.agents()).into_iter().map(|agent| domain.agent_name(agent)).collect();
        let (near, shown) = match names.len() {
            ..=MOST_NAMES => (String::new(), names.join(", ")),
            _ => (
                did_you_mean(word, names.iter().map(String::as_str)),
                format!("{}, ... {}; `describe CONFIG --json` has all", names[..MOST_NAMES].join(", "), names[last]),
            ),
        };
        let word = excerpt(word);
        format!("{option}: there is no agent `{word}`{near}; the agents are 0 to {last}, by name {shown}")
    })
}

/// Reads the run in `dir`. If its policies do not fit the agents of `domain`, this is an error.
fn fitting(dir: &Path, domain: &dyn Domain) -> Result<TrainedRun> {
    let run = directory::open(dir)?;
    let shapes = |domain: &dyn Domain| -> Vec<(usize, usize)> {
        domain.kinds().specs().map(|spec| (spec.obs_dim, spec.n_actions)).collect()
    };
    let (theirs, ours) = (shapes(&*run.domain), shapes(domain));
    let (path, count, here) = (dir.display(), theirs.len(), ours.len());
    ensure!(
        count == here,
        "{path}: has policies for {count} agents, but this config has {here}; use one like the run's"
    );
    for (agent, (theirs, ours)) in theirs.into_iter().zip(ours).enumerate() {
        let ((inputs, actions), (ours_in, ours_out)) = (theirs, ours);
        ensure!(
            theirs == ours,
            "{path}: agent {agent} has {inputs} inputs and {actions} actions, but {ours_in} and {ours_out} in this \
             config; use one like the run's"
        );
    }
    Ok(run)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_testkit::toy::Coins;

    fn list(text: &str) -> Result<Vec<Subject>> {
        Subject::list(text, false, &Coins::new(1))
    }

    #[test]
    fn parameters_belong_to_the_controller_before_them() {
        for (text, labels) in [
            (
                "fixed-time:green=10,offsets=checkerboard,gap-out,max-pressure:min-green=5",
                &["fixed-time:green=10,offsets=checkerboard", "gap-out", "max-pressure:min-green=5"][..],
            ),
            ("random", &["random"]),
            // There is no colon after gap-out, so it has no parameters.
            ("gap-out,green=10", &["gap-out", "green=10"]),
        ] {
            let found: Vec<String> = list(text).unwrap().iter().map(Subject::label).collect();
            assert_eq!(found, labels);
        }
    }

    #[test]
    fn what_looks_like_a_path_is_a_run() {
        // The tests run where src is a directory.
        let found = list("actuated,runs/a=1,fixed-time:file=tuned/a.toml,src").unwrap();
        let runs: Vec<bool> = found.iter().map(|subject| matches!(subject, Subject::Run { .. })).collect();
        assert_eq!(runs, [false, true, false, true]);
    }

    #[test]
    fn a_label_says_how_policies_are_played() {
        let others = || Some(Background { controller: "gap-out".into(), policies_of: vec![AgentId(0), AgentId(3)] });
        for (greedy, background, label) in [
            (false, others(), "runs/a (agents 0,3; others gap-out)"),
            (true, others(), "runs/a (greedy; agents 0,3; others gap-out)"),
        ] {
            assert_eq!(Subject::Run { dir: "runs/a".into(), greedy, background }.label(), label);
        }
    }
}
