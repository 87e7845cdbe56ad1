//! `run.json`: how a run was called, and what it was computed with.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::files::{self, NETWORKS};
use crate::config::RunConfig;
use crate::config::resume::{Difference, differences, differing, to_json};
use crate::domains::DomainConfig;
use dials_core::domain::Scenario;
use dials_core::outside::{Directory, LARGEST_NETWORK, excerpt, is_printable, read_bytes, read_text};

/// Largest file. A command line has at most two mebibytes on Linux, and escapes may double it.
const LARGEST_FILE: u64 = 8 << 20;
/// Longest word of a scenario in bytes. Files and headings of a report are named after them.
const LONGEST_WORD: usize = 50;
const MOST_AGENTS: usize = 1_000_000;
/// What stands in the place of SUMO's version, for a domain that does not need it.
pub(crate) const NO_SUMO: &str = "none";

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunJson {
    /// Words of the command line; the first is the name of the program.
    pub command: Vec<Word>,
    /// Other builds with which the run was continued, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub resumed_with: Vec<Resumed>,
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
    /// Functions and objects of Python that took part, when the run began.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub python: Vec<PythonFunction>,
    /// Build that the run was begun with.
    pub versions: Versions,
}

/// A function or an object of the user's Python process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PythonFunction {
    /// `reward`, `observation`, `learner` or `predictor`.
    pub kind: String,
    /// Name of the function, or of the class.
    pub name: String,
    /// Its text; empty if Python does not know it.
    pub source: String,
}

/// The domain of a run as it was when the run began, so that a change to a run directory can be named.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// The domain's table of the config, under its name; paths are empty.
    pub(crate) config: Map<String, Value>,
    /// CRC-32 of each file in `networks/`, by its name.
    pub(crate) networks: BTreeMap<String, String>,
}

impl Kept {
    /// Returns what the run directory `dir` holds. `config`: its config.
    pub(crate) fn of(dir: &Path, config: &RunConfig) -> Result<Kept> {
        let name = config.domain.as_ref().map(DomainConfig::name);
        let table = |name: &str| (name.to_owned(), to_json(config)[name].take());
        Ok(Kept { config: name.map(table).into_iter().collect(), networks: checksums(dir)? })
    }

    pub(crate) fn is_empty(&self) -> bool {
        *self == Kept::default()
    }

    /// Lists the keys of the domain that `config` has other values for.
    pub(crate) fn changed_keys(&self, config: &RunConfig) -> Result<Vec<Difference>> {
        if self.config.is_empty() {
            return Ok(Vec::new());
        }
        let then = serde_json::from_value(json!(self.config)).context("the domain of run.json cannot be read")?;
        let now = RunConfig { domain: config.domain.clone(), ..RunConfig::default() };
        Ok(differences(&then, &now))
    }

    /// Lists the files in `networks/` that are other ones now, are missing or are new.
    pub(crate) fn changed_files(&self, dir: &Path) -> Result<Vec<Difference>> {
        let of_file = |(name, checksums): (String, [Option<String>; 2])| {
            let [then, now] = checksums.map(|checksum| checksum.map(Value::String));
            Difference { key: format!("{NETWORKS}/{name}"), then, now }
        };
        Ok(differing(&self.networks, &checksums(dir)?).into_iter().map(of_file).collect())
    }
}

/// Returns the CRC-32 of each file in `networks/`, by its name. A domain without files has no such folder.
fn checksums(dir: &Path) -> Result<BTreeMap<String, String>> {
    let folder = dir.join(NETWORKS);
    if !folder.is_dir() {
        return Ok(BTreeMap::new());
    }
    let checksum = |name: OsString| {
        let path = folder.join(&name);
        let bytes =
            read_bytes(&path, LARGEST_NETWORK).with_context(|| format!("{}: cannot be read", path.display()))?;
        Ok((name.to_string_lossy().into_owned(), format!("{:08x}", crc32fast::hash(&bytes))))
    };
    Directory::open(&folder)?.names()?.into_iter().map(checksum).collect()
}

/// A word of a command line. JSON is UTF-8, so other bytes are an object with a character per byte (Latin-1).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Word {
    Text(String),
    Bytes { latin1: String },
}

impl Word {
    /// Returns the word itself. Characters that are no bytes, which only others write, become `?`.
    pub fn as_it_was(&self) -> OsString {
        match self {
            Word::Text(text) => text.into(),
            Word::Bytes { latin1 } => {
                OsString::from_vec(latin1.chars().map(|letter| u8::try_from(letter).unwrap_or(b'?')).collect())
            }
        }
    }
}

impl From<&OsStr> for Word {
    fn from(word: &OsStr) -> Word {
        match word.to_str() {
            Some(text) => Word::Text(text.to_owned()),
            None => Word::Bytes { latin1: word.as_bytes().iter().map(|&byte| char::from(byte)).collect() },
        }
    }
}

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
    pub cpu: String,
    pub dials_traffic: String,
    /// Commit of the checkout that the program was built from, with `-dirty` if its sources had been changed.
    pub git_commit: String,
    /// Library of `exp`, `ln` and so on.
    pub libm: String,
    pub libtorch: String,
    pub sumo: String,
    /// Who built SUMO's library: `wheel`, `debian 12`. Versions of one number can differ in options of their compilers.
    pub sumo_builder: String,
    /// Instructions that multiply matrices.
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
            python: Vec::new(),
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

    /// Returns the versions of SUMO that the run was computed with; none if it needs none, or if that was not recorded.
    pub fn sumo(&self) -> BTreeSet<&str> {
        let all = [&self.versions].into_iter().chain(self.resumed_with.iter().map(|resumed| &resumed.versions));
        all.map(|versions| versions.sumo.as_str()).filter(|sumo| !["", NO_SUMO].contains(sumo)).collect()
    }

    /// Returns the name of an agent for a reader: printable and short; its number if it has none.
    pub fn agent_name(&self, agent: usize) -> String {
        self.agents.get(agent).map_or_else(|| agent.to_string(), |name| excerpt(name))
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
    let words = [("domain", Some(&id.domain)), ("name", scenario.name.as_ref())];
    let others = [("checksum", id.checksum.as_ref()), ("scored_by", id.rules.as_ref())];
    for (what, word) in words.into_iter().chain(others) {
        if let Some(word) = word {
            ensure!(plain(word), message(what, word));
        }
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
    /// Lists the differences from the build that wrote a run, a line each. Only what can change numbers counts.
    pub fn differences(&self, there: &Versions) -> Vec<String> {
        let decisive = [
            ("commit", &self.git_commit, &there.git_commit),
            ("SUMO", &self.sumo, &there.sumo),
            ("libm", &self.libm, &there.libm),
            ("vector instructions", &self.vector_instructions, &there.vector_instructions),
        ];
        let text = |version: &String| if version.is_empty() { "not recorded".to_owned() } else { version.clone() };
        let differing = decisive.into_iter().filter(|(_, here, there)| here != there);
        differing.map(|(name, here, there)| format!("{name}: {} there, {} here", text(there), text(here))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_version_that_was_not_recorded_differs_and_the_cpu_does_not_count() {
        let old = Versions { sumo: "SUMO 1.15.0".into(), cpu: "A".into(), ..Versions::default() };
        let here = Versions { libm: "glibc 2.36".into(), cpu: "B".into(), ..old.clone() };
        assert_eq!(here.differences(&old), ["libm: not recorded there, glibc 2.36 here"]);
    }

    #[test]
    fn agents_have_the_names_that_were_recorded_or_their_numbers() {
        let run = RunJson::new(Scenario::new("ants", 3, 5), vec!["r0c0".to_owned(), "a\u{1b}b".to_owned()], 7);
        assert_eq!([0, 1, 2].map(|agent| run.agent_name(agent)), ["r0c0", "a\\u{1b}b", "2"]);
    }

    #[test]
    fn a_scenario_has_plain_words_because_files_are_named_after_them() {
        let dir = tempfile::tempdir().unwrap();
        let long = "a".repeat(51);
        let bad = ["", "../x", "/x", "-x", "a b", "ü", "a\u{1b}b", "a\nb", "a](b)", &long].map(|word| json!(word));
        for (key, values) in [
            ("/domain", &bad[..]),
            ("/name", &bad),
            ("/checksum", &bad),
            ("/agents", &[json!(0), json!(1_000_001), json!(u64::MAX)]),
            ("/episode/unit", &[json!("st\u{202e}eps")]),
        ] {
            for value in values {
                let scenario = Scenario { name: Some("x".to_owned()), ..Scenario::new("ants", 4, 5) };
                let mut about = serde_json::to_value(RunJson::new(scenario, Vec::new(), 1)).unwrap();
                about["scenario"]["checksum"] = json!("1a2b3c4d");
                *about["scenario"].pointer_mut(key).unwrap() = value.clone();
                fs::write(dir.path().join(files::RUN), about.to_string()).unwrap();
                let error = format!("{:#}", RunJson::read(dir.path()).unwrap_err());
                let name = key.rsplit('/').next().unwrap();
                assert!(error.contains(&format!("scenario: {name} is ")), "{value}: {error}");
            }
        }
    }

    #[test]
    fn a_word_that_is_not_latin1_is_read_with_question_marks() {
        let strange: Word = serde_json::from_str(r#"{"latin1":"a交"}"#).unwrap();
        assert_eq!(strange.as_it_was(), "a?");
    }
}
