//! One target after the other side: starts children that try its inputs, and notes what becomes of them.

use std::collections::BTreeMap;
use std::env;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::str::FromStr;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::child::CURRENT;
use super::targets::{TARGETS, Target};
use super::verdict::kind_of;
use super::{place, program, run};

/// Variable with the [`Order`] of a child.
pub const CHILD: &str = "FUZZ_CHILD";
/// Beginnings of the lines that a child prints.
pub const BEGUN: &str = "begun";
pub const FAILED: &str = "failed";
pub const ENDED: &str = "ended";

/// Number of children of a target that may die before it is given up.
const DEATHS: usize = 25;
/// Seed of the inputs that are tried at every start of the tests.
const SEED: u64 = 15;

/// What a child must try.
#[derive(Serialize, Deserialize)]
pub struct Order {
    pub target: String,
    pub seed: u64,
    /// Numbers of the first input, and of the one after the last.
    pub first: u64,
    pub end: u64,
    /// Time after which no further mutation is tried.
    pub seconds: f64,
}

/// How many inputs went how.
#[derive(Default)]
struct Tally {
    accepted: u64,
    refused: u64,
    /// Failures by kind: their number, and the message of the first.
    failures: BTreeMap<String, (u64, String)>,
    deaths: usize,
}

/// Returns the time after which an input counts as a hang.
pub fn deadline() -> Duration {
    Duration::from_secs(variable("FUZZ_DEADLINE").unwrap_or(60))
}

fn variable<T: FromStr>(name: &str) -> Option<T> {
    let text = env::var(name).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{name} = {text}: must be a number")))
}

/// Fuzzes one target, and panics if an input of it failed.
pub fn fuzz(name: &str) {
    let target = Target::named(name);
    let long: Option<f64> = variable("FUZZ_SECONDS");
    let now = || SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_nanos() as u64);
    let seed = variable("FUZZ_SEED").unwrap_or_else(|| if long.is_some() { now() } else { SEED });
    let lanes = variable("RUST_TEST_THREADS").or_else(|| Some(std::thread::available_parallelism().ok()?.get()));
    let share = lanes.unwrap_or(1).min(TARGETS.len()) as f64 / TARGETS.len() as f64;
    let seconds = long.map_or(f64::INFINITY, |seconds| seconds * share);
    let mut order =
        Order { target: name.to_owned(), seed, first: 0, end: long.map_or(target.short, |_| u64::MAX), seconds };
    // JSON has no infinity.
    order.seconds = order.seconds.min(1e9);
    let (begun, mut tally) = (Instant::now(), Tally::default());
    while let Some(died_at) = tally.watch(&order) {
        tally.deaths += 1;
        order.first = died_at + 1;
        order.seconds = (seconds - begun.elapsed().as_secs_f64()).clamp(0.0, 1e9);
        if order.first >= order.end || order.seconds == 0.0 || tally.deaths == DEATHS {
            break;
        }
    }
    let failed: u64 = tally.failures.values().map(|(count, _)| count).sum();
    let (accepted, refused) = (tally.accepted, tally.refused);
    println!(
        "{name}: {} inputs of seed {seed} in {:.0} s: {accepted} accepted, {refused} refused, {failed} failed",
        accepted + refused + failed,
        begun.elapsed().as_secs_f64()
    );
    let told = tally.failures.values().map(|(count, message)| format!("\n{count} times: {message}"));
    let told: String = told.collect();
    assert!(failed == 0, "{name}: {failed} inputs failed; they are in {}{told}", folder_of(name).display());
}

impl Tally {
    /// Starts a child and notes what it says. If it died or hung: the number of the input that it had begun.
    fn watch(&mut self, order: &Order) -> Option<u64> {
        let root = tempfile::tempdir().expect("a temporary folder");
        let mut child = start(order, root.path());
        let lines = lines_of(&mut child);
        let mut under_way = order.first;
        // The child itself ends a program that hangs, and says so.
        let patience = deadline() + Duration::from_secs(10);
        let message = loop {
            match lines.recv_timeout(patience) {
                Ok(line) => match line.split_once(' ').unwrap_or((&line, "")) {
                    (ENDED, _) => {
                        child.wait().expect("a child of this process");
                        return None;
                    }
                    (BEGUN, index) => under_way = index.parse().expect("a number"),
                    (FAILED, rest) => self.note(rest.split_once(' ').map_or(rest, |(_, message)| message)),
                    (_, "accepted") => self.accepted += 1,
                    (_, "refused") => self.refused += 1,
                    // A line of the test harness.
                    _ => {}
                },
                Err(RecvTimeoutError::Timeout) => break "it hangs".to_owned(),
                Err(RecvTimeoutError::Disconnected) => break death(&mut child, root.path()),
            }
        };
        program::end(&mut child);
        let bytes = fs::read(root.path().join(CURRENT)).unwrap_or_default();
        self.note(&message);
        if self.failures[&kind_of(&message)].0 <= 3 {
            save(&order.target, order.seed, under_way, &bytes, &message);
        }
        Some(under_way)
    }

    fn note(&mut self, message: &str) {
        self.failures.entry(kind_of(message)).or_insert((0, message.chars().take(700).collect())).0 += 1;
    }
}

fn start(order: &Order, root: &Path) -> Child {
    let work = place::make(root);
    let stderr = File::create(root.join("stderr")).expect("a new file");
    let mut command = Command::new(env::current_exe().expect("this test"));
    command.args(["child_process", "--exact", "--ignored", "--nocapture"]);
    command.env(CHILD, serde_json::to_string(order).expect("numbers and names")).env(run::RUNS, run::make());
    command.current_dir(work).process_group(0).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(stderr);
    command.spawn().expect("this test can be started")
}

fn lines_of(child: &mut Child) -> Receiver<String> {
    let stdout = BufReader::new(child.stdout.take().expect("it is piped"));
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        // What a dying child wrote last may be no text.
        stdout.split(b'\n').map_while(Result::ok).for_each(|line| {
            let _ = sender.send(String::from_utf8_lossy(&line).into_owned());
        });
    });
    receiver
}

/// Returns how a child ended, with its last words.
fn death(child: &mut Child, root: &Path) -> String {
    let status = child.wait().expect("a child of this process");
    let said = fs::read(root.join("stderr")).unwrap_or_default();
    let said = String::from_utf8_lossy(&said);
    let mut last: Vec<&str> = said.lines().rev().filter(|line| !line.trim().is_empty()).take(3).collect();
    last.reverse();
    let end = status.signal().map_or(status.to_string(), |signal| format!("signal {signal}"));
    format!("the process died: {end}: {}", last.join(" "))
}

/// Saves an input that failed, with the reason beside it.
pub fn save(target: &str, seed: u64, index: u64, bytes: &[u8], reason: &str) {
    let folder = folder_of(target);
    fs::create_dir_all(&folder).expect("the target folder is writable");
    let path = folder.join(format!("{seed}-{index}"));
    fs::write(&path, bytes).expect("the target folder is writable");
    fs::write(path.with_extension("reason"), format!("{reason}\n")).expect("the target folder is writable");
}

fn folder_of(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("target/fuzz").join(target)
}
