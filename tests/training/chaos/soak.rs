//! A long training: memory, descriptors and threads over time.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use rand::seq::IndexedRandom;
use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus as Dice;
use rustix::process::{Pid, Signal, kill_process};

use super::compare::compare;
use super::number;
use super::stage::{Domain, Process, Stage, proc};

/// Seconds of training, unless `SOAK_SECONDS` says otherwise.
const SECONDS: u64 = 120;
/// Timesteps per agent of runs that are stopped before their end.
const WITHOUT_END: u64 = 100_000_000;
const SAMPLE_EVERY: Duration = Duration::from_secs(2);
/// Share of the samples, the first ones, that count as warming up.
const WARM_UP: f64 = 0.1;
/// Most that a median may grow from the first to the last third: by this factor, and also by this number.
const GROWTH: f64 = 1.05;
const MORE_KIB: f64 = 8192.0;
const MORE_DESCRIPTORS: f64 = 2.0;
const MORE_THREADS: f64 = 1.0;
/// Fewest samples of a process of which growth is judged.
const FEWEST: usize = 9;

/// Who is watched: the name of the run, and of the process in it.
type Who = (&'static str, String);

/// What /proc says about a process at a moment.
#[derive(Clone, Copy)]
struct Sample {
    pss_kib: f64,
    rss_kib: f64,
    descriptors: f64,
    threads: f64,
}

#[test]
#[ignore = "takes SOAK_SECONDS"]
fn soak() {
    let (seconds, seed) = (number("SOAK_SECONDS", SECONDS), number("CHAOS_SEED", super::SEED));
    println!("{seconds} s, seed {seed}");
    let [mut calm, mut disturbed] = [(); 2].map(|()| Stage::new(&Domain::Traffic.config(WITHOUT_END)));
    let mut watch = Watch::new();
    let kills = train_both(&calm, &disturbed, &mut watch, seconds, &mut Dice::seed_from_u64(seed));
    println!("{kills} workers were killed; the samples are in {}", Watch::FILE);
    let steps = lead_to_the_same_step(&calm, &disturbed, seconds);
    println!("both runs made {steps} timesteps per agent");
    let grown = watch.grown();
    let faults = compare(&calm, &disturbed);
    if !faults.is_empty() {
        println!("kept: {} and {}", calm.keep().display(), disturbed.keep().display());
    }
    assert!(faults.is_empty(), "{faults:?}");
    assert!(grown.is_empty(), "{}", grown.join("\n"));
}

/// Trains both runs at the same time for `seconds`, kills workers of the second one, and returns how many.
fn train_both(calm: &Stage, disturbed: &Stage, watch: &mut Watch, seconds: u64, dice: &mut Dice) -> usize {
    let mut runs = [("calm", calm, calm.train(1, 600)), ("disturbed", disturbed, disturbed.train(2, 600))];
    let (begun, mut sampled, mut kills) = (Instant::now(), Instant::now(), 0);
    // Often enough that a short soak has a few, and seldom enough that the run gets on.
    let mean_pause = (seconds as f64 / 20.0).clamp(5.0, 60.0);
    let pause = |dice: &mut Dice| Duration::from_secs_f64(mean_pause * dice.random_range(0.1..1.9));
    let mut next_kill = begun + pause(dice);
    while begun.elapsed() < Duration::from_secs(seconds) {
        std::thread::sleep(Duration::from_millis(50));
        for (_, stage, process) in &mut runs {
            if process.status().is_some() {
                // On a slow machine, three kills may meet the same period.
                assert!(process.said().contains("gave up after 3 deaths in a row"), "{}", process.said());
                *process = stage.train(2, 600);
            }
        }
        if sampled.elapsed() >= SAMPLE_EVERY {
            sampled = Instant::now();
            for (name, stage, process) in &mut runs {
                watch.look(begun.elapsed(), name, stage, process);
            }
        }
        if Instant::now() >= next_kill {
            if let Some(&worker) = disturbed.workers().choose(dice) {
                // It may have ended already.
                let _ = kill_process(worker, Signal::KILL);
                kills += 1;
            }
            next_kill = Instant::now() + pause(dice);
        }
    }
    for (_, stage, process) in &mut runs {
        stop(stage, process);
    }
    kills
}

/// Asks a run to stop at the end of its period, and waits for it.
fn stop(stage: &Stage, process: &mut Process) {
    process.signal(Signal::INT);
    assert!(process.ended_within(super::stage::FOR_EVER).is_some(), "it does not stop: {}", process.said());
    assert_eq!(stage.orphans(), 0);
}

/// Resumes both runs, which end after the same number of timesteps, and returns it. A run that fell behind in `seconds` needs no
/// more than twice as many to catch up.
fn lead_to_the_same_step(calm: &Stage, disturbed: &Stage, seconds: u64) -> u64 {
    let stages = [calm, disturbed];
    let longest = super::stage::FOR_EVER + Duration::from_secs(2 * seconds);
    let goal = stages.map(newest_checkpoint).into_iter().max().expect("there are two") + 1;
    let ended = stages.map(|stage| {
        let mut process = stage.train_until(goal, 2);
        let code = process.ended_within(longest);
        assert!(code.is_some_and(|code| code.success()), "it does not end well: {}", process.said());
        newest_checkpoint(stage)
    });
    assert_eq!(ended[0], ended[1], "both end at the first update from {goal} on");
    ended[0]
}

/// Returns the timesteps per agent of the newest checkpoint of a run.
fn newest_checkpoint(stage: &Stage) -> u64 {
    let names = fs::read_dir(stage.run().join("checkpoints")).unwrap().map(|entry| entry.unwrap().file_name());
    let steps =
        names.filter_map(|name| name.to_str()?.strip_prefix("step_")?.strip_suffix(".safetensors")?.parse().ok());
    steps.max().expect("a run that was trained for a while has a checkpoint")
}

/// The samples of all processes.
struct Watch {
    file: fs::File,
    samples: BTreeMap<Who, Vec<Sample>>,
}

impl Watch {
    const FILE: &'static str = concat!(env!("CARGO_TARGET_TMPDIR"), "/soak.csv");

    fn new() -> Watch {
        let mut file = fs::File::create(Path::new(Watch::FILE)).unwrap();
        writeln!(file, "seconds,run,process,pid,pss_kib,rss_kib,descriptors,threads").unwrap();
        Watch { file, samples: BTreeMap::new() }
    }

    /// Takes a sample of the coordinator and of each worker.
    fn look(&mut self, time: Duration, run: &'static str, stage: &Stage, coordinator: &mut Process) {
        if coordinator.status().is_some() {
            return;
        }
        // A worker is known by its log, because after a kill it is another process.
        let mut processes = vec![("coordinator".to_owned(), coordinator.pid())];
        processes.extend(stage.workers().into_iter().filter_map(|pid| Some((worker_name(stage, pid)?, pid))));
        for (process, pid) in processes {
            let Some(sample) = sample(pid) else { continue };
            let Sample { pss_kib, rss_kib, descriptors, threads } = sample;
            let seconds = time.as_secs_f64();
            let number = pid.as_raw_nonzero();
            let line = format!("{seconds:.1},{run},{process},{number},{pss_kib},{rss_kib},{descriptors},{threads}");
            writeln!(self.file, "{line}").unwrap();
            self.samples.entry((run, process)).or_default().push(sample);
        }
    }

    /// Prints the medians of the first and the last third after warming up, and returns what has grown.
    fn grown(&self) -> Vec<String> {
        type Value = fn(&Sample) -> f64;
        let values: [(&str, Value, f64); 4] = [
            ("PSS in KiB", |sample| sample.pss_kib, MORE_KIB),
            ("RSS in KiB", |sample| sample.rss_kib, MORE_KIB),
            ("descriptors", |sample| sample.descriptors, MORE_DESCRIPTORS),
            ("threads", |sample| sample.threads, MORE_THREADS),
        ];
        let mut grown = Vec::new();
        println!("\n| run | process | value | first third | last third | most |\n|---|---|---|---|---|---|");
        for ((run, process), samples) in &self.samples {
            let warm = &samples[(samples.len() as f64 * WARM_UP) as usize..];
            assert!(warm.len() >= FEWEST, "{run}, {process}: {} samples say nothing: soak longer", warm.len());
            let third = warm.len() / 3;
            for (name, value, more) in values {
                let median_of = |part: &[Sample]| median(part.iter().map(value).collect());
                let (first, last) = (median_of(&warm[..third]), median_of(&warm[warm.len() - third..]));
                let most = samples.iter().map(value).fold(0.0, f64::max);
                println!("| {run} | {process} | {name} | {first} | {last} | {most} |");
                if last > first * GROWTH && last > first + more {
                    grown.push(format!("{run}, {process}: {name} grew from {first} to {last}"));
                }
            }
        }
        grown
    }
}

/// Returns the name of a worker by the log that it writes.
fn worker_name(stage: &Stage, pid: Pid) -> Option<String> {
    let log = fs::read_link(format!("/proc/{}/fd/2", pid.as_raw_nonzero())).ok()?;
    let name = log.strip_prefix(stage.run()).ok()?.to_str()?;
    Some(name.trim_end_matches(".log").replace('_', " "))
}

/// Returns what /proc says, or `None` if the process has ended.
fn sample(pid: Pid) -> Option<Sample> {
    let field = |file: &str, key: &str| -> Option<f64> {
        let text = String::from_utf8(proc(pid, file)).ok()?;
        let value = text.lines().find_map(|line| line.strip_prefix(key))?;
        value.split_whitespace().next()?.parse().ok()
    };
    let descriptors = fs::read_dir(format!("/proc/{}/fd", pid.as_raw_nonzero())).ok()?.count();
    Some(Sample {
        pss_kib: field("smaps_rollup", "Pss:")?,
        rss_kib: field("status", "VmRSS:")?,
        descriptors: descriptors as f64,
        threads: field("status", "Threads:")?,
    })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
