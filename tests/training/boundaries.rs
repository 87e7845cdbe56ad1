//! Training is one stream: evaluations, checkpoints, kills and the number of workers change no bit of what is learned.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// Timesteps of every run here. Copies play 250 of them: four episodes of traffic, five of the warehouse.
const STEPS: u64 = 2_000;

/// Makes a config with a horizon that does not divide any period, and AIPs that are retrained in the middle of an
/// episode.
fn config(domain: &str, recurrent: bool) -> String {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").display().to_string();
    let domain = match domain {
        "traffic" => format!("[traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 63\n"),
        _ => "[warehouse]\nagents_per_side = 2\nhorizon = 47\n".to_owned(),
    };
    let (policy, aip) = if recurrent { ("recurrent = 8\n", "recurrent = 6\n") } else { ("", "") };
    format!(
        "total_steps = {STEPS}\n{domain}\
         [local_simulators]\ncopies = 8\nstagger = true\n\
         [policy]\n{policy}hidden = [16]\n[ppo]\ntime_limit = 'bootstrap'\n\
         [aip]\n{aip}hidden = [8]\nretrain_every_steps = 900\ndataset_steps = 130\nbatch = 2\nepochs = 2\nlearning_rate = 1e-2\n\
         [evaluation]\nepisodes = 2\nfinal_episodes = 2\naip_loss_episodes = 0\n"
    )
}

struct Run {
    dir: tempfile::TempDir,
}

impl Run {
    fn new(config: &str) -> Run {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("config.toml"), config).unwrap();
        Run { dir }
    }

    fn out(&self) -> PathBuf {
        self.dir.path().join("run")
    }

    fn command(&self, simulator: &str, every_steps: u64, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
        command.arg("train").arg(self.dir.path().join("config.toml")).arg("--out").arg(self.out());
        command.args(["--simulator", simulator, "--set", &format!("evaluation.every_steps={every_steps}")]);
        command.args(more).stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    fn train(&self, simulator: &str, every_steps: u64, more: &[&str]) -> Vec<u8> {
        finish(self.command(simulator, every_steps, more));
        self.policies()
    }

    fn policies(&self) -> Vec<u8> {
        fs::read(self.out().join("policies.safetensors")).unwrap()
    }

    fn checkpoints(&self) -> usize {
        fs::read_dir(self.out().join("checkpoints")).map_or(0, |entries| entries.count())
    }
}

fn finish(mut command: Command) {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Asserts equal policies whether a run is evaluated once, or at periods that fit nothing.
/// Returns the policies of the last simulator.
fn assert_that_looking_leaves_no_trace(domain: &str, recurrent: bool, simulators: &[&str]) -> Vec<u8> {
    let config = config(domain, recurrent);
    let mut policies = Vec::new();
    for simulator in simulators {
        let once = Run::new(&config).train(simulator, STEPS, &["--workers", "0"]);
        let often = Run::new(&config).train(simulator, 400, &["--workers", "2"]);
        assert!(once == often, "{domain}, {simulator}, recurrent {recurrent}: evaluated every 400 steps by 2 workers");
        policies = once;
    }
    policies
}

/// Asserts the same for agents with memory, and that checkpoints leave no trace either.
fn assert_that_looking_at_memories_leaves_no_trace(domain: &str) {
    let once = assert_that_looking_leaves_no_trace(domain, true, &["gs", "dials"]);
    let run = || Run::new(&config(domain, true));
    let always = run().train("dials", STEPS, &["--workers", "1", "--set", "checkpoints.every_steps=256"]);
    assert!(once == always, "{domain}: written down at every second update");
    // The test can fail: the file depends on what is learned.
    let other = run().train("dials", STEPS, &["--workers", "0", "--set", "aip.retrain_every_steps=500"]);
    assert!(once != other, "{domain}: F changes what is learned");
}

const SIMULATORS: [&str; 4] = ["gs", "dials", "marginal-dials", "untrained-dials"];

#[test]
fn looking_at_traffic_leaves_no_trace() {
    assert_that_looking_leaves_no_trace("traffic", false, &SIMULATORS);
}

#[test]
fn looking_at_traffic_with_memory_leaves_no_trace() {
    assert_that_looking_at_memories_leaves_no_trace("traffic");
}

#[test]
fn looking_at_the_warehouse_leaves_no_trace() {
    assert_that_looking_leaves_no_trace("warehouse", false, &SIMULATORS);
}

#[test]
fn looking_at_the_warehouse_with_memory_leaves_no_trace() {
    assert_that_looking_at_memories_leaves_no_trace("warehouse");
}

#[test]
fn a_run_that_is_killed_in_the_middle_of_its_episodes_goes_on_as_if_it_had_not_been() {
    for (domain, simulator) in [("traffic", "gs"), ("traffic", "dials")] {
        let config = config(domain, true);
        let undisturbed = Run::new(&config).train(simulator, STEPS, &["--workers", "0"]);
        let run = Run::new(&config);
        let mut killed = run.command(simulator, 400, &["--workers", "2"]).spawn().unwrap();
        while run.checkpoints() == 0 && killed.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(2));
        }
        killed.kill().unwrap();
        killed.wait().unwrap();
        let mut resume = Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
        resume.arg("train").arg("--resume").arg(run.out()).args(["--workers", "1"]);
        finish(resume);
        assert!(run.policies() == undisturbed, "{domain}, {simulator}");
    }
}
