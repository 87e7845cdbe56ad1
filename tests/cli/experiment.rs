//! `experiment`: finished runs are skipped, unfinished ones are resumed, and a kill loses nothing.

use std::fs;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use assert_cmd::Command;

/// Config of a warehouse with one robot, which trains very fast.
const CONFIG: &str = "total_steps = 256\n[warehouse]\nagents_per_side = 1\nhorizon = 8\n[policy]\nhidden = [8]\n\
                      [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 64\nbatch = 8\nepochs = 1\n\
                      [evaluation]\nevery_steps = 128\nepisodes = 2\n";

struct Place {
    dir: tempfile::TempDir,
}

impl Place {
    fn new(experiment: &str) -> Place {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("small.toml"), CONFIG).unwrap();
        fs::write(dir.path().join("e.toml"), experiment).unwrap();
        Place { dir }
    }

    fn experiment(&self, more: &[&str]) -> Command {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
        command.current_dir(self.dir.path()).args(["experiment", "e.toml", "--cores", "2"]).args(more);
        command
    }

    fn runs(&self) -> PathBuf {
        self.dir.path().join("results/e/runs")
    }

    fn returns(&self, run: &str) -> String {
        fs::read_to_string(self.runs().join(run).join("returns.csv")).unwrap()
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

const TWO_SEEDS: &str = "seeds = [1, 2]\ncontrollers = ['random']\ncontroller_episodes = 2\n\
                         [[grid]]\nconfigs = ['small.toml']\nsimulators = ['dials', 'gs']\n";

#[test]
fn an_experiment_makes_all_its_runs_and_then_has_nothing_to_do() {
    let place = Place::new(TWO_SEEDS);
    let assert = place.experiment(&[]).assert().success();
    let said = text(&assert.get_output().stdout);
    assert!(said.contains("5 done now, 0 done earlier"), "{said}");
    assert!(said.contains("report results/e/runs --out results/e/report"), "{said}");
    for run in ["small-dials-seed1", "small-dials-seed2", "small-gs-seed1", "small-gs-seed2"] {
        assert!(place.returns(run).contains("\n256,all,"), "{run}");
    }
    let baseline = fs::read_to_string(place.runs().join("baselines/small-random.json")).unwrap();
    assert!(baseline.contains("\"scenario\":\"warehouse-1-8\""), "{baseline}");

    let before = fs::metadata(place.runs().join("small-gs-seed1/returns.csv")).unwrap().modified().unwrap();
    let assert = place.experiment(&[]).assert().success();
    assert!(text(&assert.get_output().stdout).contains("0 done now, 5 done earlier"));
    let after = fs::metadata(place.runs().join("small-gs-seed1/returns.csv")).unwrap().modified().unwrap();
    assert_eq!(before, after);
}

#[test]
fn a_dry_run_only_tells_what_there_is_to_do() {
    let place = Place::new(TWO_SEEDS);
    let assert = place.experiment(&["--dry-run"]).assert().success();
    let said = text(&assert.get_output().stdout);
    assert!(said.contains("5 to do, 0 finished"), "{said}");
    assert!(said.lines().any(|line| line.starts_with("small-dials-seed2") && line.contains(" new ")), "{said}");
    assert!(!place.runs().exists());
}

#[test]
fn a_run_that_a_killed_experiment_left_goes_on_to_the_same_numbers() {
    // Long enough to be killed in the middle; a period every 128 steps.
    let long = "seeds = [1]\nset = ['total_steps=7680']\n[[grid]]\nconfigs = ['small.toml']\n";
    let place = Place::new(long);
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
    command.current_dir(place.dir.path()).args(["experiment", "e.toml"]).stdout(Stdio::null()).stderr(Stdio::null());
    let mut killed = command.process_group(0).spawn().unwrap();
    let returns = place.runs().join("small-dials-seed1/returns.csv");
    let begun = Instant::now();
    while fs::read_to_string(&returns).map_or(0, |text| text.matches(",all,").count()) < 5 {
        assert!(begun.elapsed() < Duration::from_secs(60), "no run began");
        std::thread::sleep(Duration::from_millis(5));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    // The run ends with the experiment, and releases its directory.
    let run = fs::File::open(place.runs().join("small-dials-seed1")).unwrap();
    let killed_at = Instant::now();
    while run.try_lock().is_err() {
        assert!(killed_at.elapsed() < Duration::from_secs(60), "the run lives on");
        std::thread::sleep(Duration::from_millis(5));
    }
    drop(run);
    let cut_short = fs::read_to_string(&returns).unwrap();
    assert!(!cut_short.contains("\n7680,all,"), "it was killed too late to tell");

    let dry = text(&place.experiment(&["--dry-run"]).assert().success().get_output().stdout);
    assert!(dry.contains("to be resumed"), "{dry}");
    let said = text(&place.experiment(&[]).assert().success().get_output().stderr);
    assert!(said.contains("resumed small-dials-seed1"), "{said}");

    let whole = Place::new(long);
    whole.experiment(&[]).assert().success();
    assert_eq!(place.returns("small-dials-seed1"), whole.returns("small-dials-seed1"));
}

#[test]
fn a_run_that_fails_stops_no_other_and_is_named() {
    let place = Place::new(TWO_SEEDS);
    place.experiment(&[]).assert().success();
    // One run starts again. The other one lacks its last times, so it is resumed. But no checkpoint fits its files.
    let [again, spoilt] = ["small-dials-seed1", "small-dials-seed2"].map(|run| place.runs().join(run));
    fs::remove_dir_all(&again).unwrap();
    let times = fs::read_to_string(spoilt.join("timing.csv")).unwrap();
    let block = times.rfind("\n256,all,").expect("the last times are there") + 1;
    fs::write(spoilt.join("timing.csv"), &times[..block]).unwrap();
    fs::write(spoilt.join("training.csv"), "steps,agent\n").unwrap();
    let output = place.experiment(&[]).assert().code(1).get_output().clone();
    let said = text(&output.stderr);
    assert!(said.contains("error: 1 of 2 failed: small-dials-seed2"), "{said}");
    assert!(
        said.contains("small-dials-seed2: error: ") && said.contains("none of the 2 checkpoints fits"),
        "why: {said}"
    );
    assert!(place.returns("small-dials-seed1").contains("\n256,all,"));
}

#[test]
fn a_run_that_cannot_be_started_has_failed_and_the_others_go_on() {
    let place = Place::new(TWO_SEEDS);
    fs::create_dir_all(place.runs().join("logs")).unwrap();
    std::os::unix::fs::symlink("/nowhere/else", place.runs().join("logs/small-dials-seed2.log")).unwrap();
    let said = text(&place.experiment(&[]).assert().code(1).get_output().stderr);
    assert!(said.contains("small-dials-seed2: error: ") && said.contains("small-dials-seed2.log"), "why: {said}");
    assert!(
        said.contains("error: 1 of 5 failed: small-dials-seed2;") && said.contains("; the others are done"),
        "{said}"
    );
    for run in ["small-dials-seed1", "small-gs-seed1", "small-gs-seed2"] {
        assert!(place.returns(run).contains("\n256,all,"), "{run}");
    }
}

#[test]
fn ctrl_c_after_a_failure_is_told_as_a_stop_and_not_as_if_the_others_were_done() {
    // Too long to end by itself.
    let place = Place::new("seeds = [1, 2]\nset = ['total_steps=7680000']\n[[grid]]\nconfigs = ['small.toml']\n");
    let size = |run: &str| fs::metadata(place.runs().join(run).join("timing.csv")).map_or(0, |file| file.len());
    // Stops the experiment once these runs have written more. Returns what it said.
    let stopped = |runs: &[&str]| {
        let before: Vec<u64> = runs.iter().map(|run| size(run)).collect();
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
        command.current_dir(place.dir.path()).args(["experiment", "e.toml", "--cores", "2"]);
        let experiment = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let begun = Instant::now();
        while runs.iter().zip(&before).any(|(run, &before)| size(run) <= before) {
            assert!(begun.elapsed() < Duration::from_secs(60), "a run does not go on");
            std::thread::sleep(Duration::from_millis(5));
        }
        let pid = experiment.id().to_string();
        assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
        let output = experiment.wait_with_output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(130), "{said}");
        said
    };
    let [spoilt, other] = ["small-dials-seed1", "small-dials-seed2"];
    let said = stopped(&[spoilt, other]);
    assert!(said.contains("\nstopped; resume with: "), "{said}");
    // A run that was stopped is not done.
    let log = fs::read_to_string(place.runs().join("logs/small-dials-seed2.log")).unwrap();
    assert!(log.contains("stopped; kept up to step ") && !log.contains("done in "), "{log}");

    let timing = place.runs().join(spoilt).join("timing.csv");
    let wrong = fs::read_to_string(&timing).unwrap() + "128,all,no number,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1\n";
    fs::write(&timing, wrong).unwrap();
    let said = stopped(&[other]);
    assert!(
        said.contains("\nstopped; 1 of 2 failed: small-dials-seed1; ") && said.contains("; resume with: "),
        "{said}"
    );
    assert!(!said.contains("the others are done"), "{said}");
}

#[test]
fn a_run_that_is_killed_is_told_so_and_not_what_an_earlier_one_said() {
    let place = Place::new("seeds = [1]\nset = ['total_steps=7680']\n[[grid]]\nconfigs = ['small.toml']\n");
    fs::create_dir_all(place.runs().join("logs")).unwrap();
    fs::write(place.runs().join("logs/small-dials-seed1.log"), "error: of an earlier day\n").unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
    command.current_dir(place.dir.path()).args(["experiment", "e.toml"]).stdout(Stdio::null()).stderr(Stdio::piped());
    let experiment = command.spawn().unwrap();
    let begun = Instant::now();
    while !place.runs().join("small-dials-seed1/returns.csv").exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no run began");
        std::thread::sleep(Duration::from_millis(5));
    }
    let children = format!("/proc/{0}/task/{0}/children", experiment.id());
    let run = fs::read_to_string(children).unwrap();
    assert!(std::process::Command::new("kill").args(["-KILL", run.trim()]).status().unwrap().success());
    let said = text(&experiment.wait_with_output().unwrap().stderr);
    assert!(said.contains("small-dials-seed1: signal: 9"), "{said}");
    assert!(!said.contains("an earlier day"), "{said}");
}

#[test]
fn a_controller_that_nobody_knows_is_told_before_anything_begins() {
    let place = Place::new("seeds = [1]\ncontrollers = ['nobody']\n[[grid]]\nconfigs = ['small.toml']\n");
    let said = text(&place.experiment(&["--dry-run"]).assert().code(2).get_output().stderr);
    assert!(said.contains("e.toml: controllers") && said.contains("`nobody`: unknown; one of random"), "{said}");
}

#[test]
fn a_baseline_is_measured_as_the_runs_are_and_again_when_its_plan_has_changed() {
    let place = Place::new(TWO_SEEDS);
    place.experiment(&[]).assert().success();
    let path = place.runs().join("baselines/small-random.json");
    let measured = |key: &str| {
        let object: serde_json::Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
        object[key].clone()
    };
    assert_eq!((measured("scenario"), measured("episodes")), ("warehouse-1-8".into(), 2.into()));
    let more = TWO_SEEDS.replace("controller_episodes = 2", "controller_episodes = 3");
    fs::write(place.dir.path().join("e.toml"), more).unwrap();
    let dry = text(&place.experiment(&["--dry-run"]).assert().success().get_output().stdout);
    assert!(dry.contains("1 to do, 4 finished") && dry.contains("outdated"), "{dry}");
    place.experiment(&[]).assert().success();
    assert_eq!(measured("episodes"), 3);

    // Different runs in another folder, with a longer horizon.
    let longer = TWO_SEEDS.replace("[[grid]]", "set = ['warehouse.horizon=16']\n[[grid]]");
    fs::write(place.dir.path().join("e.toml"), longer).unwrap();
    place.experiment(&["--out", "longer/runs"]).assert().success();
    let longer = place.dir.path().join("longer/runs");
    let baseline = fs::read_to_string(longer.join("baselines/small-random.json")).unwrap();
    assert!(baseline.contains("\"scenario\":\"warehouse-1-16\""), "{baseline}");
    let plan = fs::read_to_string(longer.join("plan.json")).unwrap();
    assert!(plan.contains("\"small-random\""), "{plan}");
}

#[test]
fn a_baseline_is_measured_again_when_the_file_of_its_controller_has_changed() {
    let place = Place::new(
        "seeds = [1]\ncontrollers = ['fixed-time:file=t.toml']\ncontroller_episodes = 1\n\
         [[grid]]\nconfigs = ['traffic.toml']\n",
    );
    let path = |name: &str| place.dir.path().join(name);
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
    let config = format!("[traffic]\nnetwork = '{0}/grid_2x2'\nlocal_network = '{0}/local'\n", nets.display());
    fs::write(path("traffic.toml"), config).unwrap();
    let timings = |green: usize| {
        let text = format!(
            "vertical = {green}\nhorizontal = 10\noffsets = [0, 0, 0, 0]\nearly = 0\nlate = 0\nmean_return = 1.0\n\
             [tuned_on]\ncontroller = 'fixed-time'\nnetwork = 'grid_2x2'\nnetwork_crc32 = '00c0ffee'\nhorizon = 300\n\
             episodes = 1\nseed = '1'\nsearch_version = 1\nsumo_version = 'SUMO 1.15.0'\n"
        );
        fs::write(path("t.toml"), text).unwrap();
    };
    timings(10);
    let mut measure = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    measure.current_dir(place.dir.path()).args(["baseline", "traffic.toml", "--json", "--episodes", "1"]);
    let measured = measure.args(["--controller", "fixed-time:file=t.toml"]).assert().success().get_output().clone();
    let said = text(&measured.stdout);
    let baselines = place.runs().join("baselines");
    fs::create_dir_all(&baselines).unwrap();
    let write = |text: &str| fs::write(baselines.join("traffic-fixed-time:file=t.toml.json"), text).unwrap();
    let assert_stage = |told: &str| {
        let dry = text(&place.experiment(&["--dry-run"]).assert().success().get_output().stdout);
        let line = dry.lines().find(|line| line.starts_with("traffic-fixed-time:file=t.toml")).unwrap_or(&dry);
        assert!(line.contains(told), "{told}: {dry}");
    };
    write(&said);
    assert_stage("finished");
    timings(20);
    assert_stage("outdated");
    timings(10);
    assert_stage("finished");
    let version = serde_json::from_str::<serde_json::Value>(&said).unwrap()["sumo_version"].clone();
    write(&said.replace(version.as_str().unwrap(), "SUMO 1.0.0"));
    assert_stage("outdated");
}

#[test]
fn a_run_with_wrong_rows_is_named_and_resumed_by_the_way_out() {
    let place = Place::new(TWO_SEEDS);
    place.experiment(&[]).assert().success();
    let run = place.runs().join("small-dials-seed1");
    let returns = place.returns("small-dials-seed1");
    for wrong in ["memory.csv", "timing.csv"] {
        let text = fs::read_to_string(run.join(wrong)).unwrap();
        fs::write(run.join(wrong), format!("{text}256,all,no number,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1\n")).unwrap();
    }
    fs::remove_dir_all(place.runs().join("small-gs-seed2")).unwrap();
    let dry = place.experiment(&["--dry-run"]).assert().success().get_output().clone();
    let made = place.experiment(&[]).assert().code(1).get_output().clone();
    for said in [text(&dry.stdout), text(&made.stderr)] {
        let way_out = "try: dials-traffic train --resume results/e/runs/small-dials-seed1; ";
        for part in ["small-dials-seed1: this run cannot be read", "timing.csv: cannot be read", way_out] {
            assert!(said.contains(part), "`{part}` is not in: {said}");
        }
    }
    assert!(text(&made.stderr).contains("error: 1 of 2 failed: small-dials-seed1; "), "{made:?}");
    let log = fs::read_to_string(place.runs().join("logs/small-dials-seed1.log")).unwrap();
    assert!(log.ends_with("and the run is trained again\n"), "{log}");
    assert!(place.returns("small-gs-seed2").contains("\n256,all,"), "the other run was made");
    let mut resume = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    resume.args(["train", "--workers", "0", "--resume"]).arg(&run).assert().success();
    assert_eq!(place.returns("small-dials-seed1"), returns);
    let dry = text(&place.experiment(&["--dry-run"]).assert().success().get_output().stdout);
    assert!(dry.contains("0 to do, 5 finished"), "{dry}");
}

#[test]
fn a_run_that_was_killed_between_its_last_writes_or_in_its_first_ones_is_made_whole() {
    let place = Place::new(
        "seeds = [1]\nset = ['warehouse.agents_per_side=2', 'evaluation.aip_loss_episodes=2']\n[[grid]]\nconfigs = ['small.toml']\n",
    );
    place.experiment(&[]).assert().success();
    let run = place.runs().join("small-dials-seed1");
    let read = |file: &str| fs::read_to_string(run.join(file)).unwrap();
    let cut = |file: &str, lines: usize| {
        let kept: String = read(file).lines().take(lines).map(|line| format!("{line}\n")).collect();
        fs::write(run.join(file), kept).unwrap();
    };
    let files = ["returns.csv", "episodes.csv", "aip_drift.csv", "aip_loss.csv", "training.csv"];
    let whole = files.map(read);
    let times = |text: String| text.lines().count();
    let all_times = times(read("timing.csv"));
    let finish = || {
        let said = text(&place.experiment(&[]).assert().success().get_output().stdout);
        assert!(said.contains("1 done now, 0 done earlier"), "{said}");
        assert!(files.map(read) == whole, "other bytes than at first");
        assert_eq!(times(read("timing.csv")), all_times);
    };
    // A block of times has two lines here: of all workers and of the only one.
    cut("timing.csv", all_times - 2);
    finish();
    cut("timing.csv", all_times - 2);
    cut("aip_drift.csv", whole[2].lines().count() - 1);
    finish();
    cut("episodes.csv", whole[1].lines().count() - 1);
    finish();
    // Only the header, the line of all agents and that of the first agent were written.
    fs::remove_dir_all(run.join("checkpoints")).unwrap();
    for file in ["episodes.csv", "aip_drift.csv", "aip_loss.csv", "training.csv", "timing.csv", "memory.csv"] {
        let _ = fs::remove_file(run.join(file));
    }
    cut("returns.csv", 3);
    finish();
}

#[test]
fn experiments_that_share_a_folder_keep_their_plans() {
    let one = |name: &str, seeds: &str| {
        format!("seeds = {seeds}\n[[grid]]\nconfigs = ['small.toml']\nsimulators = ['gs']\nname = '{name}'\n")
    };
    let place = Place::new(&one("a", "[1, 2]"));
    let write = |text: &str| fs::write(place.dir.path().join("e.toml"), text).unwrap();
    let missing = || {
        let mut report = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
        report.current_dir(place.dir.path()).args(["report", "results/e/runs", "--out", "report", "--force"]);
        let said = text(&report.assert().success().get_output().stderr);
        let lines = said.lines().filter(|line| line.contains("not begun yet"));
        lines.map(|line| line.replace("warning: results/e/runs/", "")).collect::<Vec<_>>()
    };
    place.experiment(&[]).assert().success();
    fs::remove_dir_all(place.runs().join("small-gs-a-seed2")).unwrap();
    fs::write(place.dir.path().join("other.toml"), one("b", "[1]")).unwrap();
    let mut other = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    other.current_dir(place.dir.path()).args(["experiment", "other.toml", "--out", "results/e/runs"]);
    other.assert().success();
    assert_eq!(missing(), ["small-gs-a-seed2: not begun yet"], "the other experiment keeps this plan");
    fs::remove_dir_all(place.runs().join("small-gs-b-seed1")).unwrap();
    write(&one("a", "[1]"));
    place.experiment(&[]).assert().success();
    assert_eq!(missing(), ["small-gs-b-seed1: not begun yet"], "what this one no longer lists is not missing");
    fs::write(place.runs().join("plan.json"), "{").unwrap();
    let said = text(&place.experiment(&[]).assert().code(2).get_output().stderr);
    assert!(
        said.contains("results/e/runs: its plan cannot be read; move plan.json away")
            && said.contains("results/e/runs/plan.json: is not a file"),
        "{said}"
    );
}

#[test]
fn the_folder_of_the_runs_is_not_a_run_and_the_lock_of_another_experiment_is_told() {
    let place = Place::new(TWO_SEEDS);
    place.experiment(&[]).assert().success();
    let said =
        text(&place.experiment(&["--out", "results/e/runs/small-gs-seed1"]).assert().code(2).get_output().stderr);
    assert!(said.contains("small-gs-seed1: is a run directory; name another directory with --out"), "{said}");
    let lock = fs::File::open(place.runs()).unwrap();
    lock.lock().unwrap();
    let said = text(&place.experiment(&[]).assert().code(1).get_output().stderr);
    assert!(said.contains("results/e/runs: another experiment is running here"), "{said}");
}

#[test]
fn another_run_in_the_way_is_left_alone() {
    let place = Place::new(TWO_SEEDS);
    place.experiment(&[]).assert().success();
    let changed = TWO_SEEDS.replace("[[grid]]", "set = ['ppo.clip=0.3']\n[[grid]]");
    fs::write(place.dir.path().join("e.toml"), changed).unwrap();
    let output = place.experiment(&[]).assert().code(2).get_output().clone();
    let said = text(&output.stderr);
    assert!(said.contains("small-dials-seed1: holds a different run than planned"), "{said}");
    assert!(said.contains("ppo.clip: 0.1 there, 0.3 planned"), "{said}");
}

#[test]
fn the_files_of_this_project_are_well_formed() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments");
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "toml"));
    assert!(files.len() >= 8, "{files:?}");
    for file in files {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
        let nowhere = tempfile::tempdir().unwrap();
        command.current_dir(nowhere.path()).arg("experiment").arg(&file).arg("--dry-run");
        let said = text(&command.assert().success().get_output().stdout);
        assert!(said.contains(" to do, 0 finished; about "), "{said}");
    }
}
