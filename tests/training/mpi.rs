//! Workers on the ranks of an MPI job: the same numbers as with any other fleet, and the death of a rank.
//!
//! All ranks are on this machine, more of them than it has cores. It needs Open MPI's `mpirun`.
#![cfg(feature = "mpi")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rustix::process::{Pid, Signal, kill_process};

const RESULTS: [&str; 6] =
    ["returns.csv", "aip_loss.csv", "aip_drift.csv", "training.csv", "policies.safetensors", "aips.safetensors"];
/// Time limit. However slow the machine is, a wait that lasts longer will never end.
const FOR_EVER: Duration = Duration::from_secs(600);
/// What every rank runs. Only rank 0 is where the config and the run directory are, and writes down its exit code.
const RANK: &str = "if [ \"$OMPI_COMM_WORLD_RANK\" != 0 ]; then cd / && exec \"$0\" \"$@\"; fi; \
                    trap '' TERM; \"$0\" \"$@\"; code=$?; echo $code > code; exit $code";

/// Makes configs of three periods, with an AIP training before the first and the last.
fn configs() -> [(&'static str, String); 2] {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").display().to_string();
    let traffic = format!(
        "total_steps = 3_000\n\
         [traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 60\n\
         [local_simulators]\ncopies = 8\nstagger = true\n[policy]\nhidden = [32, 16]\n\
         [ppo]\ntime_limit = 'bootstrap'\n\
         [aip]\nhidden = [8]\nretrain_every_steps = 2_000\ndataset_steps = 300\nbatch = 32\nepochs = 2\n\
         [evaluation]\nevery_steps = 1_000\nepisodes = 5\nfinal_episodes = 6\naip_loss_episodes = 4\n"
    );
    let warehouse = "total_steps = 3_000\n\
         [warehouse]\nagents_per_side = 2\nhorizon = 50\n\
         [local_simulators]\ncopies = 8\nstagger = true\n[policy]\nrecurrent = 24\nhidden = [16]\nsequence_length = 8\n\
         [ppo]\nrollout_steps = 8\ntime_limit = 'bootstrap'\n\
         [aip]\nrecurrent = 8\nhidden = [8]\nretrain_every_steps = 2_000\ndataset_steps = 500\nbatch = 4\nepochs = 5\n\
         [evaluation]\nevery_steps = 1_000\nepisodes = 5\nfinal_episodes = 6\naip_loss_episodes = 4\n";
    [("traffic", traffic), ("warehouse", warehouse.to_owned())]
}

const PROGRAM: &str = env!("CARGO_BIN_EXE_dials-traffic");

struct Run(tempfile::TempDir);

impl Run {
    fn new(config: &str) -> Run {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("run.toml"), config).unwrap();
        Run(dir)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Makes the command that begins the run, or goes on with it if it has begun.
    fn train(&self, mut command: Command) -> Command {
        command.arg("train").current_dir(self.0.path()).stdout(Stdio::null()).stderr(Stdio::piped());
        match self.path("run").exists() {
            true => command.args(["--resume", "run"]),
            false => command.args(["run.toml", "--out", "run"]),
        };
        command
    }

    /// Trains with a fleet of this machine.
    fn here(&self, workers: &str) -> &Run {
        let (code, said) = ended(self.train(Command::new(PROGRAM)).args(["--workers", workers]).spawn().unwrap());
        assert_eq!(code, Some(0), "{said}");
        self
    }

    fn start_ranks(&self, ranks: usize, more: &[&str]) -> Child {
        // Rank 0 must have the time to say why the job ends, on a machine that is busy with other tests, too.
        self.start(ranks, "10", more)
    }

    /// `patience_s`: how long the ranks that are left may go on when one has ended. The job always lasts as long then.
    fn start(&self, ranks: usize, patience_s: &str, more: &[&str]) -> Child {
        let mut command = Command::new("mpirun");
        command.args(["--oversubscribe", "--bind-to", "none", "--mca", "odls_base_sigkill_timeout", patience_s]);
        command.args(["-n", &ranks.to_string(), "sh", "-c", RANK, PROGRAM]);
        command.envs(["OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"].map(|name| (name, "1")));
        let started = self.train(command).args(more).spawn();
        started.expect("mpirun cannot be started; install it with: ./setup.sh mpi")
    }

    /// Trains on the ranks of an MPI job.
    fn on_ranks(&self, ranks: usize, more: &[&str]) -> &Run {
        let (code, said) = ended(self.start_ranks(ranks, more));
        assert_eq!(code, Some(0), "{said}");
        self
    }

    /// Returns the exit code of rank 0 in the last job.
    fn code_of_rank_0(&self) -> String {
        fs::read_to_string(self.path("code")).unwrap()
    }

    fn results(&self) -> Vec<Vec<u8>> {
        RESULTS.iter().map(|file| fs::read(self.path("run").join(file)).unwrap()).collect()
    }

    fn wait_for_a_checkpoint(&self) {
        wait_until(|| {
            let Ok(entries) = fs::read_dir(self.path("run/checkpoints")) else { return false };
            entries.flatten().any(|entry| entry.path().extension().is_some_and(|it| it == "safetensors"))
        });
    }
}

fn wait_until(done: impl Fn() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < FOR_EVER, "waited for ever");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Returns the exit code and the output. A job that hangs is ended.
fn ended(mut child: Child) -> (Option<i32>, String) {
    let mut output = child.stderr.take().unwrap();
    let reader = std::thread::spawn(move || {
        let mut said = Vec::new();
        let _ = std::io::Read::read_to_end(&mut output, &mut said);
        String::from_utf8_lossy(&said).into_owned()
    });
    let begun = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return (status.code(), reader.join().unwrap());
        }
        if begun.elapsed() > FOR_EVER {
            let _ = kill_process(Pid::from_child(&child), Signal::TERM);
            let _ = child.wait();
            panic!("the job hangs, and said: {}", reader.join().unwrap());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn children_of(parent: Pid) -> Vec<Pid> {
    let parent = parent.as_raw_nonzero().to_string();
    let is_child = |pid: &i32| {
        let text = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let mut fields = text.rsplit_once(") ").map_or("", |(_, rest)| rest).split(' ');
        fields.next().is_some_and(|state| state != "Z") && fields.next() == Some(&parent)
    };
    let names = fs::read_dir("/proc").unwrap().flatten().map(|entry| entry.file_name());
    let pids = names.filter_map(|name| name.to_str()?.parse().ok()).filter(is_child);
    pids.filter_map(Pid::from_raw).collect()
}

fn exists(pid: Pid) -> bool {
    let text = fs::read_to_string(format!("/proc/{}/stat", pid.as_raw_nonzero())).unwrap_or_default();
    text.rsplit_once(") ").is_some_and(|(_, rest)| !rest.starts_with('Z'))
}

/// Returns the process of a rank that owns workers, once they are there.
fn rank_with_workers(mpirun: &Child, rank: usize) -> (Pid, Vec<Pid>) {
    let find = || {
        let is_it = |pid: &Pid| {
            let words = fs::read(format!("/proc/{}/environ", pid.as_raw_nonzero())).unwrap_or_default();
            words.split(|&byte| byte == 0).any(|word| word == format!("OMPI_COMM_WORLD_RANK={rank}").as_bytes())
        };
        let pid = children_of(Pid::from_child(mpirun)).into_iter().find(is_it)?;
        Some((pid, children_of(pid))).filter(|(_, workers)| !workers.is_empty())
    };
    wait_until(|| find().is_some());
    find().unwrap()
}

fn assert_the_same(mine: &Run, theirs: &Run, what: &str) {
    for ((file, mine), theirs) in RESULTS.iter().zip(mine.results()).zip(theirs.results()) {
        assert!(mine == theirs, "{what}: {file} differs");
    }
}

#[test]
fn two_and_three_ranks_make_the_same_files_as_a_single_process_and_child_processes() {
    for (domain, config) in configs() {
        let alone = Run::new(&config);
        alone.here("0");
        assert_the_same(Run::new(&config).here("2"), &alone, domain);
        for (ranks, more) in [(2, &[][..]), (3, &[]), (3, &["--workers-per-rank", "2"])] {
            let run = Run::new(&config);
            run.on_ranks(ranks, more);
            assert_the_same(&run, &alone, &format!("{domain}, {ranks} ranks {more:?}"));
            // Rank 0 writes down what the workers print, wherever they are.
            let log = fs::read_to_string(run.path("run/worker_0.log")).unwrap();
            assert!(log.contains("owns agents 0 to "), "{log}");
        }
    }
}

#[test]
fn a_dead_rank_ends_the_job_and_any_fleet_resumes_it_to_the_same_files() {
    for (domain, config) in configs() {
        let alone = Run::new(&config);
        alone.here("0");
        let run = Run::new(&config);
        let job = run.start_ranks(3, &[]);
        run.wait_for_a_checkpoint();
        let (first, mut processes) = rank_with_workers(&job, 1);
        let (victim, its_workers) = rank_with_workers(&job, 2);
        processes.extend([&[first], &its_workers[..]].concat());
        kill_process(victim, Signal::KILL).unwrap();
        let (code, said) = ended(job);
        assert!(said.contains("worker 1 (agents 2..3) died: rank 2 on "), "{said}");
        assert!(said.contains("it owned worker 1 (agents 2..3)") && said.contains("train --resume run"), "{said}");
        assert_eq!(run.code_of_rank_0(), "1\n", "{said}");
        // mpirun ends with the status of the process that died first: 128 + 9.
        assert_eq!(code, Some(137), "{said}");
        wait_until(|| !processes.iter().any(|&pid| exists(pid)));
        match domain {
            "traffic" => run.here("1"),
            _ => run.on_ranks(2, &[]),
        };
        assert_the_same(&run, &alone, domain);
    }
}

/// Kills `MPI_KILLS` ranks or their workers, one unless it is given. Resumes the job after each.
#[test]
fn a_job_whose_ranks_are_killed_at_random_ends_as_if_nobody_had_touched_it() {
    let kills = std::env::var("MPI_KILLS").map_or(1, |text| text.parse().expect("MPI_KILLS is a number"));
    let [(_, config), _] = configs();
    // Checkpoints by time are at other steps each time.
    let config = format!("checkpoints.every_minutes = 0.005\n{config}");
    let alone = Run::new(&config);
    alone.here("0");
    let mut dice = Xoshiro256PlusPlus::seed_from_u64(kills);
    let (mut killed, mut jobs) = (0, 0);
    while killed < kills {
        let run = Run::new(&config);
        loop {
            let mut job = run.start_ranks(3, &[]);
            jobs += 1;
            if killed < kills {
                let (rank, workers) = rank_with_workers(&job, dice.random_range(1..3));
                std::thread::sleep(Duration::from_millis(dice.random_range(0..3000)));
                if job.try_wait().unwrap().is_none() {
                    let victim = if dice.random_bool(0.5) { rank } else { workers[0] };
                    // It may have ended already.
                    killed += u64::from(kill_process(victim, Signal::KILL).is_ok());
                }
            }
            let (code, said) = ended(job);
            if code == Some(0) {
                break;
            }
            // A rank may be killed between the end of the run and that of the job.
            assert!(said.contains(" died: ") || said.contains("\ndone in "), "{said}");
        }
        assert_the_same(&run, &alone, "killed and resumed");
    }
    println!("{killed} killed in {jobs} jobs: no file differs");
}

#[test]
fn a_dead_worker_of_a_rank_ends_the_job_with_the_end_of_its_log() {
    let [(_, config), _] = configs();
    let run = Run::new(&config);
    let job = run.start_ranks(2, &["--workers-per-rank", "2"]);
    run.wait_for_a_checkpoint();
    wait_until(|| rank_with_workers(&job, 1).1.len() == 2);
    kill_process(rank_with_workers(&job, 1).1[0], Signal::KILL).unwrap();
    let (code, said) = ended(job);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains(") died: signal 9 (killed; out of memory?); last lines of "), "{said}");
    assert!(said.contains("owns agents ") && said.contains("it ran on rank 1 on "), "{said}");
    run.here("0");
    assert_the_same(&run, Run::new(&config).here("2"), "resumed");
}

#[test]
fn wrong_flags_end_the_job_before_it_begins() {
    let [(_, config), _] = configs();
    let run = Run::new(&config);
    // Rank 0 is the one that ends.
    let (code, said) = ended(run.start(3, "1", &["--workers", "2"]));
    assert!(code == Some(2) && said.contains("3 ranks were started; use --workers-per-rank"), "{said}");
    // Only rank 0 reads the config, so only rank 0 can refuse it. The others must not wait for ever.
    let (code, said) = ended(run.start(3, "1", &["--set", "ppo.clip=-1"]));
    assert!(code == Some(2) && said.contains("ppo.clip = -1"), "{said}");
    assert!(!run.path("run").exists());
    let alone = run.train(Command::new(PROGRAM)).args(["--workers-per-rank", "2"]).spawn().unwrap();
    let (code, said) = ended(alone);
    assert!(code == Some(2) && said.contains("this process is alone; use --workers"), "{said}");
}
