//! `bench` as a user sees it. No test can know how fast anything is, but a test can check that the parts add up.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

const TRAFFIC: &str = "[traffic]\nnetwork = 'NETS/grid_2x2'\nlocal_network = 'NETS/local'\nhorizon = 40\n\
    [local_simulators]\ncopies = 8\n[policy]\nhidden = [16, 8]\n[aip]\nhidden = [8]\ndataset_steps = 160\nbatch = 32\nepochs = 2\n\
    [evaluation]\nepisodes = 2\n";
const SCENARIO: &str = "simulator = 'local'\n[traffic]\nscenario = 'NETS/grid_4x4_turns/grid_4x4_turns.sumocfg'\nend_s = 240\ndecision_s = 4\n\
    local_horizon = 20\n[policy]\nhidden = [8]\n[ppo]\nrollout_steps = 20\nmemory = 20\nminibatch = 20\nepochs = 1\n\
    [aip]\nhidden = [8]\ndataset_steps = 120\nbatch = 30\nepochs = 2\n[evaluation]\nepisodes = 1\n";
const WAREHOUSE: &str = "[warehouse]\nagents_per_side = 2\nhorizon = 50\n[local_simulators]\ncopies = 8\n\
    [policy]\nrecurrent = 24\nhidden = [16]\nsequence_length = 8\n[ppo]\nrollout_steps = 8\n\
    [aip]\nrecurrent = 8\nhidden = [8]\ndataset_steps = 500\nbatch = 4\nepochs = 5\n[evaluation]\nepisodes = 3\n";

/// A folder for the output, with a config in it.
struct Place {
    dir: tempfile::TempDir,
    config: PathBuf,
}

impl Place {
    fn new(config: &str) -> Place {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("small.toml");
        let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
        fs::write(&path, config.replace("NETS", nets.to_str().unwrap())).unwrap();
        fs::create_dir(dir.path().join("here")).unwrap();
        fs::create_dir(dir.path().join("tmp")).unwrap();
        Place { config: path, dir }
    }

    fn bench(&self, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
        command.arg("bench").arg(&self.config).args(more).env("TMPDIR", self.dir.path().join("tmp"));
        command.current_dir(self.dir.path().join("here"));
        command
    }

    fn assert_left_as_it_was(&self) {
        for folder in ["here", "tmp"] {
            let left: Vec<_> = fs::read_dir(self.dir.path().join(folder)).unwrap().collect();
            assert!(left.is_empty(), "{folder}: {left:?}");
        }
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn answer(output: &Output) -> String {
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stdout)
}

#[test]
fn the_costs_of_the_parts_add_up_to_the_speed_of_the_whole() {
    for (config, sumo) in [(TRAFFIC, true), (WAREHOUSE, false)] {
        let place = Place::new(config);
        let output = place.bench(&["--workers", "2", "--seconds", "1", "--json"]).output().unwrap();
        let answer: Value = serde_json::from_str(&answer(&output)).unwrap();
        assert_eq!((&answer["agents"], &answer["timesteps_per_agent"]), (&4.into(), &4_000_000.into()));
        let fleets = answer["fleets"].as_array().unwrap();
        assert_eq!(fleets.iter().map(|fleet| fleet["workers"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 2]);
        for fleet in fleets {
            let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("no number in {fleet}"));
            let phases = fleet["training"]["phases_us"].as_object().unwrap();
            let in_no_phase = ["other_in_training_us", "idle_in_training_us"].map(|key| number(&fleet[key]));
            let of_training: f64 = phases.values().map(number).chain(in_no_phase).sum();
            let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6 * b, "{a} is not {b} in {fleet}");
            near(of_training, number(&fleet["training"]["us"]));
            let activities = ["training", "evaluation", "collection", "aip_training"];
            let whole: f64 = activities.iter().map(|activity| number(&fleet[activity]["us"])).sum();
            near(whole + number(&fleet["exchange_us"]), number(&fleet["all"]["us"]));
            near(number(&fleet["agent_steps_per_s"]) * number(&fleet["all"]["us"]) / 1e6, number(&fleet["workers"]));
            for activity in activities {
                assert!(number(&fleet[activity]["us"]) > 0.0, "{activity} cost nothing in {fleet}");
                assert!(number(&fleet[activity]["products_at_peak_us"]) > 0.0, "{activity} in {fleet}");
            }
            for phase in ["simulator_step", "acting", "aip_sampling", "forward", "backward", "adam", "bookkeeping"] {
                assert!(number(&phases[phase]) > 0.0, "{phase} cost nothing in {fleet}");
            }
            assert_eq!(number(&phases["insertion"]) > 0.0, sumo);
            assert_eq!(number(&fleet["training"]["sumo_step_us"]) > 0.0, sumo);
            let simulators = &fleet["simulators"];
            assert_eq!((&simulators["steps_per_timestep"], &simulators["gs_in_training"]), (&1.into(), &Value::Null));
            // A timestep is a step here, so these are the same phases.
            let ls = &simulators["ls_in_training"];
            near(number(&ls["step_us"]), number(&phases["simulator_step"]));
            for simulator in [ls, &simulators["gs_in_evaluation"], &simulators["gs_in_collection"]] {
                // There is nothing around a step of our own simulators.
                let around = number(&simulator["around_us"]);
                assert!(number(&simulator["step_us"]) > 0.0 && (around > 0.0) == sumo, "{fleet}");
            }
            if sumo {
                near(number(&ls["around_us"]), number(&phases["insertion"]) + number(&phases["reading"]));
            }
            assert!(number(&fleet["gs_steps_per_s_in_collection"]) > 0.0 && number(&fleet["memory_mb"]) > 10.0);
        }
        place.assert_left_as_it_was();
    }
}

#[test]
fn the_simulators_of_a_scenario_are_measured_light_by_light_and_second_by_second() {
    let place = Place::new(SCENARIO);
    let output = place.bench(&["--workers", "1", "--seconds", "2", "--json"]).output().unwrap();
    let answer: Value = serde_json::from_str(&answer(&output)).unwrap();
    let fleet = &answer["fleets"][0];
    let simulators = &fleet["simulators"];
    assert_eq!((&answer["agents"], &simulators["steps_per_timestep"]), (&16.into(), &4.into()));
    let us = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("no number in {fleet}"));
    // A timestep has four seconds.
    let (ls, phases) = (&simulators["ls_in_training"], &fleet["training"]["phases_us"]);
    assert!((4.0 * us(&ls["step_us"]) / us(&phases["simulator_step"]) - 1.0).abs() < 1e-6, "{fleet}");
    for simulator in ["gs_in_evaluation", "gs_in_collection", "ls_in_training"] {
        assert!(
            us(&simulators[simulator]["step_us"]) > 0.0 && us(&simulators[simulator]["around_us"]) > 0.0,
            "{fleet}"
        );
    }
    assert!(us(&simulators["learning_us_per_agent_step"]) > 0.0);
    let table = text(&place.bench(&["--workers", "1", "--seconds", "1", "--simulator", "gs"]).output().unwrap().stdout);
    assert!(
        table.contains("core-microseconds per agent and step of the simulator") && table.contains("GS in training")
    );
    assert!(!table.contains("LS in training"), "{table}");
    place.assert_left_as_it_was();
}

#[test]
fn what_a_simulator_does_not_need_is_not_measured() {
    let place = Place::new(TRAFFIC);
    for (simulator, sampling) in [("gs", false), ("untrained-dials", true)] {
        let output = place.bench(&["--workers", "1", "--seconds", "1", "--simulator", simulator]).output().unwrap();
        let table = answer(&output);
        assert!(table.contains("agent-steps/s") && table.contains("evaluation"), "{table}");
        assert!(!table.contains("collection") && !table.contains("AIP training"), "{table}");
        assert_eq!(table.contains("AIP sampling"), sampling, "{table}");
    }
    place.assert_left_as_it_was();
}

#[cfg(not(feature = "torch"))]
#[test]
fn without_libtorch_a_benchmark_says_how_to_measure_it() {
    let place = Place::new(WAREHOUSE);
    let table = answer(&place.bench(&["--workers", "1", "--seconds", "1"]).output().unwrap());
    assert!(
        table.contains("\nlibtorch's speed is not measured: ") && table.contains(": ./setup.sh torch && "),
        "{table}"
    );
    let json = place.bench(&["--workers", "1", "--seconds", "1", "--json"]).output().unwrap();
    let json: Value = serde_json::from_str(&answer(&json)).unwrap();
    assert_eq!(json.get("peak_gflops_by_libtorch"), Some(&Value::Null));
}

#[test]
fn an_interrupted_benchmark_ends_at_once_and_leaves_nothing() {
    let place = Place::new(TRAFFIC);
    let mut bench = place.bench(&["--workers", "1", "--seconds", "600"]);
    let mut process = bench.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut stderr = BufReader::new(process.stderr.take().unwrap());
    let mut line = String::new();
    stderr.read_line(&mut line).unwrap();
    // The start takes a second, the peak another one. The shares of 600 s are 0.9 of it; one update comes on top.
    assert_eq!(line, "measuring 1 fleet for about 600 s each; the whole takes about 543 s\n");
    line.clear();
    stderr.read_line(&mut line).unwrap();
    assert_eq!(line, "measuring with 1 of 1 worker\n");
    kill_process(Pid::from_child(&process), Signal::INT).unwrap();
    let mut rest = String::new();
    stderr.read_to_string(&mut rest).unwrap();
    assert_eq!((process.wait().unwrap().code(), rest.as_str()), (Some(130), "stopped\n"));
    place.assert_left_as_it_was();
}

#[test]
fn nonsense_is_refused() {
    let place = Place::new(TRAFFIC);
    for nonsense in [&["--workers", "0"][..], &["--seconds", "0"], &["--set", "ppo.clip=-1"], &["--simulator", "x"]] {
        let output = place.bench(nonsense).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{nonsense:?}: {}", text(&output.stderr));
    }
    place.assert_left_as_it_was();
}
