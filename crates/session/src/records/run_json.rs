//! `run.json`: how a run was called, and what it was computed with.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::files;
use super::kept::Kept;
use super::word::Word;
use dials_core::domain::Scenario;
use dials_core::outside::{Directory, excerpt, is_printable, read_text};

/// Largest file. A command line has at most two mebibytes on Linux, and escapes may double it.
const LARGEST_FILE: u64 = 8 << 20;
/// Longest word of a scenario in bytes. Files and headings of a report are named after them.
const LONGEST_WORD: usize = 50;
/// Largest number of agents.
const MOST_AGENTS: usize = 1_000_000;

/// Contents of `run.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunJson {
    /// Words of the command line; the first is the name of the program.
    pub command: Vec<Word>,
    /// Other builds with which the run was continued, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub resumed_with: Vec<Resumed>,
    /// What the run simulates.
    pub scenario: Scenario,
    /// Names of the agents, in order; empty if the domain gives them none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub agents: Vec<String>,
    pub seed: u64,
    /// Keys and files of the domain when the run began; empty if the domain comes from no config.
    #[serde(default, skip_serializing_if = "Kept::is_empty")]
    pub kept: Kept,
    /// Number of workers that was last asked for. A resume uses it again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub workers: Option<usize>,
    /// Build that the run was begun with.
    pub versions: Versions,
}

/// A build with which a run was continued.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Resumed {
    /// Timesteps per agent at which it took over.
    pub(crate) steps: u64,
    pub(crate) versions: Versions,
}

/// This program, its libraries and the machine. A field that was not recorded is empty.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Versions {
    /// Name of the CPU, for information only.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub cpu: String,
    /// Version of this program.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub dials_traffic: String,
    /// Commit of the checkout that the program was built from, with `-dirty` if its sources had been changed.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub git_commit: String,
    /// Library of `exp`, `ln` and so on.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub libm: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    pub libtorch: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    pub sumo: String,
    /// Instructions that multiply matrices.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub vector_instructions: String,
}

impl RunJson {
    /// Describes a run of a domain that comes from no config.
    pub fn new(scenario: Scenario, agents: Vec<String>, seed: u64) -> RunJson {
        RunJson {
            command: Vec::new(),
            resumed_with: Vec::new(),
            scenario,
            agents,
            seed,
            kept: Kept::default(),
            workers: None,
            versions: Versions::default(),
        }
    }

    /// Reads the file of the run in `dir`; an error if there is none.
    pub fn read(dir: &Path) -> Result<RunJson> {
        let path = dir.join(files::RUN);
        let text = read_text(&path, LARGEST_FILE).with_context(|| format!("{}: cannot be read", path.display()))?;
        let failed = || format!("{}: is not a file that this program wrote", path.display());
        let run: RunJson = serde_json::from_str(&text).with_context(failed)?;
        check(&run.scenario).with_context(failed)?;
        Ok(run)
    }

    pub fn write(&self, directory: &Directory) -> Result<()> {
        let text = serde_json::to_string_pretty(self).context("run.json in memory")?;
        directory.write(files::RUN, format!("{text}\n").as_bytes())
    }

    /// Returns the name of an agent for a reader: printable and short; its number if it has none.
    pub fn agent_name(&self, agent: usize) -> String {
        self.agents.get(agent).map_or_else(|| agent.to_string(), |name| excerpt(name))
    }

    /// Returns the build that wrote the run last.
    pub(crate) fn last_versions(&self) -> &Versions {
        self.resumed_with.last().map_or(&self.versions, |resumed| &resumed.versions)
    }
}

/// Checks the words of a scenario. Reports name files after them.
fn check(scenario: &Scenario) -> Result<()> {
    let id = &scenario.id;
    let plain = |word: &str| {
        (1..=LONGEST_WORD).contains(&word.len())
            && word.starts_with(|first: char| first.is_ascii_alphanumeric())
            && word.bytes().all(|letter| letter.is_ascii_alphanumeric() || b"-_".contains(&letter))
    };
    let message =
        |what, word| format!("scenario: {what} is `{}`, which is not a word of letters and digits", excerpt(word));
    ensure!(plain(&id.domain), message("domain", &id.domain));
    if let Some(name) = &scenario.name {
        ensure!(plain(name), message("name", name));
    }
    if let Some(checksum) = &id.checksum {
        ensure!(plain(checksum), message("checksum", checksum));
    }
    if let Some(rules) = &id.rules {
        ensure!(plain(rules), message("scored_by", rules));
    }
    let unit = &id.episode.unit;
    ensure!(unit.len() <= LONGEST_WORD && unit.chars().all(is_printable), message("unit", unit));
    ensure!(
        (1..=MOST_AGENTS).contains(&id.agents),
        "scenario: agents is {}, which is not a number from 1 to {MOST_AGENTS}",
        id.agents
    );
    Ok(())
}

impl Versions {
    /// Lists the differences between the build that wrote a run and this one, a line each. Only what can change numbers
    /// counts.
    pub fn differences(&self, there: &Versions) -> Vec<String> {
        let differing = self.decisive().into_iter().zip(there.decisive());
        let differing = differing.filter(|((_, here), (_, there))| here != there);
        let text = |version: &str| if version.is_empty() { "not recorded".to_owned() } else { version.to_owned() };
        differing
            .map(|((name, here), (_, there))| format!("{name}: {} there, {} here", text(there), text(here)))
            .collect()
    }

    /// Returns the versions that can change numbers, with their names for people.
    fn decisive(&self) -> [(&'static str, &str); 4] {
        [
            ("commit", &self.git_commit),
            ("SUMO", &self.sumo),
            ("libm", &self.libm),
            ("vector instructions", &self.vector_instructions),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::fs;

    fn run(agents: Vec<String>) -> RunJson {
        RunJson::new(Scenario::new("ants", 3, 5), agents, 7)
    }

    fn versions() -> Versions {
        Versions {
            dials_traffic: "1.0.0".into(),
            git_commit: "abc-dirty".into(),
            sumo: "SUMO 1.15.0".into(),
            libtorch: "1.13.1".into(),
            libm: "glibc 2.36".into(),
            vector_instructions: "avx512f".into(),
            cpu: "A".into(),
        }
    }

    #[test]
    fn the_same_build_on_another_cpu_of_the_same_kind_is_no_other() {
        let there = Versions { cpu: "B".into(), ..versions() };
        assert_eq!(versions().differences(&there), [""; 0]);
    }

    #[test]
    fn every_decisive_difference_is_named_with_both_values() {
        let there = Versions { git_commit: "abc".into(), vector_instructions: "avx2+fma".into(), ..versions() };
        let expected = ["commit: abc there, abc-dirty here", "vector instructions: avx2+fma there, avx512f here"];
        assert_eq!(versions().differences(&there), expected);
        let old = serde_json::from_value(json!({ "git_commit": "abc-dirty", "sumo": "SUMO 1.14.0" })).unwrap();
        let expected = [
            "SUMO: SUMO 1.14.0 there, SUMO 1.15.0 here",
            "libm: not recorded there, glibc 2.36 here",
            "vector instructions: not recorded there, avx512f here",
        ];
        assert_eq!(versions().differences(&old), expected);
    }

    #[test]
    fn a_file_comes_back_as_it_was_written_with_the_build_that_wrote_last() {
        let dir = tempfile::tempdir().unwrap();
        let mut run = RunJson { versions: versions(), ..run(Vec::new()) };
        assert_eq!(run.last_versions(), &versions());
        let other = Versions { libm: "glibc 2.31".into(), ..versions() };
        run.resumed_with.push(Resumed { steps: 512, versions: other.clone() });
        run.write(&Directory::open(dir.path()).unwrap()).unwrap();
        let again = RunJson::read(dir.path()).unwrap();
        assert_eq!((&again, again.last_versions()), (&run, &other));
    }

    #[test]
    fn agents_have_the_names_that_were_recorded_or_their_numbers() {
        let run = run(vec!["r0c0".to_owned(), "a\u{1b}b".to_owned()]);
        assert_eq!([0, 1, 2].map(|agent| run.agent_name(agent)), ["r0c0", "a\\u{1b}b", "2"]);
    }

    #[test]
    fn a_file_that_is_missing_or_of_another_program_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        assert!(RunJson::read(dir.path()).unwrap_err().to_string().contains("run.json: cannot be read"));
        fs::write(dir.path().join(files::RUN), "[1]").unwrap();
        let error = RunJson::read(dir.path()).unwrap_err().to_string();
        assert!(error.contains("run.json: is not a file that this program wrote"), "{error}");
    }

    #[test]
    fn a_scenario_has_plain_words_because_files_are_named_after_them() {
        let dir = tempfile::tempdir().unwrap();
        let read = |domain: &str, agents: u64, unit: &str, checksum: &str| {
            let episode = json!({ "length": 5, "unit": unit });
            let mut about = serde_json::to_value(run(Vec::new())).unwrap();
            about["scenario"] = json!({ "domain": domain, "agents": agents, "episode": episode, "checksum": checksum });
            fs::write(dir.path().join(files::RUN), about.to_string()).unwrap();
            RunJson::read(dir.path()).map_err(|error| format!("{error:#}"))
        };
        read("traffic", 4, "steps", "1a2b3c4d").unwrap();
        let long = "a".repeat(51);
        for bad in ["", "../x", "/x", "-x", "a b", "ü", "a\u{1b}b", "a\nb", "a](b)", &long] {
            assert!(read(bad, 4, "steps", "1").unwrap_err().contains("scenario: domain is `"), "{bad:?}");
            assert!(read("ants", 4, "steps", bad).unwrap_err().contains("scenario: checksum is `"), "{bad:?}");
        }
        for bad in ["../x", "a b", &long] {
            let scenario = Scenario { name: Some(bad.to_owned()), ..Scenario::new("ants", 4, 5) };
            RunJson { scenario, ..run(Vec::new()) }.write(&Directory::open(dir.path()).unwrap()).unwrap();
            let error = format!("{:#}", RunJson::read(dir.path()).unwrap_err());
            assert!(error.contains("scenario: name is `"), "{error}");
        }
        assert!(read("ants", 4, "st\u{202e}eps", "1").unwrap_err().contains("scenario: unit is `st\\u{202e}eps`"));
        for agents in [0, 1_000_001, u64::MAX] {
            assert!(read("ants", agents, "steps", "1").unwrap_err().contains("scenario: agents is"), "{agents}");
        }
    }

    #[test]
    fn what_is_no_file_of_ours_is_refused_however_large_or_deep_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(files::RUN);
        let message = || format!("{:#}", RunJson::read(dir.path()).unwrap_err());
        fs::write(&path, format!("{{\"x\":{}", "[".repeat(1 << 20))).unwrap();
        assert!(message().contains("is not a file that this program wrote: EOF while parsing"), "{}", message());
        fs::File::create(&path).unwrap().set_len(LARGEST_FILE + 1).unwrap();
        assert!(message().contains("it has more than 8388608 bytes, the limit"), "{}", message());
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert!(message().contains("it is not a regular file"), "{}", message());
    }
}
