//! What a run is computed with: this program, its libraries and the machine. It stands in `run.json` and is compared
//! when the run is resumed, because the same seed gives the same files only with the same build.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};
use serde::Serialize;
use serde_json::{Value, json};

use super::domain::NO_SUCH_VECTORS;
use crate::base::VectorWidth;
use crate::nn::vector_instructions;
use crate::traffic;
use crate::training::files::{RUN, write_atomically};

/// What `run.json` calls `versions`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Build {
    /// Version of this program.
    pub dials_traffic: String,
    /// Commit of the checkout that the program was built from, with `-dirty` where its sources had been changed.
    pub git_commit: String,
    pub sumo: String,
    pub libtorch: String,
    /// Library of `exp`, `ln` and so on.
    pub libm: String,
    /// Instructions that multiply matrices.
    pub vector_instructions: String,
    /// Name of the CPU, for information only.
    pub cpu: String,
}

/// The keys that decide about numbers, and their names for people.
const DECISIVE: [(&str, &str); 4] =
    [("git_commit", "commit"), ("sumo", "SUMO"), ("libm", "libm"), ("vector_instructions", "vector instructions")];

const VERSIONS: &str = "versions";
const RESUMED_WITH: &str = "resumed_with";

impl Build {
    /// This program on this machine, where its networks use vector registers of this width.
    pub fn here(width: VectorWidth) -> Result<Build> {
        Ok(Build {
            dials_traffic: env!("CARGO_PKG_VERSION").to_owned(),
            git_commit: env!("DIALS_GIT_COMMIT").to_owned(),
            sumo: traffic::sumo_version()?,
            libtorch: env!("DIALS_LIBTORCH_VERSION").to_owned(),
            libm: traffic::libm()?,
            vector_instructions: vector_instructions(width).context(NO_SUCH_VECTORS)?,
            cpu: cpu(),
        })
    }

    /// In what the build that wrote a run last differs from this one, a line each; only what decides about numbers.
    /// `run`: what `run.json` holds.
    fn differences(&self, run: &Value) -> Vec<String> {
        let last = run[RESUMED_WITH].as_array().and_then(|resumed| resumed.last()).unwrap_or(run);
        let (there, here) = (&last[VERSIONS], json!(self));
        let differing = DECISIVE.iter().filter(|(key, _)| there[key] != here[key]);
        let text = |value: &Value| value.as_str().unwrap_or("not recorded").to_owned();
        differing.map(|(key, name)| format!("{name}: {} there, {} here", text(&there[key]), text(&here[key]))).collect()
    }
}

/// Returns this build if the one that wrote the run in `dir` last is another; an error that names all differences
/// unless that is accepted.
pub fn other_build(dir: &Path, width: VectorWidth, accepted: bool) -> Result<Option<Build>> {
    let here = Build::here(width)?;
    let differences = here.differences(&read(dir)?);
    if differences.is_empty() {
        return Ok(None);
    }
    if !accepted {
        bail!(
            "{}: was written by another build or on another machine, so its numbers may change from here on:\n  {}\n  \
             to go on all the same, add --accept-other-build",
            dir.display(),
            differences.join("\n  ")
        );
    }
    Ok(Some(here))
}

/// Adds to `run.json` that the run in `dir` goes on with this build, from this timestep per agent.
pub fn record_resume(dir: &Path, build: &Build, steps: u64) -> Result<()> {
    let mut run = read(dir)?;
    let path = dir.join(RUN);
    let object = run.as_object_mut().with_context(|| format!("{}: is no JSON object", path.display()))?;
    let resumed = object.entry(RESUMED_WITH).or_insert(json!([]));
    let list = resumed.as_array_mut().with_context(|| format!("{}: {RESUMED_WITH} is no list", path.display()))?;
    list.push(json!({ "steps": steps, VERSIONS: build }));
    write_atomically(&path, format!("{run:#}\n").as_bytes())
}

fn read(dir: &Path) -> Result<Value> {
    let path = dir.join(RUN);
    let text = fs::read_to_string(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{}: is no JSON", path.display()))
}

fn cpu() -> String {
    let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name =
        text.lines().find_map(|line| Some(line.strip_prefix("model name")?.split_once(':')?.1.trim().to_owned()));
    name.unwrap_or("unknown".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn build() -> Build {
        Build {
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
        let run = json!({ "versions": Build { cpu: "B".into(), ..build() } });
        assert_eq!(build().differences(&run), [""; 0]);
    }

    #[test]
    fn every_decisive_difference_is_named_with_both_values() {
        let there = Build { git_commit: "abc".into(), vector_instructions: "avx2+fma".into(), ..build() };
        let expected = ["commit: abc there, abc-dirty here", "vector instructions: avx2+fma there, avx512f here"];
        assert_eq!(build().differences(&json!({ "versions": there })), expected);
        let old = json!({ "versions": { "git_commit": "abc-dirty", "sumo": "SUMO 1.14.0" } });
        let expected = [
            "SUMO: SUMO 1.14.0 there, SUMO 1.15.0 here",
            "libm: not recorded there, glibc 2.36 here",
            "vector instructions: not recorded there, avx512f here",
        ];
        assert_eq!(build().differences(&old), expected);
    }

    #[test]
    fn a_run_that_was_resumed_is_compared_with_the_build_that_wrote_it_last() {
        let dir = tempfile::tempdir().unwrap();
        let first = Build { libm: "glibc 2.31".into(), ..build() };
        let text = json!({ "seed": 7, "versions": first }).to_string();
        fs::write(dir.path().join(RUN), text).unwrap();
        assert_eq!(build().differences(&read(dir.path()).unwrap()).len(), 1);
        record_resume(dir.path(), &build(), 512).unwrap();
        let run = read(dir.path()).unwrap();
        assert_eq!(build().differences(&run), [""; 0]);
        assert_eq!(first.differences(&run), ["libm: glibc 2.36 there, glibc 2.31 here"]);
        record_resume(dir.path(), &first, 1024).unwrap();
        let run = read(dir.path()).unwrap();
        assert_eq!((&run["seed"], &run["versions"]), (&json!(7), &json!(first)), "the beginning stays");
        let steps: Vec<_> = run["resumed_with"].as_array().unwrap().iter().map(|one| &one["steps"]).collect();
        assert_eq!(steps, [512, 1024]);
    }
}
