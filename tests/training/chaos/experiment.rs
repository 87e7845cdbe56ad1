//! An experiment that is killed again and again until it is done.

use std::time::{Duration, Instant};

use rand::Rng;
use rand_xoshiro::Xoshiro256PlusPlus as Dice;
use rustix::process::Signal;

use super::compare::compare;
use super::play::SPAN;
use super::stage::{Domain, FOR_EVER, Process, Stage, path};

/// Most kills of one experiment.
const KILLS_OF_ONE: u64 = 4;
/// Timesteps per agent of each run: two periods.
const STEPS: u64 = 4_000;
const EXPERIMENT: &str = "seeds = [1]\ncontrollers = ['random']\ncontroller_episodes = 20\n\
                          [[grid]]\nconfigs = ['config.toml']\nsimulators = ['dials', 'gs']\n";

fn stage() -> Stage {
    let stage = Stage::new(&Domain::Warehouse.config(STEPS));
    std::fs::write(stage.path("experiment.toml"), EXPERIMENT).unwrap();
    stage
}

fn start(stage: &Stage) -> Process {
    let (file, out) = (path(&stage.path("experiment.toml")), path(&stage.runs()));
    stage.start(&["experiment", &file, "--out", &out, "--cores", "2"].map(str::to_owned))
}

/// Plays experiments until this many kills are spent. Returns what is wrong with them.
pub(super) fn play(mut kills: u64, mut dice: Dice) -> Vec<String> {
    let undisturbed = stage();
    let begun = Instant::now();
    let mut process = start(&undisturbed);
    let status = process.ended_within(FOR_EVER);
    assert!(status.is_some_and(|status| status.success()), "{}", process.said());
    let took = begun.elapsed();
    let mut findings = Vec::new();
    while kills > 0 {
        let of_this = kills.min(KILLS_OF_ONE);
        kills -= of_this;
        findings.extend(play_one(of_this, &undisturbed, took, &mut dice));
    }
    findings
}

/// Kills an experiment at drawn moments, lets it finish and compares it with the undisturbed one.
fn play_one(kills: u64, undisturbed: &Stage, took: Duration, dice: &mut Dice) -> Vec<String> {
    let mut stage = stage();
    let mut findings = Vec::new();
    for _ in 0..kills {
        let moment = took.mul_f64(SPAN * dice.random::<f64>());
        let mut process = start(&stage);
        if !process.lives_for(moment) {
            break; // It is done, or it failed, and then it fails again below.
        }
        process.signal(Signal::KILL);
        process.ended_within(FOR_EVER);
        println!("experiment killed after {:>5} ms", moment.as_millis());
        let orphans = stage.orphans();
        if orphans > 0 {
            findings.push(format!("{orphans} processes outlive their experiment"));
        }
    }
    let mut process = start(&stage);
    let status = process.ended_within(FOR_EVER);
    if status.is_some_and(|status| status.success()) {
        findings.extend(compare(undisturbed, &stage).into_iter().map(|(fault, words)| format!("{fault:?}: {words}")));
    } else {
        findings.push(format!("it ended by {status:?}:\n{}", process.said()));
    }
    if !findings.is_empty() {
        findings.insert(0, format!("in {}:", stage.keep().display()));
    }
    findings
}
