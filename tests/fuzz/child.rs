//! The process that tries inputs, one after another, and says how each went.

use std::collections::{BTreeMap, BTreeSet};
use std::env;
use std::fs;
use std::panic::{self, AssertUnwindSafe, PanicHookInfo};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::thread;
use std::time::{Duration, Instant};

use dials_session::machine::limit_memory;
use rustix::process::{Signal, set_parent_process_death_signal};

use super::driver::{BEGUN, CHILD, ENDED, FAILED, Order, save};
use super::mutate::{Pool, mutated};
use super::place::check_outside;
use super::targets::Target;
use super::verdict::{Verdict, kind_of};

/// Memory that the child may take beyond what it has when it begins: much more than any input needs.
const MEMORY: u64 = 1 << 30;
/// Stack of the main thread of a program, on which users' files are read.
const STACK: usize = 8 << 20;
/// Number of inputs that are saved of each kind of failure.
const SAVED: usize = 3;
/// Largest size of an input of which others are made, and of a seed.
const LARGEST: usize = 1 << 16;
const LARGEST_SEED: usize = 1 << 20;

/// File with the input under way, in the folder above the one to work in.
pub const CURRENT: &str = "input";

/// Place and words of the last panic.
static PANIC: Mutex<String> = Mutex::new(String::new());

pub fn main() {
    let Ok(order) = env::var(CHILD) else { return };
    let order: Order = serde_json::from_str(&order).expect("the driver wrote it");
    set_parent_process_death_signal(Some(Signal::KILL)).expect("Linux can do that");
    panic::set_hook(Box::new(note));
    let trying = thread::Builder::new().stack_size(STACK).spawn(move || try_all(&order)).expect("a thread");
    trying.join().expect("panics are caught");
    println!("{ENDED}");
}

fn note(info: &PanicHookInfo<'_>) {
    let payload = info.payload();
    let text = payload.downcast_ref::<String>().map(String::as_str).or_else(|| payload.downcast_ref::<&str>().copied());
    let words = text.unwrap_or("a panic without words");
    let place = info.location().map_or(String::new(), |place| format!("{}:{}: ", place.file(), place.line()));
    let told = format!("{place}{words}");
    eprintln!("{told}");
    *PANIC.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = told;
}

fn try_all(order: &Order) {
    let target = Target::named(&order.target);
    let seeds = (target.seeds)();
    let corpus = corpus(target.name);
    limit_memory(MEMORY).expect("a lower limit is allowed");
    let as_they_are: Vec<Vec<u8>> = seeds.iter().cloned().chain(corpus).chain((target.more)()).collect();
    let mut pool = Pool::new(as_they_are.iter().filter(|bytes| bytes.len() <= LARGEST_SEED).cloned().collect());
    let (mut kinds, mut failures) = (BTreeSet::new(), BTreeMap::<String, usize>::new());
    let end = Instant::now() + Duration::from_secs_f64(order.seconds);
    for index in order.first..order.end {
        // A child that was started again does not try the seeds again, but its first ones are quickly found new again.
        let saved = as_they_are.get(index as usize);
        if saved.is_none() && Instant::now() > end {
            break;
        }
        let bytes = saved.cloned().unwrap_or_else(|| mutated(target.form, &pool, order.seed, index));
        fs::write(Path::new("..").join(CURRENT), &bytes).expect("a file to work with");
        println!("{BEGUN} {index}");
        let tried = panic::catch_unwind(AssertUnwindSafe(|| {
            let verdict = (target.call)(&bytes);
            check_outside();
            verdict
        }));
        let tried = tried.map(|verdict| match &verdict {
            Verdict::Refused(error) if index < seeds.len() as u64 => Err(format!("a seed is refused: {error}")),
            _ => Ok(verdict),
        });
        let message = match tried {
            Ok(Ok(verdict)) => {
                let accepted = matches!(verdict, Verdict::Accepted);
                println!("{index} {}", if accepted { "accepted" } else { "refused" });
                if bytes.len() <= LARGEST && (kinds.insert(verdict.kind()) || accepted) {
                    pool.take(bytes, accepted);
                }
                continue;
            }
            Ok(Err(refused)) => refused,
            Err(_) => PANIC.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone(),
        };
        let message = message.replace('\n', " ");
        let before = failures.entry(kind_of(&message)).or_default();
        *before += 1;
        if *before <= SAVED {
            save(&order.target, order.seed, index, &bytes, &message);
        }
        println!("{FAILED} {index} {message}");
    }
}

/// Returns the saved inputs of a target, in the order of their names.
fn corpus(target: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/corpus").join(target);
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).expect("a readable file")).collect()
}
