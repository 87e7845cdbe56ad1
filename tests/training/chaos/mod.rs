//! Runs that are killed, stopped and resumed again and again must end as if nobody had touched them.
//!
//! `chaos` takes a fraction of a minute. For longer, with a line for every disturbance and a table at the end:
//!
//! ```text
//! CHAOS_KILLS=200 cargo test --release --test training chaos -- --nocapture
//! SOAK_SECONDS=7200 cargo test --release --test training soak -- --ignored --nocapture
//! ```
//!
//! `CHAOS_SEED` draws other disturbances. The moments are drawn, too, but what a process does at that moment depends on
//! the machine. After a failure the directories are kept and named.
//!
//! | file | what it holds |
//! |---|---|
//! | `cards` | the kinds of disturbances, and how they are dealt |
//! | `stage` | a place of its own for a run; its processes, from start to end |
//! | `play` | one run that is disturbed until it is done |
//! | `experiment` | an experiment that is killed until it is done |
//! | `compare` | what a disturbed run must have in common with an undisturbed one |
//! | `book` | what happened, in lines and in a table |
//! | `soak` | a long training: memory, descriptors and threads over time |

mod book;
mod cards;
mod compare;
mod experiment;
mod play;
mod soak;
mod stage;

use std::collections::VecDeque;
use std::env;
use std::sync::Mutex;
use std::thread;
use std::time::Instant;

use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus as Dice;

use self::book::Book;
use self::cards::Card;
use self::play::{Play, Undisturbed};
use self::stage::Domain;

/// Number of disturbances that end or stop a process, unless `CHAOS_KILLS` says otherwise.
const KILLS: u64 = 12;
/// Seed of the disturbances, unless `CHAOS_SEED` says otherwise.
const SEED: u64 = 15;

/// Returns the number in an environment variable.
fn number(variable: &str, default: u64) -> u64 {
    match env::var(variable) {
        Ok(text) => text.parse().unwrap_or_else(|_| panic!("{variable}={text} must be a whole number")),
        Err(_) => default,
    }
}

#[test]
fn a_run_that_is_killed_and_resumed_at_random_ends_as_if_nobody_had_touched_it() {
    let (kills, seed) = (number("CHAOS_KILLS", KILLS), number("CHAOS_SEED", SEED));
    let begun = Instant::now();
    let book = Mutex::new(Book::default());
    let cards = cards::deal(&mut Dice::seed_from_u64(seed), kills);
    // Every second card for each domain. Both play at the same time.
    thread::scope(|scope| {
        for (number, domain) in Domain::ALL.into_iter().enumerate() {
            let mine: VecDeque<Card> = cards.iter().copied().skip(number).step_by(Domain::ALL.len()).collect();
            let (dice, book) = (Dice::seed_from_u64(seed + 1 + number as u64), &book);
            let player = thread::Builder::new().name(domain.name().to_owned());
            player.spawn_scoped(scope, move || play_all(domain, mine, dice, book)).unwrap();
        }
    });
    let book = book.into_inner().unwrap();
    println!("{}", book.table(begun.elapsed(), seed));
    assert!(book.findings().is_empty(), "CHAOS_SEED={seed} CHAOS_KILLS={kills}:\n{}", book.findings().join("\n"));
}

#[test]
fn an_experiment_that_is_killed_at_random_ends_as_if_nobody_had_touched_it() {
    let (kills, seed) = (number("CHAOS_KILLS", KILLS), number("CHAOS_SEED", SEED));
    // An experiment takes longer than a run.
    let findings = experiment::play(kills.div_ceil(5), Dice::seed_from_u64(seed));
    assert!(findings.is_empty(), "CHAOS_SEED={seed} CHAOS_KILLS={kills}:\n{}", findings.join("\n"));
}

/// Plays runs of a domain until all cards are played.
fn play_all(domain: Domain, mut cards: VecDeque<Card>, mut dice: Dice, book: &Mutex<Book>) {
    let undisturbed = Undisturbed::of(domain);
    while !cards.is_empty() {
        Play::new(&undisturbed, &mut dice, book).until_done(&mut cards);
    }
}
