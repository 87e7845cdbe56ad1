//! The live view: what it answers, and to whom.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

const CONFIG: &str = "total_steps = 256\n[warehouse]\nagents_per_side = 2\nhorizon = 16\n\
                      [policy]\nhidden = [16]\n[ppo]\nrollout_steps = 8\n\
                      [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 64\nbatch = 16\nepochs = 2\n\
                      [evaluation]\nevery_steps = 128\nepisodes = 2\n";

fn program(folder: &Path, words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
    command.current_dir(folder).args(words).stdin(Stdio::null());
    command
}

/// Trains a run in `out`.
fn train(folder: &Path, out: &str) {
    fs::write(folder.join("c.toml"), CONFIG).unwrap();
    let output = program(folder, &["train", "c.toml", "--out", out, "--workers", "0"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// A live view, which ends with the test.
pub(super) struct View {
    pub(super) child: Child,
    /// Host and port, such as `127.0.0.1:4711`.
    pub(super) host: String,
    /// Path of the page, `/TOKEN/`.
    pub(super) path: String,
}

impl View {
    fn of(folder: &Path, runs: &str) -> View {
        View::with(folder, &["watch", runs])
    }

    fn with(folder: &Path, words: &[&str]) -> View {
        let mut child = program(folder, words).stdout(Stdio::piped()).spawn().unwrap();
        let mut address = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut address).unwrap();
        let (host, path) = parts(address.trim());
        View { child, host, path }
    }

    /// Sends a request and returns the whole answer.
    fn ask(&self, method: &str, path: &str, host: &str) -> String {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        write!(stream, "{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    pub(super) fn get(&self, name: &str) -> String {
        self.ask("GET", &format!("{}{name}", self.path), &self.host)
    }
}

impl Drop for View {
    fn drop(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

/// Splits an address into host and path.
pub(super) fn parts(address: &str) -> (String, String) {
    let rest = address.strip_prefix("http://").unwrap_or_else(|| panic!("`{address}` is an address"));
    let (host, path) = rest.split_once('/').unwrap();
    (host.to_owned(), format!("/{path}"))
}

#[test]
fn a_page_shows_the_runs_of_a_folder_and_those_that_come_later() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("runs")).unwrap();
    train(folder.path(), "runs/first");
    let view = View::of(folder.path(), "runs");
    let shell = view.get("");
    assert!(shell.starts_with("HTTP/1.1 200") && shell.contains("shell.js"), "{shell}");
    assert!(shell.contains("default-src 'none'"), "{shell}");
    assert!(view.get("shell.js").contains("fetch(\"now\")"));
    let now = view.get("now");
    assert!(now.contains("<td>first</td><td>finished</td><td>256 of 256</td>"), "{now}");
    assert!(now.contains("Learning curves") && now.contains("Cross-entropy of the AIPs"), "{now}");
    assert!(now.contains("Final return"), "the run has ended: {now}");
    assert!(!now.contains("<td>second</td>"));
    train(folder.path(), "runs/second");
    assert!(view.get("now").contains("<td>second</td>"));
    for (run, version) in [("first", "SUMO 1.15.0"), ("second", "SUMO 1.28.0")] {
        let file = folder.path().join("runs").join(run).join("run.json");
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.contains("\"sumo\": \"none\""), "{text}");
        fs::write(file, text.replace("\"sumo\": \"none\"", &format!("\"sumo\": \"{version}\""))).unwrap();
    }
    let now = view.get("now");
    assert!(now.contains("several versions of SUMO (1 with SUMO 1.15.0, 1 with SUMO 1.28.0)"), "{now}");
}

/// Returns the files of a run directory with their contents.
fn contents(run: &Path) -> Vec<(String, Vec<u8>)> {
    let files = fs::read_dir(run).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
    let mut files: Vec<_> = files.map(|path| (path.display().to_string(), fs::read(&path).unwrap())).collect();
    files.sort();
    files
}

/// Trains a run of 20 lights in `run`, for five minutes of the town's traffic.
fn train_on_the_town(folder: &Path) {
    let town = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/town/town.sumocfg");
    let config = format!(
        "simulator = 'gs'\ntotal_steps = 120\n[traffic]\nscenario = '{}'\nend_s = 300\n[gs]\ncopies = 1\n\
         [policy]\nhidden = [8]\n[evaluation]\nepisodes = 1\nfinal_episodes = 2\n",
        town.display()
    );
    fs::write(folder.join("town.toml"), config).unwrap();
    let output = program(folder, &["train", "town.toml", "--out", "run", "--workers", "0"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Asks for the page until it has this text.
fn wait_for(view: &View, text: &str) -> String {
    for _ in 0..2400 {
        let now = view.get("now");
        if now.contains(text) {
            return now;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    panic!("`{text}` does not come: {}", view.get("now"));
}

#[test]
fn a_scenario_has_a_map_against_todays_plan_that_names_its_step_and_leaves_the_run_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    train_on_the_town(folder.path());
    let run = folder.path().join("run");
    let before = contents(&run);
    let view = View::of(folder.path(), "run");
    let first = view.get("now");
    assert!(first.contains("newest evaluation: step 120"), "it says what it does: {first}");
    let now = wait_for(&view, "Map of step ");
    assert!(now.contains("Map of step 120, the end of this run: its final policies."), "{now}");
    assert!(now.contains("class=\"map\"") && now.contains("the policies of step 120"), "{now}");
    assert!(!now.contains("every agent at the last evaluation"), "one map is enough: {now}");
    assert_eq!(contents(&run), before);

    let quiet = View::with(folder.path(), &["watch", "run", "--no-map"]);
    let now = quiet.get("now");
    assert!(!now.contains("Map of step") && now.contains("every agent at the last evaluation"), "{now}");
}

#[test]
fn the_map_is_of_the_episodes_that_the_run_was_evaluated_on() {
    let folder = tempfile::tempdir().unwrap();
    train_on_the_town(folder.path());
    let mut player = program(folder.path(), &["map-player", "run"]);
    let mut player = player.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut input = player.stdin.take().unwrap();
    let mut lines = BufReader::new(player.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut ask = |episodes: usize| -> (usize, Value) {
        writeln!(input, "{{\"episodes\": {episodes}}}").unwrap();
        for (played, line) in lines.by_ref().enumerate() {
            let said: Value = serde_json::from_str(&line).unwrap();
            match said.get("City") {
                Some(found) => return (played, found.clone()),
                None => assert!(said.get("Playing").is_some(), "{said}"),
            }
        }
        panic!("it has ended");
    };
    // Two players, two episodes each; the second time today's plan is known.
    let (played, found) = ask(2);
    assert_eq!((played, &found["steps"]), (4, &Value::from(120)));
    assert_eq!(ask(2), (2, found.clone()));
    let mean =
        |player: usize, figure: &str| found["city"]["players"][player]["figures"][figure]["mean"].as_f64().unwrap();
    let returns = fs::read_to_string(folder.path().join("run/returns.csv")).unwrap();
    let last = returns.lines().rfind(|line| line.starts_with("120,all,")).unwrap();
    let evaluated: f64 = last.split(',').nth(2).unwrap().parse().unwrap();
    // The file has four decimals.
    assert!((mean(1, "return") - evaluated).abs() < 6e-5, "{} and {evaluated}", mean(1, "return"));
    let words = ["baseline", "run/config.toml", "--controller", "program", "--episodes", "2", "--json"];
    let output = program(folder.path(), &words).output().unwrap();
    let today: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(today["delay_s"].as_f64(), Some(mean(0, "delay_s")));
    drop(input);
    assert!(player.wait().unwrap().success());
}

#[test]
fn only_browsers_on_this_machine_that_know_the_address_get_an_answer() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("runs")).unwrap();
    let view = View::of(folder.path(), "runs");
    assert!(view.host.starts_with("127.0.0.1:"));
    let other = View::of(folder.path(), "runs");
    assert_ne!(view.path, other.path, "each has a token of its own");
    for path in ["/", "/now", &other.path, &format!("{}../", view.path), &format!("{}run.json", view.path)] {
        assert!(view.ask("GET", path, &view.host).starts_with("HTTP/1.1 404"), "{path}");
    }
    // A page of another site can make a browser send requests here, but under its own name.
    assert!(view.ask("GET", &view.path, "evil.example").starts_with("HTTP/1.1 403"));
    assert!(view.ask("POST", &view.path, &view.host).starts_with("HTTP/1.1 405"));
    // Nothing has been trained there yet.
    assert!(view.get("now").contains("holds no run directory"));
}

/// Begins a training in one process with `--dashboard`, and returns its view and the lines that it prints. The child of
/// this view is the training.
fn begin_with_a_view(folder: &Path) -> (View, impl Iterator<Item = String>) {
    fs::write(folder.join("c.toml"), CONFIG.replace("= 256\n[ware", "= 40_000_000\n[ware")).unwrap();
    let words = ["train", "c.toml", "--out", "run", "--workers", "0", "--dashboard"];
    let mut child = program(folder, &words).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    let line = lines.find(|line| line.contains("watch it at ")).unwrap();
    let (host, path) = parts(line.split_once("watch it at ").unwrap().1);
    (View { child, host, path }, lines)
}

/// Waits until nobody answers there. The system ends a view when its parent has ended, but not at the same moment.
fn wait_until_gone(host: &str) {
    let gone = |_: &i32| {
        TcpStream::connect(host).is_err() || {
            std::thread::sleep(std::time::Duration::from_millis(20));
            false
        }
    };
    assert!((0..3000).any(|attempt| gone(&attempt)), "the view is still there after a minute");
}

#[test]
fn a_view_beside_a_training_ends_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let (mut view, _lines) = begin_with_a_view(folder.path());
    let answer = view.get("now");
    assert!(answer.contains("<td>run</td><td>running</td>"), "{answer}");
    assert!(!answer.to_lowercase().contains("final return"), "nothing is final yet: {answer}");
    view.child.kill().unwrap();
    view.child.wait().unwrap();
    wait_until_gone(&view.host);
    assert!(folder.path().join("run/run.json").is_file());
}

#[test]
fn ctrl_c_ends_a_training_in_one_process_and_its_view_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let (mut view, mut lines) = begin_with_a_view(folder.path());
    lines.find(|line| line.starts_with("step ")).expect("it trains");
    kill_process(Pid::from_child(&view.child), Signal::INT).unwrap();
    let said = lines.collect::<Vec<_>>().join("\n");
    assert_eq!(view.child.wait().unwrap().code(), Some(130), "{said}");
    assert!(said.contains("stopped") && said.contains(" train --resume "), "{said}");
    wait_until_gone(&view.host);
}

#[test]
fn a_folder_that_is_not_there_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let output = program(folder.path(), &["watch", "nothing"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("nothing: no such folder"));
}
