//! The run directory through every accident: two writers, a directory that goes away, links, leftovers, lost bytes.

use std::fs;
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use rustix::fs::{CWD, FileType, mknodat};
use rustix::process::{Pid, Signal, kill_process};

/// A warehouse of four robots with five periods; the AIPs are trained at 0, 256 and 512.
const CONFIG: &str = "total_steps = 640\n[warehouse]\nagents_per_side = 2\nhorizon = 16\n\
                      [policy]\nhidden = [16]\n[ppo]\nrollout_steps = 8\n\
                      [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 64\nbatch = 16\nepochs = 2\n\
                      [evaluation]\nevery_steps = 128\nepisodes = 2\n";
const RESULTS: [&str; 6] =
    ["returns.csv", "episodes.csv", "training.csv", "aip_loss.csv", "policies.safetensors", "aips.safetensors"];
/// Time limit. However slow the machine is, a wait that lasts longer will never end.
const FOR_EVER: Duration = Duration::from_secs(60);

struct Place {
    dir: tempfile::TempDir,
}

impl Place {
    fn new() -> Place {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("c.toml"), CONFIG).unwrap();
        // Goes on until it is killed.
        fs::write(dir.path().join("long.toml"), CONFIG.replace("640", "40_000_000")).unwrap();
        Place { dir }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
        command.current_dir(self.dir.path()).args(words).stdin(Stdio::null());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Starts a training of `config` in `out` and waits for its first checkpoint.
    fn start(&self, config: &str, out: &str) -> Training {
        let command = &mut self.command(&["train", config, "--out", out, "--workers", "0"]);
        let training = Training(Some(command.spawn().unwrap()));
        wait_until(|| fs::read_dir(self.path(out).join("checkpoints")).is_ok_and(|mut found| found.next().is_some()));
        training
    }

    /// Makes a whole run called `run`.
    fn train(&self) -> PathBuf {
        succeed(self.command(&["train", "c.toml", "--out", "run", "--workers", "0"]));
        self.path("run")
    }

    fn resume(&self, workers: &str) -> Command {
        self.command(&["train", "--resume", "run", "--workers", workers])
    }
}

/// A training under way. Dropping it kills it.
struct Training(Option<Child>);

impl Training {
    fn goes_on(&mut self) -> bool {
        self.0.as_mut().is_some_and(|child| child.try_wait().unwrap().is_none())
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(self.0.as_ref().unwrap()), signal).unwrap();
    }

    fn ended(mut self) -> Output {
        wait_until(|| !self.goes_on());
        self.0.take().unwrap().wait_with_output().unwrap()
    }
}

impl Drop for Training {
    fn drop(&mut self) {
        if let Some(mut child) = self.0.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn wait_until(mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < FOR_EVER, "waited for ever");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn run(mut command: Command) -> Output {
    Training(Some(command.spawn().unwrap())).ended()
}

fn succeed(command: Command) -> String {
    let output = run(command);
    assert!(output.status.success(), "{}", said(&output));
    said(&output)
}

/// Returns the error of a command that must fail with this exit code.
fn fail(command: Command, code: i32) -> String {
    let output = run(command);
    assert_eq!(output.status.code(), Some(code), "{}", said(&output));
    said(&output)
}

fn names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn results(run: &Path) -> Vec<Vec<u8>> {
    RESULTS.iter().map(|file| fs::read(run.join(file)).unwrap()).collect()
}

/// Asserts that the files of a run are those of a run that nothing disturbed.
fn assert_undisturbed(run: &Path) {
    static UNDISTURBED: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    let undisturbed = UNDISTURBED.get_or_init(|| results(&Place::new().train()));
    for ((file, here), there) in RESULTS.iter().zip(results(run)).zip(undisturbed) {
        assert!(here == *there, "{file} differs from that of an undisturbed run");
    }
}

#[test]
fn every_step_has_one_evaluation_wherever_a_run_ends() {
    let place = Place::new();
    // An update takes 128 steps. At step 192, where the next evaluation would be, training is at 256 already.
    let sets = ["--set", "evaluation.every_steps=192", "--steps", "200"];
    let words = [&["train", "c.toml", "--out", "run", "--workers", "0"][..], &sets].concat();
    succeed(place.command(&words));
    for file in ["returns.csv", "training.csv"] {
        let text = fs::read_to_string(place.path("run").join(file)).unwrap();
        let steps: Vec<&str> =
            text.lines().filter_map(|line| line.split_once(",all,").map(|(steps, _)| steps)).collect();
        let expected = if file == "returns.csv" { &["0", "256"][..] } else { &["256"] };
        assert_eq!(steps, expected, "{file}");
    }
    succeed(place.command(&["report", "run"]));
}

fn all_of(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
}

#[test]
fn a_run_that_another_process_trains_is_not_moved_aside() {
    let place = Place::new();
    place.train();
    fs::create_dir(place.path("all")).unwrap();
    let mut training = place.start("long.toml", "all/busy");
    for words in [
        &["train", "c.toml", "--out", "all/busy", "--force", "--workers", "0"][..],
        // It is within the directory to be moved.
        &["report", "run", "--out", "all", "--force"],
    ] {
        let said = fail(place.command(words), 1);
        all_of(&said, &["all/busy: another process is writing this run; wait until it has ended"]);
    }
    let said = fail(place.command(&["report", "run", "--out", "all/busy", "--force"]), 2);
    all_of(&said, &["all/busy: is a run directory"]);
    let said = fail(place.command(&["train", "--resume", "all/busy"]), 1);
    all_of(&said, &["all/busy: another process is writing this run; wait until it has ended"]);
    assert!(training.goes_on());
    assert_eq!(names(&place.path("all")), ["busy"]);
    assert_eq!(names(place.dir.path()), ["all", "c.toml", "long.toml", "run"]);
}

#[test]
fn an_experiment_names_the_run_that_another_process_trains() {
    let place = Place::new();
    let file = "seeds = [1]\n[[grid]]\nconfigs = ['long.toml']\nsimulators = ['dials']\n";
    fs::write(place.path("e.toml"), file).unwrap();
    fs::create_dir(place.path("out")).unwrap();
    let mut training = place.start("long.toml", "out/long-dials-seed1");
    let said = fail(place.command(&["experiment", "e.toml", "--out", "out"]), 1);
    all_of(&said, &["out/long-dials-seed1: another process is writing this run; wait until it has ended"]);
    assert!(training.goes_on());
}

#[test]
fn an_experiment_writes_no_log_through_a_link() {
    let place = Place::new();
    let file = "seeds = [1]\n[[grid]]\nconfigs = ['c.toml']\nsimulators = ['dials']\n";
    fs::write(place.path("e.toml"), file).unwrap();
    fs::create_dir_all(place.path("out/logs")).unwrap();
    fs::write(place.path("outside"), "precious\n").unwrap();
    symlink(place.path("outside"), place.path("out/logs/c-dials-seed1.log")).unwrap();
    let said = fail(place.command(&["experiment", "e.toml", "--out", "out"]), 1);
    all_of(&said, &["out/logs/c-dials-seed1.log: is a link", "move it away"]);
    assert_eq!(fs::read(place.path("outside")).unwrap(), b"precious\n");
}

#[test]
fn an_experiment_writes_no_baseline_through_a_link() {
    let place = Place::new();
    let file = "seeds = [1]\ncontrollers = ['random']\ncontroller_episodes = 1\n\
                [[grid]]\nconfigs = ['c.toml']\nsimulators = ['dials']\n";
    fs::write(place.path("e.toml"), file).unwrap();
    fs::create_dir(place.path("out")).unwrap();
    fs::create_dir(place.path("theirs")).unwrap();
    for name in ["c-random.json", "c-random.toml", "c-random.part"] {
        fs::write(place.path("theirs").join(name), "precious").unwrap();
    }
    symlink(place.path("theirs"), place.path("out/baselines")).unwrap();
    let said = fail(place.command(&["experiment", "e.toml", "--out", "out"]), 1);
    all_of(&said, &["out/baselines: is a link", "move it away"]);
    for name in names(&place.path("theirs")) {
        assert_eq!(fs::read(place.path("theirs").join(&name)).unwrap(), b"precious", "{name}");
    }
    assert_eq!(names(&place.path("theirs")).len(), 3);
}

#[test]
fn no_option_writes_over_the_files_of_a_run() {
    let place = Place::new();
    let run = place.train();
    let before = names(&run);
    for (words, told) in [
        (&["nets", "local", "--out", "run/networks"][..], "run/networks: --out must not write here"),
        (&["nets", "local", "--out", "run/checkpoints/x"], "run/checkpoints/x: --out must not write here"),
        (&["evaluate", "run", "--episodes", "1", "--csv", "run"], "run/episodes.csv: --csv must not write here"),
        (&["evaluate", "run", "--render", "run/checkpoints/x"], "run/checkpoints/x: --render must not write here"),
        (&["report", "run", "--out", "run", "--force"], "run: is a run directory; name another directory with --out"),
        (&["report", "run", "--out", "run/run.json", "--force"], "run/run.json: --out must not write here"),
        (&["train", "c.toml", "--out", "run/checkpoints/x"], "run/checkpoints/x: --out must not write here"),
        (&["experiment", "e.toml", "--out", "run/networks"], "run/networks: --out must not write here"),
    ] {
        fs::write(place.path("e.toml"), "seeds = [1]\n[[grid]]\nconfigs = ['c.toml']\nsimulators = ['gs']\n").unwrap();
        all_of(&fail(place.command(words), 2), &[told]);
        assert_eq!(names(&run), before, "{words:?}");
    }
    // New names beside those of the run are free.
    succeed(place.command(&["report", "run", "--out", "run/report"]));
    succeed(place.resume("0"));
    assert_undisturbed(&run);
}

#[test]
fn a_run_that_is_evaluated_while_it_is_trained_says_so() {
    let place = Place::new();
    let mut training = place.start("long.toml", "busy");
    let said = succeed(place.command(&["evaluate", "busy", "--episodes", "1"]));
    let line = said.lines().find(|line| line.contains("still being trained")).unwrap_or_else(|| panic!("{said}"));
    all_of(line, &["busy: ", "its policies are those of step "]);
    assert!(training.goes_on(), "reading disturbs nobody");
    drop(training);
    let said = succeed(place.command(&["evaluate", "busy", "--episodes", "1"]));
    assert!(!said.contains("still being trained"), "{said}");
}

#[test]
fn a_run_directory_that_is_removed_while_it_is_written_is_an_error() {
    let place = Place::new();
    let training = place.start("long.toml", "run");
    // Otherwise it might write into the directory while files are removed one by one.
    training.signal(Signal::STOP);
    fs::remove_dir_all(place.path("run")).unwrap();
    training.signal(Signal::CONT);
    let output = training.ended();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    all_of(&said(&output), &["run: was removed while this run was written"]);
    assert!(!said(&output).contains("resume with") && output.stdout.is_empty(), "{}", said(&output));
}

#[test]
fn a_run_directory_that_is_moved_while_it_is_written_loses_nothing() {
    let place = Place::new();
    fs::write(place.path("c.toml"), CONFIG.replace("640", "6_400")).unwrap();
    let training = place.start("c.toml", "run");
    fs::rename(place.path("run"), place.path("elsewhere")).unwrap();
    let output = training.ended();
    let there = place.path("elsewhere").canonicalize().unwrap().display().to_string();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    all_of(&said(&output), &[&format!("run: was moved to {there}"), &format!("train --resume {there}")]);
    assert!(output.stdout.is_empty() && !place.path("run").exists());
    succeed(place.command(&["train", "--resume", "elsewhere", "--workers", "0"]));
    place.train();
    assert!(results(&place.path("elsewhere")) == results(&place.path("run")));
}

#[test]
fn runs_that_are_started_at_once_take_numbers_of_their_own() {
    let place = Place::new();
    let start = |_| Training(Some(place.command(&["train", "c.toml", "--workers", "0"]).spawn().unwrap()));
    let started: Vec<Training> = (0..4).map(start).collect();
    for training in started {
        let output = training.ended();
        assert!(output.status.success(), "{}", said(&output));
    }
    let runs = ["c-dials-seed1", "c-dials-seed1-2", "c-dials-seed1-3", "c-dials-seed1-4"];
    assert_eq!(names(&place.path("runs")), runs);
    runs.iter().for_each(|run| assert_undisturbed(&place.path("runs").join(run)));
}

/// Puts something else than a file of its own into the place of a file. `outside`: a file of somebody else.
type Put = fn(outside: &Path, place: &Path);

const STRANGE: [(&str, Put); 3] = [
    ("is a link", |outside, place| symlink(outside, place).unwrap()),
    ("has 2 names", |outside, place| fs::hard_link(outside, place).unwrap()),
    ("is not a regular file", |_, place| mknodat(CWD, place, FileType::Fifo, 0o600.into(), 0).unwrap()),
];

#[test]
fn nothing_is_written_through_a_link() {
    let place = Place::new();
    let run = place.train();
    // Without its last times it has not ended.
    let times = fs::read_to_string(run.join("timing.csv")).unwrap();
    fs::write(run.join("timing.csv"), &times[..=times.rfind("\n640,all,").unwrap()]).unwrap();
    for file in ["returns.csv", "timing.csv", "policies.safetensors", "aips.safetensors", "worker_0.log"] {
        for (what, put) in STRANGE {
            let (outside, here) = (place.path("outside"), run.join(file));
            fs::write(&outside, "precious\n").unwrap();
            let kept = fs::read(&here).ok();
            let _ = fs::remove_file(&here);
            put(&outside, &here);
            let said = fail(place.resume("1"), 1);
            all_of(&said, &[&format!("run/{file}: {what}"), "move it away"]);
            assert_eq!(fs::read(&outside).unwrap(), b"precious\n", "{file} {what}");
            fs::remove_file(&here).unwrap();
            kept.iter().for_each(|bytes| fs::write(&here, bytes).unwrap());
        }
    }
    succeed(place.resume("1"));
    assert_undisturbed(&run);
}

#[test]
fn checkpoints_of_somebody_else_are_not_removed_through_a_link() {
    let place = Place::new();
    let run = place.train();
    fs::rename(run.join("checkpoints"), place.path("theirs")).unwrap();
    for name in ["a.safetensors", "b.safetensors", "step_000000000001.safetensors"] {
        fs::write(place.path("theirs").join(name), "precious").unwrap();
    }
    let before = names(&place.path("theirs"));
    symlink(place.path("theirs"), run.join("checkpoints")).unwrap();
    let said = fail(place.resume("0"), 1);
    all_of(&said, &["run/checkpoints: is a link", "move it away"]);
    assert_eq!(names(&place.path("theirs")), before);

    // A checkpoint that is a link is not one either.
    fs::remove_file(run.join("checkpoints")).unwrap();
    fs::create_dir(run.join("checkpoints")).unwrap();
    let name = "step_000000000640.safetensors";
    symlink(place.path("theirs").join(name), run.join("checkpoints").join(name)).unwrap();
    let said = fail(place.resume("0"), 1);
    all_of(&said, &[&format!("run/checkpoints/{name}: is a link")]);
}

#[test]
fn what_killed_writes_left_behind_is_swept_and_nothing_else() {
    let place = Place::new();
    let run = place.train();
    // A kill after the newest checkpoint was written leaves the oldest one, which is the fourth.
    assert_eq!(fs::read_dir(run.join("checkpoints")).unwrap().count(), 3);
    let oldest = "run/checkpoints/step_000000000001.safetensors";
    let theirs = ["run/.dials-traffic-new-notes", "run/checkpoints/best.txt", "run/notes.txt"];
    theirs.iter().chain([&oldest]).for_each(|name| fs::write(place.path(name), "x").unwrap());
    let folders = ["run/.dials-traffic-new-d4E5f6", "run/checkpoints/.dials-traffic-new-d4E5f6"];
    folders.iter().for_each(|name| {
        fs::create_dir(place.path(name)).unwrap();
        fs::write(place.path(name).join("policies.safetensors"), "x").unwrap();
    });
    succeed(place.resume("0"));
    folders.iter().chain([&oldest]).for_each(|name| assert!(!place.path(name).exists(), "{name}"));
    theirs.iter().for_each(|name| assert_eq!(fs::read(place.path(name)).unwrap(), b"x", "{name}"));
    assert_undisturbed(&run);
}

#[test]
fn directories_of_killed_starts_are_swept_but_those_in_use_and_those_of_others_stay() {
    let place = Place::new();
    let [killed, in_use, theirs] = ["a1B2c3", "d4E5f6", "notes"].map(|end| format!(".dials-traffic-new-{end}"));
    for name in [&killed, &in_use, &theirs] {
        fs::create_dir_all(place.path(name).join("networks")).unwrap();
        fs::write(place.path(name).join("networks/a"), "x").unwrap();
    }
    let lock = fs::File::open(place.path(&in_use)).unwrap();
    lock.try_lock().unwrap();
    let link = ".dials-traffic-new-aaaaaa";
    symlink(&theirs, place.path(link)).unwrap();
    place.train();
    assert!(!place.path(&killed).exists(), "nobody holds its lock");
    for name in [&in_use, &theirs] {
        assert_eq!(fs::read(place.path(name).join("networks/a")).unwrap(), b"x", "{name}");
    }
    assert!(place.path(link).symlink_metadata().unwrap().is_symlink());
}

/// Returns the file without everything from the first line that begins with `steps`.
fn without(file: &Path, steps: &str) -> Vec<u8> {
    let text = fs::read_to_string(file).unwrap();
    let end = text.find(&format!("\n{steps},")).unwrap() + 1;
    text.as_bytes()[..end].to_vec()
}

#[test]
fn a_run_whose_files_lost_bytes_goes_back_to_the_checkpoint_that_fits() {
    let whole = Place::new();
    whole.train();
    type Harm = fn(&Path) -> Vec<u8>;
    let cut: Harm = |file| without(file, "512");
    let torn: Harm = |file| {
        let bytes = without(file, "640");
        bytes[..bytes.len() - 3].to_vec()
    };
    let edited: Harm = |file| {
        let mut bytes = fs::read(file).unwrap();
        let at = without(file, "512").len() + "512,all,".len();
        bytes[at] = if bytes[at] == b'7' { b'8' } else { b'7' };
        bytes
    };
    for (file, harm, what, from) in [
        ("returns.csv", cut, "lost ", "512"),
        ("training.csv", torn, "lost ", "384"),
        ("training.csv", edited, "was changed", "384"),
        ("aip_loss.csv", edited, "was changed", "512"),
        ("timing.csv", cut, "lost ", "384"),
    ] {
        let place = Place::new();
        copy(&whole.path("run"), &place.path("run"));
        let file = place.path("run").join(file);
        let harmed = harm(&file);
        fs::write(&file, harmed).unwrap();
        let said = succeed(place.resume("0"));
        let name = format!("run/{}", file.file_name().unwrap().display());
        let line = said.lines().find(|line| line.contains(&name)).unwrap_or_else(|| panic!("{name} is not in: {said}"));
        all_of(line, &["warning: ", what, &format!("goes on from step {from}")]);
        assert_undisturbed(&place.path("run"));
        assert_eq!(names(&place.path("run/checkpoints")).len(), 3);
    }
}

#[test]
fn without_a_checkpoint_that_fits_the_way_out_works() {
    let place = Place::new();
    let run = place.train();
    fs::remove_file(run.join("returns.csv")).unwrap();
    let before: Vec<Vec<u8>> =
        ["training.csv", "policies.safetensors"].map(|file| fs::read(run.join(file)).unwrap()).into();
    let said = fail(place.resume("0"), 1);
    all_of(&said, &["run/returns.csv: is missing", "none of the 3 checkpoints fits", "run/config.toml", "--force"]);
    let after: Vec<Vec<u8>> =
        ["training.csv", "policies.safetensors"].map(|file| fs::read(run.join(file)).unwrap()).into();
    assert!(before == after && names(&run.join("checkpoints")).len() == 3, "nothing was changed");
    succeed(place.command(&["train", "run/config.toml", "--out", "run", "--force", "--workers", "0"]));
    assert_undisturbed(&run);
}

#[test]
fn results_without_any_checkpoint_are_not_thrown_away() {
    let place = Place::new();
    let run = place.train();
    for checkpoint in names(&run.join("checkpoints")) {
        fs::remove_file(run.join("checkpoints").join(checkpoint)).unwrap();
    }
    let before = fs::read(run.join("returns.csv")).unwrap();
    let said = fail(place.resume("0"), 1);
    all_of(&said, &["run: has results, but no checkpoint any more", "--force"]);
    assert!(fs::read(run.join("returns.csv")).unwrap() == before, "nothing was changed");
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let (path, to) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &to);
        } else {
            fs::copy(&path, &to).unwrap();
        }
    }
}

#[test]
fn what_local_simulators_are_made_from_is_kept_and_used_again() {
    let place = Place::new();
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/town/town.sumocfg");
    let settings = [
        "traffic.end_s=300",
        "total_steps=480",
        "ppo.memory=120",
        "ppo.rollout_steps=60",
        "ppo.minibatch=20",
        "policy.hidden=[16]",
        "aip.dataset_steps=120",
        "aip.batch=20",
        "evaluation.every_steps=240",
        "evaluation.episodes=1",
        "evaluation.final_episodes=1",
    ];
    let sets: Vec<&str> = settings.iter().flat_map(|setting| ["--set", *setting]).collect();
    let words = ["train", scenario.to_str().unwrap(), "--simulator", "marginal-dials", "--workers", "0", "--out"];
    succeed(place.command(&[&words[..], &["whole"], &sets].concat()));
    succeed(place.command(&[&words[..], &["run", "--steps", "240"], &sets].concat()));
    let kept = place.path("run/local_simulators.bin");
    let read = || (fs::read(&kept).unwrap(), fs::metadata(&kept).unwrap().ino());
    let (bytes, inode) = read();
    assert!(bytes == fs::read(place.path("whole/local_simulators.bin")).unwrap());
    copy(&place.path("run"), &place.path("damaged"));
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 2] ^= 1;
    fs::write(place.path("damaged/local_simulators.bin"), damaged).unwrap();
    for run in ["run", "damaged"] {
        succeed(place.command(&["train", "--resume", run, "--steps", "480", "--workers", "1"]));
        for file in ["policies.safetensors", "returns.csv", "local_simulators.bin"] {
            let [here, there] = [run, "whole"].map(|run| fs::read(place.path(run).join(file)).unwrap());
            assert!(here == there, "{run}/{file}");
        }
    }
    assert_eq!(read().1, inode, "what is kept is used again");
}
