//! What `run.json` says of the build, when a run may continue with another build, and registers of one width for all.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::{Value, json};

use crate::place::Place;

/// A warehouse of four robots, two periods. It has a GRU, minibatches and weights that fill registers of any width.
const CONFIG: &str = "total_steps = 256\n[warehouse]\nagents_per_side = 2\nhorizon = 16\n\
                      [policy]\nrecurrent = 32\nhidden = [32]\n[ppo]\nrollout_steps = 8\n\
                      [aip]\nhidden = [32]\nretrain_every_steps = 256\ndataset_steps = 64\nbatch = 16\nepochs = 2\n\
                      [evaluation]\nevery_steps = 128\nepisodes = 2\n";

const RESULTS: [&str; 4] = ["returns.csv", "training.csv", "policies.safetensors", "aips.safetensors"];

fn results(run: &Path) -> Vec<Vec<u8>> {
    RESULTS.iter().map(|file| fs::read(run.join(file)).unwrap()).collect()
}

fn run_json(run: &Path) -> Value {
    serde_json::from_slice(&fs::read(run.join("run.json")).unwrap()).unwrap()
}

/// Makes a finished run look as if it had been stopped after its first period.
fn lose_the_last_period(run: &Path) {
    fs::remove_file(run.join("checkpoints/step_000000000256.safetensors")).unwrap();
    let returns = fs::read_to_string(run.join("returns.csv")).unwrap();
    let whole = returns.find("\n256,").unwrap() + 1;
    fs::write(run.join("returns.csv"), &returns[..whole]).unwrap();
}

/// Makes a run look as if other software had written it, on another machine.
fn pretend_another_build(run: &Path) {
    let mut about = run_json(run);
    about["versions"]["git_commit"] = json!("0123456789ab-dirty");
    about["versions"]["sumo"] = json!("SUMO 1.14.0");
    about["versions"]["libm"] = json!("glibc 2.31");
    about["versions"]["vector_instructions"] = json!("scalar");
    about["versions"]["cpu"] = json!("an old one");
    fs::write(run.join("run.json"), about.to_string()).unwrap();
}

/// Asserts exit code 2 and an error that names the run, all differences with both values, and the way out.
fn assert_refused(mut command: Command, run: &str, here: &Value) {
    let output = command.assert().code(2).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    let here = |key: &str| here[key].as_str().unwrap().to_owned();
    for part in [
        format!("{run}: was written by another build or on another machine"),
        format!("commit: 0123456789ab-dirty there, {} here", here("git_commit")),
        format!("SUMO: SUMO 1.14.0 there, {} here", here("sumo")),
        format!("libm: glibc 2.31 there, {} here", here("libm")),
        format!("vector instructions: scalar there, {} here", here("vector_instructions")),
        "add --accept-other-build".to_owned(),
    ] {
        assert!(said.contains(&part), "`{part}` is not in: {said}");
    }
    assert!(said.starts_with("error: ") && !said.contains("an old one"), "{said}");
}

#[test]
fn a_run_says_what_it_was_computed_with() {
    let place = Place::new(CONFIG);
    let versions = run_json(&place.train("run", &[]))["versions"].clone();
    let text = |key: &str| versions[key].as_str().unwrap().to_owned();
    assert_eq!([text("sumo"), text("sumo_builder")], ["none", "none"], "robots need no SUMO");
    assert!(text("libm").starts_with("glibc 2."), "{versions}");
    for key in ["dials_traffic", "git_commit", "libtorch", "vector_instructions", "cpu"] {
        assert!(!text(key).is_empty(), "{key}");
    }
}

#[test]
fn a_run_of_another_build_goes_on_only_where_that_is_asked_for_and_records_it() {
    let place = Place::new(CONFIG);
    let run = place.train("run", &[]);
    let resume = |more: &[&str]| {
        let mut command = place.resume("run");
        command.args(more);
        command
    };
    let (undisturbed, here) = (results(&run), run_json(&run)["versions"].clone());
    lose_the_last_period(&run);
    pretend_another_build(&run);
    let before = run_json(&run);
    assert_refused(resume(&[]), "run", &here);
    assert_eq!(run_json(&run), before, "nothing was changed");

    resume(&["--accept-other-build"]).assert().success();
    assert!(results(&run) == undisturbed, "it was this build all the time");
    let mut expected = before;
    expected["resumed_with"] = json!([{ "steps": 128, "versions": here }]);
    assert_eq!(run_json(&run), expected);

    // From here on, this is the build of the run.
    lose_the_last_period(&run);
    resume(&["--accept-other-build"]).assert().success();
    lose_the_last_period(&run);
    resume(&[]).assert().success();
    assert!(results(&run) == undisturbed);
    assert_eq!(run_json(&run), expected);
}

#[test]
fn where_versions_of_sumo_mix_evaluate_compare_and_report_say_so() {
    let place = Place::new(CONFIG);
    let [a, b] = [("a", "1"), ("b", "2")].map(|(name, seed)| place.train(name, &["--seed", seed]));
    for (run, version) in [(&a, "SUMO 1.15.0"), (&b, "SUMO 1.0.0")] {
        let mut about = run_json(run);
        about["versions"]["sumo"] = json!(version);
        fs::write(run.join("run.json"), about.to_string()).unwrap();
    }
    let said = |args: &[&str]| {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
        let output = command.current_dir(place.dir.path()).args(args).assert().success().get_output().clone();
        [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat()
    };
    let evaluated = said(&["evaluate", "b", "--episodes", "2"]);
    assert!(
        evaluated.contains("warning: b: was trained with SUMO 1.0.0, and is evaluated with SUMO 1."),
        "{evaluated}"
    );
    for args in [&["compare", "a", "b"][..], &["report", "a", "b", "--out", "r"]] {
        let text = said(args).replace("\n  ", " ");
        assert!(text.contains("several versions of SUMO (1 with SUMO 1.0.0, 1 with SUMO 1.15.0)"), "{text}");
    }
}

#[test]
fn an_experiment_resumes_runs_of_another_build_only_where_that_is_asked_for() {
    let place = Place::new(CONFIG);
    fs::write(place.dir.path().join("e.toml"), "seeds = [1, 2]\n[[grid]]\nconfigs = ['c.toml']\n").unwrap();
    let experiment = |more: &[&str]| {
        let mut command = place.command(&["experiment", "e.toml", "--out", "runs"]);
        command.args(more);
        command
    };
    experiment(&[]).assert().success();
    let [finished, stopped] = ["c-dials-seed1", "c-dials-seed2"].map(|name| place.dir.path().join("runs").join(name));
    let here = run_json(&stopped)["versions"].clone();
    lose_the_last_period(&stopped);
    [&finished, &stopped].into_iter().for_each(|run| pretend_another_build(run));
    assert_refused(experiment(&[]), "runs/c-dials-seed2", &here);
    experiment(&["--dry-run"]).assert().success();
    experiment(&["--accept-other-build"]).assert().success();
    assert_eq!(run_json(&stopped)["resumed_with"], json!([{ "steps": 128, "versions": here }]));
    assert!(run_json(&finished)["resumed_with"].is_null(), "there was nothing to resume");
}

#[test]
fn accepting_another_build_makes_no_sense_for_a_new_run() {
    Place::new(CONFIG).command(&["train", "c.toml", "--accept-other-build"]).assert().code(2);
}

#[test]
fn registers_of_256_bits_are_used_by_every_process_of_a_run_and_of_its_evaluation() {
    if cfg!(not(target_arch = "x86_64")) || !is_x86_feature_detected!("avx2") || !is_x86_feature_detected!("fma") {
        eprintln!("not tested: this machine has no AVX2 and FMA");
        return;
    }
    let place = Place::new(CONFIG);
    let fixed = ["--set", "numerics.vector_width=256-bit"];
    let widest = place.train("widest", &[]);
    let inline = place.train("inline", &fixed);
    let words = ["train", "c.toml", "--out", "workers", "--workers", "2"];
    place.command(&words).args(fixed).assert().success();
    let workers = place.dir.path().join("workers");
    assert!(results(&inline) == results(&workers));
    let used = [&widest, &inline].map(|run| run_json(run)["versions"]["vector_instructions"].clone());
    assert_eq!(used[1], "avx2+fma");
    assert_eq!(results(&widest) == results(&inline), used[0] == used[1], "{used:?}");
    assert!(fs::read_to_string(inline.join("config.toml")).unwrap().contains("vector_width = \"256-bit\""));
    // Runs of both widths in one process, each as it was trained.
    let together = place
        .command(&["baseline", "c.toml", "--compare", "./widest,./inline,./workers", "--json", "--seed", "1"])
        .assert()
        .success();
    let together: Value = serde_json::from_slice(&together.get_output().stdout).unwrap();
    let alone = place.command(&["evaluate", "inline", "--json", "--seed", "1"]).assert().success();
    let alone: Value = serde_json::from_slice(&alone.get_output().stdout).unwrap();
    for played in &together["controllers"].as_array().unwrap()[1..] {
        assert_eq!(played["mean_return"], alone["mean_return"]);
    }
}

#[test]
fn a_width_that_nobody_knows_is_refused_with_those_there_are() {
    let place = Place::new(CONFIG);
    let said = |value: &str| {
        let setting = format!("numerics.vector_width={value}");
        let mut command = place.command(&["train", "c.toml", "--out", "run", "--set", &setting]);
        String::from_utf8(command.assert().code(2).get_output().stderr.clone()).unwrap()
    };
    assert!(said("512").contains("--set: numerics.vector_width: "), "{}", said("512"));
    assert!(said("512-bit").contains("allowed: `widest` or `256-bit`"), "{}", said("512-bit"));
}
