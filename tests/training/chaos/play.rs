//! One run that is disturbed until it is done.

use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::sync::Mutex;
use std::time::{Duration, Instant, SystemTime};

use rand::Rng;
use rand::seq::IndexedRandom;
use rand_xoshiro::Xoshiro256PlusPlus as Dice;
use rustix::process::Signal;

use super::book::{Book, Fault};
use super::cards::Card;
use super::compare::compare;
use super::stage::{Domain, FOR_EVER, Process, Stage, path};

/// Seconds that a worker may be silent. One that is only slow and replaced for it changes no file, but three in a row
/// end a run, and a machine under load is slow.
const PATIENCE: u64 = 10;
/// Moments are drawn from this share of an undisturbed run's time.
pub(super) const SPAN: f64 = 0.6;

/// A run that nobody disturbs, in a single process.
pub(super) struct Undisturbed {
    domain: Domain,
    pub stage: Stage,
    took: Duration,
}

impl Undisturbed {
    pub(super) fn of(domain: Domain) -> Undisturbed {
        let stage = Stage::new(&domain.config(domain.steps()));
        let begun = Instant::now();
        let mut process = stage.train(0, 600);
        let status = process.ended_within(FOR_EVER);
        assert!(status.is_some_and(|status| status.success()), "{}", process.said());
        Undisturbed { domain, stage, took: begun.elapsed() }
    }
}

/// A run and its disturbances.
pub(super) struct Play<'a> {
    undisturbed: &'a Undisturbed,
    dice: &'a mut Dice,
    book: &'a Mutex<Book>,
    stage: Stage,
    coordinator: Option<Process>,
    /// Signals that this process was sent.
    sent: Vec<Signal>,
    workers: u64,
    starts: usize,
    done: bool,
    faulty: bool,
}

impl<'a> Play<'a> {
    pub(super) fn new(undisturbed: &'a Undisturbed, dice: &'a mut Dice, book: &'a Mutex<Book>) -> Play<'a> {
        Play {
            stage: Stage::new(&undisturbed.domain.config(undisturbed.domain.steps())),
            undisturbed,
            dice,
            book,
            coordinator: None,
            sent: Vec::new(),
            workers: 0,
            starts: 0,
            done: false,
            faulty: false,
        }
    }

    /// Plays a few cards that fit, lets the run finish, and compares it with the undisturbed one. A card whose moment
    /// does not come any more goes back.
    pub(super) fn until_done(mut self, cards: &mut VecDeque<Card>) {
        let count = self.dice.random_range(3..=8);
        for _ in 0..count {
            let Some(place) = cards.iter().position(|&card| self.fits(card)) else { break };
            let card = cards.remove(place).expect("it has this place");
            match self.play(card) {
                Some(words) => self.book.lock().unwrap().disturbed(self.undisturbed.domain, card, &words),
                None => cards.push_front(card),
            }
            if self.done || self.faulty {
                break;
            }
        }
        while !self.done && !self.faulty {
            self.make_it_run(false);
            self.end();
        }
        if self.done {
            for (fault, words) in compare(&self.undisturbed.stage, &self.stage) {
                self.found(fault, &words);
            }
        }
        self.book.lock().unwrap().done(self.starts);
    }

    fn found(&mut self, fault: Fault, words: &str) {
        self.faulty = true;
        let words = format!("{}: {words}", self.stage.keep().display());
        self.book.lock().unwrap().found(fault, words);
    }

    fn fits(&self, card: Card) -> bool {
        match &self.coordinator {
            Some(_) if card.needs_a_worker() => self.workers > 0,
            Some(_) => !card.needs_a_start(),
            None => true,
        }
    }

    fn make_it_run(&mut self, with_workers: bool) {
        if self.coordinator.is_none() {
            self.workers = self.dice.random_range(u64::from(with_workers)..=3);
            self.coordinator = Some(self.stage.train(self.workers, PATIENCE));
            self.starts += 1;
            self.sent.clear();
        }
    }

    fn running(&mut self) -> &mut Process {
        self.coordinator.as_mut().expect("it was made to run")
    }

    /// Returns a drawn part of a time.
    fn part_of(&mut self, time: Duration) -> Duration {
        time.mul_f64(self.dice.random())
    }

    fn signal(&mut self, signal: Signal) {
        self.sent.push(signal);
        self.running().signal(signal);
    }

    /// Disturbs the run and returns what happened. If the run ends before the moment has come: `None`.
    fn play(&mut self, card: Card) -> Option<String> {
        let before = modified(&self.stage.runs());
        self.make_it_run(card.needs_a_worker());
        let moment = match card {
            Card::KillAtStart => self.part_of(Duration::from_millis(40)),
            Card::KillAtFirstWrite => Duration::ZERO,
            _ => self.part_of(self.undisturbed.took.mul_f64(SPAN)),
        };
        let mut lives = self.running().lives_for(moment);
        let writes = match card {
            Card::KillAtFirstWrite => Some((self.stage.runs(), before)),
            Card::KillAtCheckpoint => {
                let folder = self.stage.run().join("checkpoints");
                let before = modified(&folder);
                Some((folder, before))
            }
            _ => None,
        };
        if let Some((folder, before)) = writes {
            let a_bit = self.part_of(Duration::from_millis(3));
            lives = lives && self.running().lives_until(|| modified(&folder) != before);
            lives = lives && self.running().lives_for(a_bit);
        }
        if !lives {
            self.end();
            return None;
        }
        let (age, newest) = (self.running().age().as_millis(), newest_checkpoint(&self.stage.run()));
        let place = format!("{} workers, after {age:>5} ms, {newest:<13}", self.workers);
        let outcome = match card {
            Card::Kill | Card::KillAtStart | Card::KillAtFirstWrite | Card::KillAtCheckpoint => {
                self.signal(Signal::KILL);
                self.end()
            }
            Card::Terminate => {
                self.signal(Signal::TERM);
                self.end()
            }
            Card::Interrupt => {
                self.signal(Signal::INT);
                self.end()
            }
            Card::InterruptTwice => {
                self.signal(Signal::INT);
                // Within two seconds both count as one.
                let between = self.part_of(Duration::from_secs(4));
                if self.running().lives_for(between) {
                    self.signal(Signal::INT);
                }
                self.end()
            }
            Card::KillWorker => self.signal_a_worker(Signal::KILL)?,
            Card::StopWorker => self.signal_a_worker(Signal::STOP)?,
            Card::Pause => {
                self.signal(Signal::STOP);
                let pause = self.part_of(Duration::from_secs(PATIENCE + 1));
                std::thread::sleep(pause);
                self.signal(Signal::CONT);
                format!("paused for {} ms", pause.as_millis())
            }
            Card::SecondResume => self.resume_twice(),
            Card::Evaluate => self.beside(&["evaluate", "RUN", "--episodes", "2"]),
            Card::Report => self.beside(&["report", "RUN", "--out", "REPORT"]),
        };
        Some(format!("{place}: {outcome}"))
    }

    /// Signals one of the workers as soon as there is one.
    fn signal_a_worker(&mut self, signal: Signal) -> Option<String> {
        let stage = &self.stage;
        let mut workers = Vec::new();
        let lives = self.coordinator.as_mut().expect("it runs").lives_until(|| {
            workers = stage.workers();
            !workers.is_empty()
        });
        if !lives {
            self.end();
            return None;
        }
        let worker = *workers.choose(self.dice).expect("there is one");
        // It may have ended already.
        let _ = rustix::process::kill_process(worker, signal);
        Some(format!("worker {} of {}", workers.iter().position(|&pid| pid == worker)?, workers.len()))
    }

    /// Waits for the end of the coordinator and returns how it ended. Notes what is wrong with that.
    fn end(&mut self) -> String {
        let mut process = self.coordinator.take().expect("it was made to run");
        let ended = process.ended_within(FOR_EVER);
        let orphans = self.stage.orphans();
        if orphans > 0 {
            self.found(Fault::Orphan, &format!("{orphans} processes outlive their coordinator"));
        }
        self.judge(ended, &process.said())
    }

    fn judge(&mut self, ended: Option<ExitStatus>, said: &str) -> String {
        let stopped = self.sent.contains(&Signal::INT) || self.sent.contains(&Signal::TERM);
        let by_our_signal = |signal: &i32| self.sent.iter().any(|sent| sent.as_raw() == *signal);
        match ended {
            _ if said.contains("panicked at") => self.failed("a panic", said),
            None => self.failed("a hang", said),
            Some(status) if status.success() => {
                self.done = true;
                "done".to_owned()
            }
            Some(status) if status.signal().as_ref().is_some_and(by_our_signal) => "killed".to_owned(),
            Some(status) if status.code() == Some(130) && stopped => "stopped".to_owned(),
            // Three lost workers at the same order: it says so, and the run can be resumed.
            Some(status) if status.code() == Some(1) && said.contains("gave up after 3 deaths in a row") => {
                "gave up after three lost workers".to_owned()
            }
            Some(status) => self.failed(&format!("an end without a reason ({status})"), said),
        }
    }

    fn failed(&mut self, what: &str, said: &str) -> String {
        let said = said.trim_end().replace('\n', "\n    ");
        self.found(Fault::Failure, &format!("{what}:\n    {said}"));
        what.to_owned()
    }

    /// Starts a second process for the same run. One of the two must be refused.
    fn resume_twice(&mut self) -> String {
        let workers = self.dice.random_range(0..=3);
        let mut second = self.stage.train(workers, PATIENCE);
        let begun = Instant::now();
        loop {
            assert!(begun.elapsed() < FOR_EVER, "two processes write one run: {}", self.stage.keep().display());
            let first_ended = self.running().status();
            if let Some(status) = second.status() {
                // The first one may have been done before the second began.
                let after_the_end = status.success() && self.running().ended_within(FOR_EVER).is_some();
                return match refused(status, &second.said()) {
                    Some(reason) => format!("the second was refused: {reason}"),
                    None if after_the_end => "the first was done before".to_owned(),
                    None => self.failed(&format!("a second process ended by {status}"), &second.said()),
                };
            }
            if let Some(status) = first_ended.filter(|status| !status.success()) {
                let said = self.running().said();
                let Some(reason) = refused(status, &said) else {
                    return self.failed(&format!("the first of two processes ended by {status}"), &said);
                };
                (self.coordinator, self.workers) = (Some(second), workers);
                return format!("the first was refused: {reason}");
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Runs another subcommand beside the training. It may find too little, and then says so in one error.
    fn beside(&mut self, words: &[&str]) -> String {
        let report = path(&self.stage.path(&format!("report-{}", self.starts)));
        let words = words.iter().map(|&word| match word {
            "RUN" => path(&self.stage.run()),
            "REPORT" => report.clone(),
            word => word.to_owned(),
        });
        let mut process = self.stage.start(&words.collect::<Vec<_>>());
        let status = process.ended_within(FOR_EVER);
        let said = process.said();
        let error = said.lines().find(|line| line.starts_with("error: "));
        match (status.and_then(|status| status.code()), error) {
            (Some(0), _) => "done".to_owned(),
            (Some(1 | 2), Some(error)) => format!("refused: {}", error.replace(&path(&self.stage.run()), "RUN")),
            _ => self.failed(&format!("it ended by {status:?}"), &said),
        }
    }
}

/// Returns why a second process for the same run was refused.
fn refused(status: ExitStatus, said: &str) -> Option<&'static str> {
    match status.code() {
        Some(1) if said.contains("another process is writing this run") => Some("another process writes"),
        // There is nothing to resume yet, or a new run finds the directory of the other.
        Some(2) if said.contains("error: ") => Some("too early to resume"),
        _ => None,
    }
}

/// Returns what can be seen of the files within a folder without reading them.
fn modified(folder: &Path) -> BTreeMap<PathBuf, (u64, Option<SystemTime>)> {
    let mut found = BTreeMap::new();
    let Ok(entries) = fs::read_dir(folder) else { return found };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        let Ok(metadata) = path.symlink_metadata() else { continue };
        if metadata.is_dir() {
            found.extend(modified(&path));
        }
        found.insert(path, (metadata.len(), metadata.modified().ok()));
    }
    found
}

/// Returns the timesteps of the newest checkpoint, in words.
fn newest_checkpoint(run: &Path) -> String {
    let names = fs::read_dir(run.join("checkpoints")).into_iter().flatten();
    let names = names.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let steps = names.filter_map(|name| name.strip_prefix("step_")?.split('.').next()?.parse::<u64>().ok());
    steps.max().map_or("no checkpoint".to_owned(), |steps| format!("step {steps}"))
}
