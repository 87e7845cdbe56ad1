//! Worker processes: the same numbers for any fleet, and through every fault.

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

const RESULTS: [&str; 6] =
    ["returns.csv", "aip_loss.csv", "aip_drift.csv", "training.csv", "policies.safetensors", "aips.safetensors"];
/// Time after which another signal counts as a second one.
const LONGER_THAN_ONE_SIGNAL: Duration = Duration::from_millis(2100);
/// Time limit. However slow the machine is, a wait that lasts longer will never end.
const FOR_EVER: Duration = Duration::from_secs(120);

#[derive(Clone, Copy)]
enum Domain {
    Traffic,
    /// The warehouse, with recurrent policies and AIPs.
    Warehouse,
}

/// Writes a config of three periods of about half a second, with an AIP training before the first and the last.
fn write_config(dir: &Path, domain: Domain) -> PathBuf {
    let text = match domain {
        Domain::Traffic => traffic_config(),
        Domain::Warehouse => WAREHOUSE_CONFIG.to_owned(),
    };
    let path = dir.join("fleet.toml");
    fs::write(&path, text).unwrap();
    path
}

const WAREHOUSE_CONFIG: &str = "total_steps = 4_500\n\
    [warehouse]\nagents_per_side = 2\nhorizon = 50\n\
    [local_simulators]\ncopies = 8\nstagger = true\n[policy]\nrecurrent = 24\nhidden = [16]\nsequence_length = 8\n\
    [ppo]\nrollout_steps = 8\ntime_limit = 'bootstrap'\n\
    [aip]\nrecurrent = 8\nhidden = [8]\nretrain_every_steps = 3_000\ndataset_steps = 500\nbatch = 4\nepochs = 5\n\
    [evaluation]\nevery_steps = 1_500\nepisodes = 5\nfinal_episodes = 5\naip_loss_episodes = 4\n";

fn traffic_config() -> String {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").display().to_string();
    format!(
        "total_steps = 3_000\n\
         [traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 60\n\
         [local_simulators]\ncopies = 8\nstagger = true\n[policy]\nhidden = [32, 16]\n\
         [ppo]\ntime_limit = 'bootstrap'\n\
         [aip]\nhidden = [8]\nretrain_every_steps = 2_000\ndataset_steps = 300\nbatch = 32\nepochs = 2\n\
         [evaluation]\nevery_steps = 1_000\nepisodes = 5\nfinal_episodes = 5\naip_loss_episodes = 4\n"
    )
}

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_dials-traffic"))
}

struct Run {
    _dir: tempfile::TempDir,
    config: PathBuf,
    out: PathBuf,
}

impl Run {
    fn new() -> Run {
        Run::of(Domain::Traffic)
    }

    fn of(domain: Domain) -> Run {
        let dir = tempfile::tempdir().unwrap();
        Run { config: write_config(dir.path(), domain), out: dir.path().join("run"), _dir: dir }
    }

    fn start(&self, more: &[&str]) -> Child {
        let mut command = program();
        command.arg("train").arg(&self.config).arg("--out").arg(&self.out).args(more);
        command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    }

    fn resume(&self, more: &[&str]) -> (ExitStatus, String) {
        let mut command = program();
        command.arg("train").arg("--resume").arg(&self.out).args(more);
        ended(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap())
    }

    fn train(&self, more: &[&str]) {
        let (status, said) = ended(self.start(more));
        assert!(status.success(), "{said}");
    }

    fn results(&self) -> Vec<Vec<u8>> {
        RESULTS.iter().map(|file| fs::read(self.out.join(file)).unwrap()).collect()
    }

    fn assert_undisturbed(&self) {
        for ((file, mine), undisturbed) in RESULTS.iter().zip(self.results()).zip(undisturbed()) {
            assert!(mine == *undisturbed, "{file} differs from that of an undisturbed run");
        }
    }

    fn checkpoints(&self) -> Vec<PathBuf> {
        let Ok(entries) = fs::read_dir(self.out.join("checkpoints")) else { return Vec::new() };
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        files.retain(|path| path.extension().is_some_and(|extension| extension == "safetensors"));
        files.sort();
        files
    }

    fn wait_for_checkpoints(&self, count: usize) {
        wait_until(|| self.checkpoints().len() >= count);
    }
}

/// Returns the files of a run in a single process.
fn undisturbed() -> &'static Vec<Vec<u8>> {
    static RESULTS: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    RESULTS.get_or_init(|| {
        let run = Run::new();
        run.train(&["--workers", "0"]);
        run.results()
    })
}

fn wait_until(done: impl Fn() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < FOR_EVER, "waited for ever");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn ended(child: Child) -> (ExitStatus, String) {
    let output = child.wait_with_output().unwrap();
    (output.status, String::from_utf8_lossy(&output.stderr).into_owned())
}

fn workers_of(coordinator: &Child) -> Vec<Pid> {
    children_of(coordinator.id())
}

/// Returns the children of a process, by their parent in /proc.
fn children_of(process: u32) -> Vec<Pid> {
    let parent = process.to_string();
    let stat = |pid: i32| -> Option<(String, String)> {
        let text = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        let mut fields = text.rsplit_once(") ")?.1.split(' ');
        Some((fields.next()?.to_owned(), fields.next()?.to_owned()))
    };
    let names = fs::read_dir("/proc").unwrap().map(|entry| entry.unwrap().file_name());
    let pids = names.filter_map(|name| name.to_str()?.parse::<i32>().ok());
    let children = pids.filter(|&pid| stat(pid).is_some_and(|(state, of)| of == parent && state != "Z"));
    children.filter_map(Pid::from_raw).collect()
}

fn exists(pid: Pid) -> bool {
    let text = fs::read_to_string(format!("/proc/{}/stat", pid.as_raw_nonzero())).unwrap_or_default();
    text.rsplit_once(") ").is_some_and(|(_, rest)| !rest.starts_with('Z'))
}

/// Asserts that none of the workers outlives its coordinator.
fn assert_no_orphans(workers: &[Pid]) {
    assert!(!workers.is_empty());
    wait_until(|| !workers.iter().any(|&pid| exists(pid)));
}

fn wait_for_workers(coordinator: &Child, count: usize) -> Vec<Pid> {
    wait_until(|| workers_of(coordinator).len() == count);
    workers_of(coordinator)
}

#[test]
fn one_two_and_three_workers_make_the_same_files_as_a_single_process() {
    for workers in ["1", "2", "3"] {
        let run = Run::new();
        run.train(&["--workers", workers]);
        run.assert_undisturbed();
    }
}

#[test]
fn the_warehouse_is_the_same_for_any_fleet_and_after_a_kill() {
    assert_the_same_for_any_fleet_and_after_a_kill(Domain::Warehouse, &[]);
}

#[test]
fn marginals_are_the_same_for_any_fleet_and_after_a_kill() {
    for domain in [Domain::Traffic, Domain::Warehouse] {
        assert_the_same_for_any_fleet_and_after_a_kill(domain, &["--simulator", "marginal-dials"]);
    }
}

#[test]
fn aips_that_are_trained_again_on_drift_are_the_same_for_any_fleet_and_after_a_kill() {
    let settings = [
        "total_steps=15000",
        "evaluation.every_steps=5000",
        "aip.retrain=drift",
        "aip.drift_threshold=3",
        "aip.epochs=30",
        "aip.learning_rate=3e-2",
    ];
    let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting]).collect();
    let run = assert_the_same_for_any_fleet_and_after_a_kill(Domain::Traffic, &settings);
    // The test can fail: AIPs are found 2.0 % worse at the second evaluation and 4.0 % at the third.
    let drift = fs::read_to_string(run.out.join("aip_drift.csv")).unwrap();
    let trainings: Vec<&str> = drift.lines().filter(|line| line.contains(",all,training,")).collect();
    assert!(trainings.len() == 2 && trainings[1].starts_with("10112,"), "{drift}");
}

/// Returns the run of a single process.
fn assert_the_same_for_any_fleet_and_after_a_kill(domain: Domain, settings: &[&str]) -> Run {
    let alone = Run::of(domain);
    alone.train(&[settings, &["--workers", "0", "--tensorboard"]].concat());
    let run = Run::of(domain);
    run.train(&[settings, &["--workers", "3"]].concat());
    assert!(run.results() == alone.results(), "3 workers");
    let run = Run::of(domain);
    let mut coordinator = run.start(&[settings, &["--workers", "2", "--tensorboard"]].concat());
    run.wait_for_checkpoints(1);
    coordinator.kill().unwrap();
    assert_eq!(ended(coordinator).0.signal(), Some(9));
    let (status, said) = run.resume(&["--workers", "2"]);
    assert!(status.success(), "{said}");
    assert!(run.results() == alone.results());
    // Wall times differ, but not the length of their records: nothing is missing and nothing is written twice.
    let [mine, theirs] = [&run, &alone].map(|run| fs::metadata(run.out.join("events.out.tfevents")).unwrap().len());
    assert!(mine == theirs && mine > 1000, "{mine} {theirs}");
    alone
}

#[test]
fn an_imitation_is_the_same_for_any_fleet_and_after_a_kill() {
    let small = ["imitation.dataset_steps=300", "imitation.minibatch=32", "imitation.critic_steps=1250"];
    for (domain, more) in [
        (Domain::Traffic, ["policy.imitate=actuated", "policy.separate_critic=false", "imitation.epochs=2"]),
        (Domain::Warehouse, ["policy.imitate=closest-item", "policy.separate_critic=true", "imitation.minibatch=2"]),
    ] {
        let settings: Vec<&str> = small.iter().chain(&more).flat_map(|setting| ["--set", setting]).collect();
        let run = assert_the_same_for_any_fleet_and_after_a_kill(domain, &settings);
        let imitation = fs::read_to_string(run.out.join("imitation.csv")).unwrap();
        assert_eq!(
            imitation.lines().count(),
            6,
            "a header, a line for all and one for each of four agents: {imitation}"
        );
    }
}

#[test]
fn means_of_policies_and_a_clock_are_the_same_for_any_fleet_and_after_a_kill() {
    let settings = [
        "policy.average_every_steps=1000",
        "traffic.clock=26",
        "traffic.clock_offsets=checkerboard",
        "traffic.reward={mean-speed=1,exit-speed=1}",
    ];
    let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting]).collect();
    assert_the_same_for_any_fleet_and_after_a_kill(Domain::Traffic, &settings);
}

/// With the unit of returns, whose mean and spread are a part of a checkpoint.
#[test]
fn one_policy_for_a_kind_is_the_same_for_any_fleet_and_after_a_kill() {
    let settings = ["policy.share=kind", "ppo.value_unit=returns", "policy.initialisation=orthogonal"];
    let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting]).collect();
    assert_the_same_for_any_fleet_and_after_a_kill(Domain::Warehouse, &settings);
    let memory = ["--set", "policy.recurrent=8", "--set", "policy.sequence_length=8"];
    assert_the_same_for_any_fleet_and_after_a_kill(Domain::Traffic, &[&settings[..], &memory].concat());
}

const ON_THE_GS: [&str; 6] = ["--simulator", "gs", "--set", "total_steps=2048", "--set", "policy.recurrent=8"];

/// Returns what a run on the GS learnt and measured.
fn learnt(run: &Run) -> [Vec<u8>; 3] {
    ["returns.csv", "training.csv", "policies.safetensors"].map(|file| fs::read(run.out.join(file)).unwrap())
}

#[test]
fn training_on_copies_of_the_global_simulator_is_the_same_for_any_fleet_and_after_a_kill() {
    let settings = [&ON_THE_GS[..], &["--set", "policy.sequence_length=8"]].concat();
    for domain in [Domain::Traffic, Domain::Warehouse] {
        let with = |more: &[&str]| {
            let run = Run::of(domain);
            run.train(&[&settings[..], more].concat());
            learnt(&run)
        };
        for (copies, fleets) in
            [("gs.copies=1", &["3"][..]), ("gs.copies=2", &["2"]), ("local_simulators.copies=8", &["1", "2", "3"])]
        {
            let alone = with(&["--workers", "0", "--set", copies]);
            for workers in fleets {
                assert!(with(&["--workers", workers, "--set", copies]) == alone, "{copies}, {workers} workers");
            }
        }
        let run = Run::of(domain);
        let mut coordinator = run.start(&[&settings[..], &["--workers", "2"]].concat());
        run.wait_for_checkpoints(1);
        coordinator.kill().unwrap();
        assert_eq!(ended(coordinator).0.signal(), Some(9));
        let (status, said) = run.resume(&["--workers", "1"]);
        assert!(status.success(), "{said}");
        assert!(learnt(&run) == with(&["--workers", "0"]), "after a kill");
    }
}

#[test]
fn a_killed_copy_of_the_global_simulator_takes_its_worker_along_and_the_numbers_stay() {
    let settings = [&ON_THE_GS[..], &["--set", "policy.sequence_length=8", "--workers", "2"]].concat();
    let [undisturbed, run] = [Run::new(), Run::new()];
    undisturbed.train(&settings);
    let coordinator = run.start(&settings);
    run.wait_for_checkpoints(1);
    let copies_now = || -> Vec<Pid> {
        let workers = workers_of(&coordinator);
        workers.iter().flat_map(|worker| children_of(worker.as_raw_nonzero().get() as u32)).collect()
    };
    wait_until(|| copies_now().len() == 8);
    let copies = copies_now();
    kill_process(copies[3], Signal::KILL).unwrap();
    let (status, said) = ended(coordinator);
    assert!(status.success(), "{said}");
    assert!(said.contains("a simulator was lost") && said.contains("started again"), "{said}");
    assert!(learnt(&run) == learnt(&undisturbed));
    assert_no_orphans(&copies);
}

#[test]
fn a_worker_killed_in_the_middle_of_a_period_is_replaced_and_the_numbers_stay() {
    let run = Run::new();
    let coordinator = run.start(&["--workers", "2"]);
    run.wait_for_checkpoints(1);
    let victim = wait_for_workers(&coordinator, 2)[1];
    kill_process(victim, Signal::KILL).unwrap();
    let (status, said) = ended(coordinator);
    assert!(status.success(), "{said}");
    assert!(said.contains("warning: worker") && said.contains("signal 9 (killed; out of memory?)"), "{said}");
    assert!(said.contains("last lines of") && said.contains("owns agents"), "the log's tail is shown: {said}");
    run.assert_undisturbed();
}

#[test]
fn a_worker_that_hangs_is_replaced_after_the_patience() {
    let run = Run::new();
    let coordinator = run.start(&["--workers", "2", "--patience", "10"]);
    run.wait_for_checkpoints(1);
    kill_process(wait_for_workers(&coordinator, 2)[0], Signal::STOP).unwrap();
    let (status, said) = ended(coordinator);
    assert!(status.success(), "{said}");
    let lost = "said nothing for 10s (state: T (stopped)) and was ended; if it needs more time, --patience gives it; last \
                lines of";
    assert!(said.contains(lost), "{said}");
    run.assert_undisturbed();
}

#[test]
fn three_deaths_in_a_row_end_the_run_with_a_checkpoint_to_resume_from() {
    let run = Run::new();
    let coordinator = run.start(&["--workers", "1"]);
    run.wait_for_checkpoints(1);
    let mut killed: Vec<Pid> = Vec::new();
    wait_until(|| run.out.join("returns.csv").exists());
    while killed.len() < 3 {
        let fresh = workers_of(&coordinator).into_iter().find(|pid| !killed.contains(pid));
        if let Some(pid) = fresh {
            let _ = kill_process(pid, Signal::KILL); // it may have ended already
            killed.push(pid);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let (status, said) = ended(coordinator);
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("gave up after 3 deaths in a row at the same place"), "{said}");
    assert!(said.contains("train --resume"), "{said}");
    let (status, said) = run.resume(&["--workers", "2"]);
    assert!(status.success(), "{said}");
    run.assert_undisturbed();
}

#[test]
fn a_coordinator_killed_at_any_moment_leaves_no_orphan_and_resumes_to_the_same_files() {
    // Before the first checkpoint, right after one, and during the periods that follow.
    for (checkpoints, delay_ms) in [(0, 700), (1, 0), (2, 75)] {
        let run = Run::new();
        let mut coordinator = run.start(&["--workers", "2"]);
        let workers = wait_for_workers(&coordinator, 2);
        run.wait_for_checkpoints(checkpoints);
        std::thread::sleep(Duration::from_millis(delay_ms));
        coordinator.kill().unwrap();
        assert_eq!(ended(coordinator).0.signal(), Some(9));
        assert_no_orphans(&workers);
        // And with a different number of workers.
        let (status, said) = run.resume(&["--workers", "3"]);
        assert!(status.success(), "{said}");
        run.assert_undisturbed();
    }
}

#[test]
fn ctrl_c_stops_at_the_next_exchange_and_a_second_one_at_once() {
    let run = Run::new();
    let coordinator = run.start(&["--workers", "2"]);
    let workers = wait_for_workers(&coordinator, 2);
    run.wait_for_checkpoints(1);
    let pid = Pid::from_child(&coordinator);
    kill_process(pid, Signal::INT).unwrap();
    let (status, said) = ended(coordinator);
    assert_eq!(status.code(), Some(130), "{said}");
    assert!(
        said.contains("stopped; kept up to step ")
            && said.contains(" per agent; resume with: ")
            && said.contains(" train --resume "),
        "{said}"
    );
    assert_no_orphans(&workers);

    let mut command = program();
    command.arg("train").arg("--resume").arg(&run.out).args(["--workers", "2"]);
    let again = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let workers = wait_for_workers(&again, 2);
    let pid = Pid::from_child(&again);
    kill_process(pid, Signal::INT).unwrap();
    std::thread::sleep(LONGER_THAN_ONE_SIGNAL);
    let _ = kill_process(pid, Signal::INT); // it may have stopped already
    assert_eq!(ended(again).0.code(), Some(130));
    assert_no_orphans(&workers);

    let (status, said) = run.resume(&[]);
    assert!(status.success(), "{said}");
    run.assert_undisturbed();
}

/// Two periods of about a second on the GS, where the second worker owns no agents. The joint policy is as large as in
/// the configs that are shipped: larger than what a socket takes in without a reader.
const REAL_SIZE: [&str; 10] = [
    "--simulator",
    "gs",
    "--set",
    "total_steps=5000",
    "--set",
    "evaluation.every_steps=2500",
    "--set",
    "policy.hidden=[256, 128]",
    "--workers",
    "2",
];

/// A coordinator whose output can be read while it works. Dropping it kills it.
struct Watched {
    process: Child,
    said: PathBuf,
}

impl Watched {
    fn start(run: &Run, more: &[&str]) -> Watched {
        let mut command = program();
        command.arg("train").arg(&run.config).arg("--out").arg(&run.out).args(REAL_SIZE);
        Watched::spawn(command.args(more), run.config.with_file_name("started"))
    }

    fn resume(run: &Run, more: &[&str], name: &str) -> Watched {
        let mut command = program();
        command.arg("train").arg("--resume").arg(&run.out).args(["--workers", "2"]);
        Watched::spawn(command.args(more), run.config.with_file_name(name))
    }

    fn spawn(command: &mut Command, said: PathBuf) -> Watched {
        let file = fs::File::create(&said).unwrap();
        Watched { process: command.stdout(Stdio::null()).stderr(file).spawn().unwrap(), said }
    }

    fn said(&self) -> String {
        fs::read_to_string(&self.said).unwrap()
    }

    fn wait_for_words(&self, words: &str) {
        wait_until(|| self.said().contains(words));
    }

    fn interrupt(&self) {
        kill_process(Pid::from_child(&self.process), Signal::INT).unwrap();
    }

    /// Returns the exit code, once the coordinator has ended, and its output.
    fn ended(mut self) -> (Option<i32>, String) {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.process.try_wait().unwrap() {
                return (status.code(), self.said());
            }
            assert!(begun.elapsed() < FOR_EVER, "the coordinator hangs, and said: {}", self.said());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Returns the exit code after Ctrl-C, and the output. None of its workers may outlive it.
    fn stopped(self) -> (Option<i32>, String) {
        let workers = workers_of(&self.process);
        self.interrupt();
        let ended = self.ended();
        assert_no_orphans(&workers);
        ended
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Run {
    /// Returns the newest process of a worker, from its log, once it has begun.
    fn process_of(&self, worker: usize) -> Pid {
        let log = self.out.join(format!("worker_{worker}.log"));
        let newest = || {
            let text = fs::read_to_string(&log).ok()?;
            let (_, line) = text.rsplit_once("process ")?;
            Pid::from_raw(line.split_once(" owns ")?.0.parse().ok()?)
        };
        wait_until(|| newest().is_some());
        newest().unwrap()
    }

    /// Asserts that training on the GS made the same files as without a disturbance.
    fn assert_undisturbed_on_the_gs(&self) {
        static UNDISTURBED: OnceLock<[Vec<u8>; 3]> = OnceLock::new();
        let results = |run: &Run| {
            ["returns.csv", "training.csv", "policies.safetensors"].map(|file| fs::read(run.out.join(file)).unwrap())
        };
        let undisturbed = UNDISTURBED.get_or_init(|| {
            let run = Run::new();
            run.train(&REAL_SIZE);
            results(&run)
        });
        assert!(undisturbed[2].len() > 400_000, "policies of {} bytes block no write", undisturbed[2].len());
        assert!(results(self) == *undisturbed);
    }
}

/// Waits until a process has had no work for half a second.
fn wait_until_idle(pid: Pid) {
    let cpu_time = || {
        let text = fs::read_to_string(format!("/proc/{}/stat", pid.as_raw_nonzero())).unwrap();
        let (_, fields) = text.rsplit_once(") ").unwrap();
        // utime and stime
        fields.split(' ').skip(11).take(2).map(str::to_owned).collect::<Vec<_>>()
    };
    wait_until(|| {
        let before = cpu_time();
        std::thread::sleep(Duration::from_millis(500));
        cpu_time() == before
    });
}

/// Waits for the first worker that is a program of its own and no longer a copy of the coordinator.
fn wait_for_a_program(coordinator: &Child) -> Pid {
    let is_worker = |pid: &Pid| {
        let words = fs::read(format!("/proc/{}/cmdline", pid.as_raw_nonzero())).unwrap_or_default();
        words.split(|&byte| byte == 0).nth(1) == Some(b"worker")
    };
    let find = || workers_of(coordinator).into_iter().find(is_worker);
    wait_until(|| find().is_some());
    find().unwrap()
}

#[test]
fn a_stopped_worker_without_agents_is_replaced_after_the_patience() {
    let run = Run::new();
    let coordinator = Watched::start(&run, &["--patience", "5"]);
    coordinator.wait_for_words("step 0: return");
    // It has nothing to do until the next order sends the joint policy, which it does not read.
    kill_process(run.process_of(1), Signal::STOP).unwrap();
    let (code, said) = coordinator.ended();
    assert_eq!(code, Some(0), "{said}");
    let warning = "worker 1 (no agents of its own) said nothing for 5s (state: T (stopped)) and was ended";
    assert!(said.contains(warning), "{said}");
    run.assert_undisturbed_on_the_gs();
}

#[test]
fn ctrl_c_is_obeyed_while_a_worker_is_stopped() {
    let run = Run::new();
    let coordinator = Watched::start(&run, &[]);
    coordinator.wait_for_words("step 0: return");
    kill_process(run.process_of(1), Signal::STOP).unwrap();
    run.wait_for_checkpoints(1);
    // Now the evaluation waits for the stopped worker, and stopping loses nothing.
    wait_until_idle(run.process_of(0));
    let (code, said) = coordinator.stopped();
    assert!(code == Some(130) && said.contains(" per agent; resume with: "), "{said}");

    // A period that waits for the stopped worker is finished or lost. The user must choose.
    let coordinator = Watched::resume(&run, &[], "resumed");
    coordinator.wait_for_words(": return");
    kill_process(run.process_of(0), Signal::STOP).unwrap();
    coordinator.interrupt();
    coordinator.wait_for_words("stopping at the next checkpoint, where nothing is lost");
    coordinator.wait_for_words("to stop now and lose what came since the last checkpoint");
    std::thread::sleep(LONGER_THAN_ONE_SIGNAL);
    let (code, said) = coordinator.stopped();
    assert!(code == Some(130) && said.contains(" per agent; resume with: "), "{said}");

    let coordinator = Watched::resume(&run, &["--patience", "5"], "resumed_again");
    let stopped_before_it_begins = wait_for_a_program(&coordinator.process);
    kill_process(stopped_before_it_begins, Signal::STOP).unwrap();
    let (code, said) = coordinator.ended();
    assert!(code == Some(0) && said.contains("said nothing for 5s"), "{said}");
    run.assert_undisturbed_on_the_gs();
}

#[test]
fn checkpoints_by_time_leave_no_trace_wherever_they_cut_a_period() {
    // One after every update: the shortest time.
    for workers in ["0", "2"] {
        let run = Run::new();
        run.train(&["--workers", workers, "--set", "checkpoints.every_minutes=1e-9"]);
        run.assert_undisturbed();
    }
    let [calm, cut] = [["--workers", "1"].as_slice(), &["--workers", "2", "--set", "checkpoints.every_minutes=1e-9"]]
        .map(|more| {
            let run = Run::new();
            run.train(&[&["--simulator", "gs", "--set", "gs.copies=2", "--set", "total_steps=1_500"], more].concat());
            ["returns.csv", "training.csv", "policies.safetensors"].map(|file| fs::read(run.out.join(file)).unwrap())
        });
    assert!(calm == cut, "on two copies of the GS");
}

#[test]
fn a_run_that_is_terminated_as_timeout_does_loses_less_than_a_period() {
    for signal in [Signal::TERM, Signal::HUP] {
        let run = Run::new();
        // Updates are every 128 steps. Nothing else is due before step 1000.
        // These tests may run under `nohup`, which lets SIGHUP be ignored.
        let mut command = Command::new("env");
        command.args(["--default-signal=HUP", env!("CARGO_BIN_EXE_dials-traffic"), "train"]);
        command.arg(&run.config).arg("--out").arg(&run.out).args(["--workers", "1"]);
        command.args(["--set", "checkpoints.every_minutes=1e-9"]).stdout(Stdio::null()).stderr(Stdio::piped());
        let coordinator = command.spawn().unwrap();
        run.wait_for_checkpoints(2);
        let pid = Pid::from_child(&coordinator);
        // GNU timeout signals the process, and then its group.
        (0..2).for_each(|_| kill_process(pid, signal).unwrap());
        let (status, said) = ended(coordinator);
        assert_eq!(status.code(), Some(130), "{said}");
        let kept = said.split("stopped; kept up to step ").nth(1).unwrap();
        let step: u64 = kept.split(' ').next().unwrap().parse().unwrap();
        assert!(step > 0 && step.is_multiple_of(128), "{said}");
        if signal == Signal::TERM {
            // A run may also end where the period was cut. What the period has brought so far is written then.
            let (status, said) = run.resume(&["--steps", &step.to_string()]);
            assert!(status.success(), "{said}");
            let short = Run::new();
            short.train(&["--workers", "1", "--steps", &step.to_string()]);
            assert!(run.results() == short.results(), "the run that ends at step {step}");
        } else {
            let (status, said) = run.resume(&["--workers", "2"]);
            assert!(status.success(), "{said}");
            run.assert_undisturbed();
        }
    }
}

#[test]
fn a_damaged_checkpoint_is_refused_and_the_one_before_it_serves() {
    let run = Run::new();
    run.train(&["--workers", "2"]);
    let newest = run.checkpoints().pop().unwrap();
    let bytes = fs::read(&newest).unwrap();
    fs::write(&newest, &bytes[..bytes.len() / 2]).unwrap();
    let (status, said) = run.resume(&["--workers", "2"]);
    assert_eq!(status.code(), Some(1));
    let name = newest.file_name().unwrap().to_str().unwrap();
    assert!(said.contains(name) && said.contains("move it away to continue from the checkpoint before it"), "{said}");
    assert!(said.contains("cut short"), "{said}");
    fs::remove_file(&newest).unwrap();
    let (status, said) = run.resume(&["--workers", "2"]);
    assert!(status.success(), "{said}");
    run.assert_undisturbed();
}

#[test]
fn a_run_is_written_by_one_process_at_a_time() {
    let run = Run::new();
    let first = run.start(&["--workers", "1"]);
    run.wait_for_checkpoints(1);
    let (status, said) = run.resume(&[]);
    assert_eq!(status.code(), Some(1));
    assert!(said.contains("another process is writing this run"), "{said}");
    assert!(ended(first).0.success());
    run.assert_undisturbed();
}

#[test]
fn a_person_who_starts_a_worker_by_hand_is_told_what_it_is() {
    let output = program().arg("worker").stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() || said.contains("not for people"), "{said}");
}
