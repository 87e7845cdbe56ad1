//! Progress of an experiment, read from its run directories and measured baselines.

use std::path::{Path, PathBuf};

use anyhow::{Error, Result, bail, ensure};

use super::file::{PlannedBaseline, PlannedRun};
use crate::records::checkpoint::owner::NotOfThisRun;
use crate::records::files::{CONFIG, is_run_dir};
use crate::records::find::{BaselineRecord, MeasuredWith, baseline_file, read_baseline};
use crate::records::method::{Method, differing};
use crate::records::run_json::RunJson;
use crate::records::run_record::{RunRecord, Status};
use dials_core::outside::{Directory, Printable, quoted};

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stage {
    New,
    /// There is a directory, to be resumed. `steps`: timesteps of the last evaluation.
    Begun {
        steps: u64,
    },
    /// A process trains the run. `steps`: as above.
    Running {
        steps: u64,
    },
    /// A baseline was measured, but not as planned now.
    Outdated,
    /// The files of a run are damaged. `why`: how, and what to try.
    Unreadable {
        why: String,
    },
    Finished,
}

impl Stage {
    pub fn name(&self) -> &'static str {
        match self {
            Stage::New => "new",
            Stage::Begun { .. } => "to be resumed",
            Stage::Running { .. } => "running",
            Stage::Outdated => "outdated",
            Stage::Unreadable { .. } => "unreadable",
            Stage::Finished => "finished",
        }
    }

    /// Returns the share of its timesteps that are done, from 0 to 1.
    pub fn share(&self, run: &PlannedRun) -> f64 {
        match self {
            Stage::New | Stage::Outdated | Stage::Unreadable { .. } => 0.0,
            Stage::Begun { steps } | Stage::Running { steps } => *steps as f64 / run.config.learning.last_step() as f64,
            Stage::Finished => 1.0,
        }
    }
}

pub fn directory(folder: &Path, run: &PlannedRun) -> PathBuf {
    folder.join(&run.name)
}

/// Reads the progress of a planned run. A different run in its directory is an error.
/// A run with files that no killed run leaves behind is unreadable: only a person can say what became of them.
pub fn stage(folder: &Path, run: &PlannedRun) -> Result<Stage> {
    let dir = directory(folder, run);
    if !is_run_dir(&dir) {
        ensure!(!dir.exists(), "{}: exists, but is not a run directory", dir.display());
        return Ok(Stage::New);
    }
    let read = match difference(&dir, run) {
        Ok(Some(difference)) => bail!(
            "{}: holds a different run than planned ({difference}); move it away, or choose another folder with --out",
            dir.display()
        ),
        Ok(None) => RunRecord::read(&dir),
        Err(error) => Err(error),
    };
    let unfinished = |steps| match Directory::is_locked(&dir) {
        true => Stage::Running { steps },
        false => Stage::Begun { steps },
    };
    Ok(match read {
        Ok(record) => match record.status() {
            Status::Finished if record.is_whole() => Stage::Finished,
            Status::Finished => unfinished(run.config.learning.last_step()),
            Status::Unfinished { steps } => unfinished(steps),
            Status::Empty => unfinished(0),
        },
        Err(error) => Stage::Unreadable { why: unreadable(&dir, &error) },
    })
}

/// Returns what is wrong with a run that cannot be read, and what to try.
fn unreadable(dir: &Path, error: &Error) -> String {
    if error.is::<NotOfThisRun>() {
        return format!("{error:#}; or move the directory away, and the run is trained again");
    }
    format!(
        "this run cannot be read: {error:#}; try: dials-traffic train --resume {}; if that does not help, move the \
         directory away, and the run is trained again",
        quoted(dir)
    )
}

/// Reads whether a controller was measured as planned. A change of its file or of SUMO counts, too. Another controller or
/// another scenario in its file is an error: it may be of another experiment.
pub fn stage_of_baseline(folder: &Path, planned: &PlannedBaseline) -> Result<Stage> {
    let path = baseline_file(folder, &planned.name);
    if !path.exists() {
        return Ok(Stage::New);
    }
    let Ok(there) = read_baseline(&path) else { return Ok(Stage::Outdated) };
    for (what, then, now) in
        [("scenario", &there.scenario, &planned.scenario), ("controller", &there.controller, &planned.controller)]
    {
        ensure!(
            then == now,
            "{}: holds another measurement than planned ({what}: {} there, {} planned); move it away, or choose another \
             folder with --out",
            path.display(),
            Printable(then),
            Printable(now)
        );
    }
    let as_planned = |there: &BaselineRecord| {
        there.episodes == planned.episodes
            && there.seed == planned.config.learning.evaluation.seed
            && is_measured_with(&there.measured_with, &planned.measured_with)
    };
    Ok(if as_planned(&there) { Stage::Finished } else { Stage::Outdated })
}

/// Returns whether a controller would be measured with the same again. An unknown version of SUMO is no difference.
fn is_measured_with(then: &MeasuredWith, now: &MeasuredWith) -> bool {
    let [sumo_then, sumo_now] = [then, now].map(|with| with.sumo_version.as_ref());
    then.controller_file_crc32 == now.controller_file_crc32
        && sumo_then.zip(sumo_now).is_none_or(|(then, now)| then == now)
}

/// Describes the first difference between the run in `dir` and the plan; `None` if there is none.
fn difference(dir: &Path, planned: &PlannedRun) -> Result<Option<String>> {
    let there = (&crate::config::load_kept(&dir.join(CONFIG))?, &RunJson::read(dir)?.scenario);
    let both = [there, (&planned.config, &planned.scenario)];
    let [keys, planned_keys] = both.map(|(config, scenario)| Method::of(config, scenario).keys);
    let text = |value: Option<String>| value.unwrap_or("nothing".to_owned());
    let mut found: Vec<(String, [String; 2])> =
        differing(&keys, &planned_keys).into_iter().map(|(key, values)| (key, values.map(text))).collect();
    let mut compare = |key: &str, values: [u64; 2]| {
        let differ = values[0] != values[1];
        found.extend(differ.then(|| (key.to_owned(), values.map(|value| value.to_string()))));
    };
    compare("steps", both.map(|(config, _)| config.learning.last_step()));
    // This is no key of the method, because it moves no policy. But what it measures would be missing.
    if planned.config.learning.measures_aips() {
        let episodes = both.map(|(config, _)| config.learning.evaluation.aip_loss_episodes as u64);
        compare("evaluation.aip_loss_episodes", episodes);
    }
    compare("seed", both.map(|(config, _)| config.learning.seed));
    if there.1.id != planned.scenario.id {
        found.push(("scenario".to_owned(), both.map(|(_, scenario)| scenario.id.word())));
    }
    Ok(found.into_iter().next().map(|(key, [a, b])| format!("{key}: {a} there, {b} planned")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{RunConfig, to_toml};
    use crate::experiment::file;
    use dials_core::domain::Scenario;
    use dials_learn::config::Simulator;

    /// Returns a planned run of 1000 timesteps with four agents, in the folder of a run whose files it is compared with.
    fn planned(folder: &Path) -> PlannedRun {
        let text = "total_steps = 1000\n[warehouse]\nagents_per_side = 2\n[evaluation]\nfinal_episodes = 1\n";
        let config: RunConfig = toml::from_str(text).unwrap();
        let run = file::tests::planned(config, Scenario::new("warehouse", 4, 10));
        std::fs::create_dir(directory(folder, &run)).unwrap();
        write(folder, &run, CONFIG, &to_toml(&run.config).unwrap());
        let about = RunJson::new(run.scenario.clone(), Vec::new(), 1);
        about.write(&Directory::open(&directory(folder, &run)).unwrap()).unwrap();
        run
    }

    fn write(folder: &Path, run: &PlannedRun, file: &str, text: &str) {
        std::fs::write(directory(folder, run).join(file), text).unwrap();
    }

    #[test]
    fn a_run_that_did_not_measure_what_is_planned_now_is_another_one() {
        let folder = tempfile::tempdir().unwrap();
        let mut run = planned(folder.path());
        run.config.learning.evaluation.aip_loss_episodes = 4;
        let error = format!("{:#}", stage(folder.path(), &run).unwrap_err());
        assert!(error.contains("evaluation.aip_loss_episodes: 0 there, 4 planned"), "{error}");
        // On the GS there are no AIPs, so nothing is missing.
        run.config.learning.simulator = Simulator::Global;
        write(folder.path(), &run, CONFIG, &to_toml(&run.config).unwrap());
        run.config.learning.evaluation.aip_loss_episodes = 8;
        assert_eq!(stage(folder.path(), &run).unwrap(), Stage::Begun { steps: 0 });
    }

    #[test]
    fn a_baseline_is_outdated_when_its_controllers_file_or_sumo_is_another_one() {
        let with = |file: Option<&str>, sumo: Option<&str>| {
            let [controller_file_crc32, sumo_version] = [file, sumo].map(|text| text.map(str::to_owned));
            MeasuredWith { controller_file_crc32, sumo_version }
        };
        let (a, b, old, new) = (Some("a"), Some("b"), Some("SUMO 1.15.0"), Some("SUMO 1.16.0"));
        for (then, now, same) in [
            (with(a, new), with(a, new), true),
            (with(None, None), with(None, new), true),
            (with(None, old), with(None, None), true),
            (with(a, new), with(b, new), false),
            (with(None, new), with(a, new), false),
            (with(None, old), with(None, new), false),
        ] {
            assert_eq!(is_measured_with(&then, &now), same, "{then:?}, {now:?}");
        }
    }

    #[test]
    fn a_measurement_of_another_experiment_is_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let run = planned(folder.path());
        let mut baseline = file::tests::planned_baseline(&run, 1);
        let path = baseline_file(folder.path(), &baseline.name);
        std::fs::create_dir(path.parent().unwrap()).unwrap();
        let record = serde_json::json!({
            "scenario": baseline.scenario, "controller": "random", "mean_return": 1.0, "std_error": 0.0, "episodes": 1,
            "seed": run.config.learning.evaluation.seed, "episode_returns": [1.0],
        });
        std::fs::write(&path, record.to_string()).unwrap();
        assert_eq!(stage_of_baseline(folder.path(), &baseline).unwrap(), Stage::Finished);
        baseline.scenario = "warehouse_9".to_owned();
        let error = stage_of_baseline(folder.path(), &baseline).unwrap_err().to_string();
        let there = run.scenario.id.word();
        let message = format!("holds another measurement than planned (scenario: {there} there, warehouse_9 planned)");
        assert!(error.contains(&message), "{error}");
    }

    #[test]
    fn a_run_of_another_domain_now_is_not_resumed() {
        let error = NotOfThisRun("a: was written with other settings".to_owned()).into();
        let why = "a: was written with other settings; or move the directory away, and the run is trained again";
        assert_eq!(unreadable(Path::new("a"), &error), why);
    }
}
