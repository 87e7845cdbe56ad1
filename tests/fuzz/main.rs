//! Fuzzing: files and messages that others wrote, mutated by the thousand, are refused or read right.
//!
//! A *target* is a function that takes the bytes of one input to the place where a user would put them: a library
//! function, or the program. Inputs are real files, the saved ones of `corpus/`, and mutations of both. Nothing may
//! panic, abort, hang, take memory without bounds, touch a file outside, or be accepted and mean something else.
//!
//! - `targets`: what is fuzzed. `verdict`: what a target answers.
//! - `mutate`, `text`, `xml`, `hostile`: how an input becomes another one.
//! - `driver`: child processes that try inputs, their deadlines, and what is kept. `child`: the loop in such a process.
//! - `place`: the folder in which a child works, and what lies outside. `program`: the program, run in there.
//! - `run`: a small trained run, from which seeds are taken.
//!
//! | variable | meaning |
//! |---|---|
//! | `FUZZ_SECONDS` | how long to fuzz in all; without it, each target gets a fixed number of inputs, in seconds |
//! | `FUZZ_SEED` | other inputs; without it they are the same at every start |
//! | `FUZZ_DEADLINE` | seconds after which an input counts as a hang, 60 if it is not set |
//!
//! `docs/reliability.md` says how to use it.

mod child;
mod driver;
mod hostile;
mod mutate;
mod place;
mod program;
mod run;
mod targets;
mod text;
mod verdict;
mod xml;

use targets::TARGETS;

/// Makes a test of each target, so that they run side by side and can be chosen by name.
macro_rules! fuzz {
    ($($name:ident),* $(,)?) => {
        $(#[test]
        fn $name() {
            driver::fuzz(stringify!($name));
        })*

        #[test]
        fn every_target_is_a_test() {
            let tests = [$(stringify!($name)),*];
            assert_eq!(TARGETS.iter().map(|target| target.name).collect::<Vec<_>>(), tests);
        }
    };
}

fuzz!(
    config,
    net,
    local_net,
    routes,
    local_routes,
    actuated,
    timings,
    experiment,
    returns_csv,
    episodes_csv,
    aip_loss_csv,
    aip_drift_csv,
    timing_csv,
    memory_csv,
    kept_config,
    run_json,
    plan_json,
    baseline_json,
    resume,
    checkpoint,
    crafted,
    policies,
    aips,
    orders,
    reports,
);

/// Not a test: the process that tries inputs, started by the others.
#[test]
#[ignore = "the other tests start it"]
fn child_process() {
    child::main();
}
