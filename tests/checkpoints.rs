//! What a resume accepts: checkpoints of this run alone, and only those changes of the config that training cannot see.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;

/// A warehouse of four robots, five updates. The horizon divides no period, so checkpoints lie within episodes.
const WAREHOUSE: &str = "total_steps = 640\n[warehouse]\nagents_per_side = 2\nhorizon = 23\n\
                         [local_simulators]\ncopies = 4\nstagger = true\n[policy]\nrecurrent = 5\nhidden = [6]\n\
                         [ppo]\nrollout_steps = 8\n\
                         [aip]\nhidden = [7]\nretrain_every_steps = 300\ndataset_steps = 64\nbatch = 16\nepochs = 2\n\
                         [evaluation]\nevery_steps = 256\nepisodes = 2\nfinal_episodes = 3\n\
                         [checkpoints]\nevery_steps = 128\n";

fn traffic() -> String {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").display().to_string();
    format!(
        "total_steps = 256\n[traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 20\n\
         [local_simulators]\ncopies = 4\n[policy]\nhidden = [6]\n\
         [aip]\nhidden = [7]\nretrain_every_steps = 256\ndataset_steps = 40\nbatch = 8\nepochs = 1\n\
         [evaluation]\nevery_steps = 128\nepisodes = 1\nfinal_episodes = 1\n"
    )
}

struct Place {
    dir: tempfile::TempDir,
}

impl Place {
    fn new(config: &str) -> Place {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("c.toml"), config).unwrap();
        Place { dir }
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
        command.current_dir(self.dir.path()).args(words);
        command
    }

    fn train(&self, out: &str, more: &[&str]) -> PathBuf {
        self.command(&["train", "c.toml", "--out", out, "--workers", "0"]).args(more).assert().success();
        self.dir.path().join(out)
    }

    fn resume(&self, run: &str) -> Command {
        self.command(&["train", "--resume", run, "--workers", "0"])
    }
}

/// Replaces a line of the config in a run directory.
fn edit(run: &Path, from: &str, to: &str) {
    let path = run.join("config.toml");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "`{from}` is not in {text}");
    fs::write(&path, text.replacen(from, to, 1)).unwrap();
}

/// Returns all files of a run directory with their contents.
fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(contents(&path));
        } else {
            files.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    files
}

fn policies(run: &Path) -> Vec<u8> {
    fs::read(run.join("policies.safetensors")).unwrap()
}

fn checkpoint(run: &Path, steps: u64) -> PathBuf {
    run.join(format!("checkpoints/step_{steps:012}.safetensors"))
}

/// Asserts that a resume ends with this exit code, says all of this, and changes no file.
fn assert_refused(place: &Place, run: &str, code: i32, parts: &[&str]) {
    let dir = place.dir.path().join(run);
    let before = contents(&dir);
    let output = place.resume(run).assert().code(code).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.starts_with("error: ") && !said.contains("panicked"), "{said}");
    parts.iter().for_each(|part| assert!(said.contains(part), "`{part}` is not in: {said}"));
    let after = contents(&dir);
    assert!(before == after, "files were changed: {:?} {:?}", before.keys(), after.keys());
}

#[test]
fn only_names_that_this_program_gives_count_as_checkpoints() {
    let place = Place::new(WAREHOUSE);
    let undisturbed = policies(&place.train("whole", &[]));
    let run = place.train("run", &["--steps", "128"]);
    let strangers = ["best", "step_old_copy", "step_00000000064", "step_0000000000999", "step_00000000999x"]
        .map(|name| run.join(format!("checkpoints/{name}.safetensors")));
    strangers.iter().for_each(|path| fs::write(path, "mine").unwrap());
    edit(&run, "stop_at_steps = 128\n", "");
    place.resume("run").assert().success();
    assert!(policies(&run) == undisturbed);
    strangers.iter().for_each(|path| assert_eq!(fs::read(path).unwrap(), b"mine", "{}", path.display()));
    let ours = fs::read_dir(run.join("checkpoints")).unwrap().count() - strangers.len();
    assert_eq!(ours, 3, "the newest three are kept");
}

#[test]
fn a_key_that_determines_training_cannot_change_on_resume() {
    let place = Place::new(WAREHOUSE);
    let run = place.train("run", &["--steps", "128"]);
    let original = fs::read_to_string(run.join("config.toml")).unwrap();
    for (from, to, told) in [
        ("seed = 1", "seed = 2", "seed: 1 there, 2 here"),
        ("total_steps = 640", "total_steps = 1280", "total_steps: 640 there, 1280 here"),
        ("agents_per_side = 2", "agents_per_side = 3", "warehouse.agents_per_side: 2 there, 3 here"),
        ("horizon = 23", "horizon = 22", "warehouse.horizon: 23 there, 22 here"),
        ("hidden = [6]", "hidden = [5]", "policy.hidden: [6] there, [5] here"),
        ("recurrent = 5\n", "", "policy.recurrent: 5 there, not set here"),
        ("hidden = [7]", "hidden = [8]", "aip.hidden: [7] there, [8] here"),
        ("copies = 4", "copies = 2", "local_simulators.copies: 4 there, 2 here"),
        ("simulator = \"dials\"", "simulator = \"gs\"", "simulator: \"dials\" there, \"gs\" here"),
        ("clip = 0.1", "clip = 0.2", "ppo.clip: 0.1 there, 0.2 here"),
    ] {
        edit(&run, from, to);
        assert_refused(&place, "run", 2, &[told, "step_000000000128.safetensors", "begin a new run"]);
        fs::write(run.join("config.toml"), &original).unwrap();
    }
    edit(&run, "stop_at_steps = 128", "stop_at_steps = 100");
    assert_refused(&place, "run", 2, &["stop_at_steps = 100", "128"]);
}

#[test]
fn networks_that_were_edited_after_the_checkpoint_are_noticed() {
    let place = Place::new(&traffic());
    let run = place.train("run", &["--steps", "128"]);
    edit(&run, "stop_at_steps = 128\n", "");
    for (file, key) in
        [("global.rou.xml", "scenario.checksum"), ("local.net.xml", "scenario.files.traffic.local_network")]
    {
        let path = run.join("networks").join(file);
        let original = fs::read(&path).unwrap();
        fs::write(&path, [&original[..], b"<!-- edited -->\n"].concat()).unwrap();
        assert_refused(&place, "run", 2, &[key, " there, ", "begin a new run"]);
        fs::write(&path, original).unwrap();
    }
    place.resume("run").assert().success();
}

#[test]
fn a_checkpoint_of_another_run_is_not_resumed_from() {
    let place = Place::new(WAREHOUSE);
    let run = place.train("run", &["--steps", "128"]);
    for (out, setting, told) in [
        ("seed", "seed=7", "seed: 7 there, 1 here"),
        ("agents", "warehouse.agents_per_side=3", "warehouse.agents_per_side: 3 there, 2 here"),
        ("wide", "policy.hidden=[9]", "policy.hidden: [9] there, [6] here"),
    ] {
        let other = place.train(out, &["--steps", "256", "--set", setting]);
        fs::copy(checkpoint(&other, 256), checkpoint(&run, 256)).unwrap();
        assert_refused(&place, "run", 2, &["step_000000000256.safetensors", told]);
        fs::remove_file(checkpoint(&run, 256)).unwrap();
    }
    fs::rename(checkpoint(&run, 128), checkpoint(&run, 512)).unwrap();
    assert_refused(&place, "run", 1, &["step_000000000512.safetensors", "128"]);
}

#[test]
fn what_training_cannot_see_may_change_on_resume() {
    let place = Place::new(WAREHOUSE);
    let undisturbed = policies(&place.train("whole", &[]));
    for (index, (from, to)) in [
        ("stop_at_steps = 150\n", "stop_at_steps = 640\n"),
        ("[evaluation]\nevery_steps = 256", "[evaluation]\nevery_steps = 170"),
        ("\nepisodes = 2", "\nepisodes = 1"),
        ("final_episodes = 3", "final_episodes = 1"),
        ("aip_loss_episodes = 0", "aip_loss_episodes = 1"),
        ("[checkpoints]\nevery_steps = 128", "[checkpoints]\nevery_steps = 200"),
        ("[checkpoints]\nevery_steps = 128", "[checkpoints]"),
        ("tensorboard = false", "tensorboard = true"),
    ]
    .into_iter()
    .enumerate()
    {
        let out = format!("run{index}");
        let run = place.train(&out, &["--steps", "150"]);
        edit(&run, from, to);
        if index > 0 {
            edit(&run, "stop_at_steps = 150\n", "");
        }
        place.resume(&out).assert().success();
        assert!(policies(&run) == undisturbed, "{from} -> {to}");
        let returns = fs::read_to_string(run.join("returns.csv")).unwrap();
        let mut steps: Vec<&str> = returns.lines().filter_map(|line| line.strip_suffix("")?.split_once(",all,")).map(|(steps, _)| steps).collect();
        let all = steps.len();
        steps.dedup();
        assert_eq!(steps.len(), all, "no step is evaluated twice: {steps:?}");
    }
}
