//! A place of its own for a run: config, run directory, temporary files and output. And its processes.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

/// Time limit. However slow the machine is, a wait that lasts longer will never end.
pub(super) const FOR_EVER: Duration = Duration::from_secs(300);
/// Variable that marks the processes of a stage. Their children inherit it, whatever becomes of their parents.
const MARK: &str = "CHAOS_STAGE";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Domain {
    /// Traffic with checkpoints by time, which are at other steps each time.
    Traffic,
    /// The same on copies of the GS, each in a process of its own.
    Gs,
    /// The warehouse, with recurrent policies and AIPs, and an event file for TensorBoard.
    Warehouse,
}

impl Domain {
    pub(super) const ALL: [Domain; 3] = [Domain::Traffic, Domain::Gs, Domain::Warehouse];

    pub(super) fn name(self) -> &'static str {
        match self {
            Domain::Traffic => "traffic",
            Domain::Gs => "traffic on the GS",
            Domain::Warehouse => "warehouse",
        }
    }

    /// Number of timesteps per agent of a run of [`Domain::config`].
    pub(super) fn steps(self) -> u64 {
        match self {
            Domain::Traffic => 7_500,
            Domain::Gs => 3_000,
            Domain::Warehouse => 12_000,
        }
    }

    /// Returns the config of a run of `steps` timesteps per agent. With the steps of the domain these are six periods;
    /// two begin with a training of the AIPs, three with an evaluation.
    pub(super) fn config(self, steps: u64) -> String {
        let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").display().to_string();
        match self {
            Domain::Traffic => format!(
                "total_steps = {steps}\ncheckpoints = {{ every_steps = 1_250, every_minutes = 0.005 }}\n\
                 [traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 60\n\
                 [local_simulators]\ncopies = 8\nstagger = true\n[policy]\nhidden = [32, 16]\n\
                 [ppo]\ntime_limit = 'bootstrap'\n\
                 [aip]\nhidden = [8]\nretrain_every_steps = 5_000\ndataset_steps = 300\nbatch = 32\nepochs = 2\n\
                 [evaluation]\nevery_steps = 2_500\nepisodes = 5\nfinal_episodes = 10\naip_loss_episodes = 4\n"
            ),
            Domain::Gs => format!(
                "total_steps = {steps}\nsimulator = 'gs'\n\
                 checkpoints = {{ every_steps = 500, every_minutes = 0.005 }}\n\
                 [traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 60\n\
                 [local_simulators]\nstagger = true\n[gs]\ncopies = 3\n[policy]\nhidden = [32, 16]\n\
                 [ppo]\nmemory = 96\nrollout_steps = 16\ntime_limit = 'bootstrap'\n\
                 [evaluation]\nevery_steps = 1_000\nepisodes = 5\nfinal_episodes = 10\n"
            ),
            Domain::Warehouse => format!(
                "total_steps = {steps}\ncheckpoints.every_steps = 2_000\nlogging.tensorboard = true\n\
                 [warehouse]\nagents_per_side = 2\nhorizon = 50\n\
                 [local_simulators]\ncopies = 8\nstagger = true\n\
                 [policy]\nrecurrent = 24\nhidden = [16]\nsequence_length = 8\n\
                 [ppo]\nrollout_steps = 8\ntime_limit = 'bootstrap'\n\
                 [aip]\nrecurrent = 8\nhidden = [8]\nretrain_every_steps = 8_000\ndataset_steps = 500\nbatch = 4\n\
                 epochs = 5\n\
                 [evaluation]\nevery_steps = 4_000\nepisodes = 5\nfinal_episodes = 10\naip_loss_episodes = 4\n"
            ),
        }
    }
}

/// A folder with all that belongs to a run. Dropping it removes it, unless it is kept.
pub(super) struct Stage {
    folder: TempDir,
}

impl Stage {
    pub(super) fn new(config: &str) -> Stage {
        let folder = tempfile::Builder::new().prefix("chaos-").tempdir().unwrap();
        let stage = Stage { folder };
        for folder in [stage.runs(), stage.temporary(), stage.path("said")] {
            fs::create_dir(folder).unwrap();
        }
        fs::write(stage.path("config.toml"), config).unwrap();
        stage
    }

    /// Leaves the folder where it is, for a person to look at.
    pub(super) fn keep(&mut self) -> &Path {
        self.folder.disable_cleanup(true);
        self.folder.path()
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The folder that holds nothing but the run directory.
    pub(super) fn runs(&self) -> PathBuf {
        self.path("runs")
    }

    pub(super) fn run(&self) -> PathBuf {
        self.runs().join("run")
    }

    /// The folder for the temporary files of the program.
    pub(super) fn temporary(&self) -> PathBuf {
        self.path("temporary")
    }

    /// Begins the run, or resumes it if its directory is there.
    pub(super) fn train(&self, workers: u64, patience: u64) -> Process {
        let mut words = vec!["train".to_owned()];
        if self.run().join("config.toml").is_file() {
            words.extend(["--resume".to_owned(), path(&self.run())]);
        } else {
            words.extend([path(&self.path("config.toml")), "--out".to_owned(), path(&self.run())]);
        }
        words.extend(["--workers".to_owned(), workers.to_string(), "--patience".to_owned(), patience.to_string()]);
        self.start(&words)
    }

    /// Goes on with the run until the first update after `steps`, and no further.
    pub(super) fn train_until(&self, steps: u64, workers: u64) -> Process {
        let words =
            ["train", "--resume", &path(&self.run()), "--steps", &steps.to_string(), "--workers", &workers.to_string()];
        self.start(&words.map(str::to_owned))
    }

    pub(super) fn start(&self, words: &[String]) -> Process {
        let said = self.path("said");
        let number = fs::read_dir(&said).unwrap().count();
        let said = said.join(format!("{number:03}-{}", words[0]));
        let mut command = Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
        command.args(words).env(MARK, self.folder.path()).env("TMPDIR", self.temporary());
        let file = File::create(&said).unwrap();
        let child = command.stdin(Stdio::null()).stdout(file.try_clone().unwrap()).stderr(file).spawn().unwrap();
        Process { child, said, begun: Instant::now() }
    }

    /// Returns the living processes of this stage.
    pub(super) fn processes(&self) -> Vec<Pid> {
        let mark = format!("{MARK}={}", self.folder.path().display());
        let names = fs::read_dir("/proc").unwrap().map(|entry| entry.unwrap().file_name());
        let pids = names.filter_map(|name| name.to_str()?.parse().ok()).filter_map(Pid::from_raw);
        // A process that has ended and waits for its parent has no environment.
        pids.filter(|&pid| proc(pid, "environ").split(|&byte| byte == 0).any(|word| word == mark.as_bytes())).collect()
    }

    /// Returns the worker processes.
    pub(super) fn workers(&self) -> Vec<Pid> {
        let is_worker = |&pid: &Pid| proc(pid, "cmdline").split(|&byte| byte == 0).nth(1) == Some(b"worker");
        self.processes().into_iter().filter(is_worker).collect()
    }

    /// Waits until no process is left, and returns the number of those that do not end. They are killed.
    pub(super) fn orphans(&self) -> usize {
        let begun = Instant::now();
        loop {
            let left = self.processes();
            // A worker that was stopped before it could ask to end with its parent ends when it goes on.
            signal_all(&left, Signal::CONT);
            if left.is_empty() {
                return 0;
            }
            if begun.elapsed() > FOR_EVER / 10 {
                signal_all(&left, Signal::KILL);
                return left.len();
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        // Also after a panic of the test.
        signal_all(&self.processes(), Signal::KILL);
    }
}

/// Signals processes that may end meanwhile.
fn signal_all(pids: &[Pid], signal: Signal) {
    for &pid in pids {
        let _ = kill_process(pid, signal);
    }
}

/// Returns a file of /proc, or nothing if the process has ended.
pub(super) fn proc(pid: Pid, file: &str) -> Vec<u8> {
    fs::read(format!("/proc/{}/{file}", pid.as_raw_nonzero())).unwrap_or_default()
}

pub(super) fn path(path: &Path) -> String {
    path.to_str().expect("temporary folders have plain names").to_owned()
}

/// A process that was started here. Dropping it kills it.
pub(super) struct Process {
    child: Child,
    said: PathBuf,
    begun: Instant,
}

impl Process {
    pub(super) fn pid(&self) -> Pid {
        Pid::from_child(&self.child)
    }

    pub(super) fn age(&self) -> Duration {
        self.begun.elapsed()
    }

    /// Sends a signal, unless the process has ended.
    pub(super) fn signal(&mut self, signal: Signal) {
        if self.status().is_none() {
            kill_process(self.pid(), signal).unwrap();
        }
    }

    pub(super) fn status(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().unwrap()
    }

    /// Waits until something is so. Returns `false` if the process ends before that.
    pub(super) fn lives_until(&mut self, mut so: impl FnMut() -> bool) -> bool {
        let begun = Instant::now();
        while begun.elapsed() < FOR_EVER {
            if self.status().is_some() {
                return false;
            }
            if so() {
                return true;
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        panic!("{}: waited for ever; it says:\n{}", self.said.display(), self.said());
    }

    pub(super) fn lives_for(&mut self, time: Duration) -> bool {
        let begun = Instant::now();
        self.lives_until(|| begun.elapsed() >= time)
    }

    /// Waits for its end. A process that never ends: `None`, and it is killed.
    pub(super) fn ended_within(&mut self, time: Duration) -> Option<ExitStatus> {
        let begun = Instant::now();
        while begun.elapsed() < time {
            if let Some(status) = self.status() {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        None
    }

    /// Returns what it printed.
    pub(super) fn said(&self) -> String {
        String::from_utf8_lossy(&fs::read(&self.said).unwrap()).into_owned()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
