//! Fuzzing: files and messages that others wrote, mutated by the thousand, are refused or read right.
//!
//! A *target* is a function that takes the bytes of one input to the place where a user would put them: a library
//! function, or the program. Inputs are real files, the saved ones of `corpus/`, and mutations of both. Nothing may
//! panic, abort, hang, take memory without bounds, touch a file outside, or be accepted and mean something else.
//!
//! proptest draws the mutations, tries them in a child process, and looks for the fewest that fail.
//!
//! - `mutate`: how an input becomes another one; `hostile.json`: values that programs stumble over.
//! - `place`: the folder in which inputs are tried, what lies outside, and the program, run in there.
//! - `texts`, `networks`, `numbers`, `report`, `runs`, `messages`, `http`: the targets.
//!
//! `docs/reliability.md` says how to fuzz for longer.

mod http;
mod messages;
mod mutate;
mod networks;
mod numbers;
mod place;
mod report;
mod runs;
mod texts;

use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::{env, fs};

use dials_session::machine::limit_memory;
use proptest::strategy::{Just, Strategy};
use proptest::test_runner::{Config, RngSeed, TestError, TestRunner};

use mutate::Form;
use place::Place;

/// Memory that may be taken beyond what the process has when it begins: much more than any input needs.
const MEMORY: u64 = 1 << 30;
/// Milliseconds after which an input counts as a hang.
const DEADLINE_MS: u32 = 120_000;
/// Seed of the mutations, unless `PROPTEST_RNG_SEED` says otherwise.
const SEED: u64 = 15;
/// Largest input that is mutated.
const LARGEST: usize = 1 << 20;

/// Something that reads what others wrote.
#[derive(Clone, Copy)]
struct Target {
    name: &'static str,
    form: Form,
    /// Number of mutations that are tried, unless `FUZZ_TIMES` multiplies it.
    cases: u32,
    /// Returns inputs that must be accepted.
    seeds: fn(&Place) -> Vec<Vec<u8>>,
    /// Returns further inputs, which may be refused.
    more: fn(&Place) -> Vec<Vec<u8>>,
    /// Returns why an input is refused, and panics if it leads to what must not happen.
    call: fn(&Place, &[u8]) -> anyhow::Result<()>,
}

impl Target {
    /// Returns the inputs as they are: the seeds, the saved ones in the order of their names, and the further ones.
    fn inputs(&self, place: &Place) -> Vec<Vec<u8>> {
        let folder = of_project("tests/fuzz/corpus").join(self.name);
        let entries = fs::read_dir(folder).into_iter().flatten();
        let mut saved: Vec<PathBuf> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
        saved.sort();
        let saved = saved.into_iter().map(|path| fs::read(path).expect("a readable file"));
        (self.seeds)(place).into_iter().chain(saved).chain((self.more)(place)).collect()
    }

    fn try_one(&self, place: &Place, bytes: &[u8], is_seed: bool) {
        let tried = (self.call)(place, bytes);
        place.check_outside();
        let Err(error) = tried else { return };
        assert!(!is_seed, "a seed is refused: {error:#}");
        assert!(!format!("{error:#}").trim().is_empty(), "it is refused without a word");
    }

    fn try_saved(&self, place: &Place) {
        let seeds = (self.seeds)(place).len();
        for (number, bytes) in self.inputs(place).iter().enumerate() {
            // The last line names the input if the process dies.
            eprintln!("{}, input {number}", self.name);
            self.try_one(place, bytes, number < seeds);
        }
    }

    fn try_mutations(&self, test: &'static str) {
        let times = variable("FUZZ_TIMES").unwrap_or(1);
        let tried = OnceCell::new();
        let target = *self;
        let outcome = runner(test, self.cases * times, DEADLINE_MS).run(&mutate::cases(self.form), move |case| {
            let (place, inputs) = tried.get_or_init(|| {
                let place = Place::new();
                let mut inputs = target.inputs(&place);
                inputs.retain(|bytes| bytes.len() <= LARGEST);
                limit_memory(MEMORY).expect("a lower limit is allowed");
                (place, inputs)
            });
            target.try_one(place, &case.bytes(inputs, target.form), false);
            Ok(())
        });
        match outcome {
            Ok(()) => {}
            Err(TestError::Abort(reason)) => panic!("{}: {reason}", self.name),
            Err(TestError::Fail(reason, case)) => {
                let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fuzz_{}", self.name));
                let mut inputs = self.inputs(&Place::new());
                inputs.retain(|bytes| bytes.len() <= LARGEST);
                fs::write(&path, case.bytes(&inputs, self.form)).expect("the target folder is writable");
                panic!("{}: {reason}\nwith the input {}\nmade by {case:?}", self.name, path.display());
            }
        }
    }
}

fn variable(name: &str) -> Option<u32> {
    let text = env::var(name).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{name}={text}: must be a whole number")))
}

/// Returns what tries cases in a child process. `test`: path of the test that calls it.
fn runner(test: &'static str, cases: u32, deadline_ms: u32) -> TestRunner {
    let mut config = Config { cases, fork: true, timeout: deadline_ms, test_name: Some(test), ..Config::default() };
    config.failure_persistence = None;
    // An input that ends the process costs a new one.
    config.max_shrink_iters = 200;
    if config.rng_seed == RngSeed::Random && env::var_os("FUZZ_TIMES").is_none() {
        config.rng_seed = RngSeed::Fixed(SEED);
    }
    TestRunner::new(config)
}

/// Returns a file or folder of this project.
fn of_project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Reads files of this project.
fn read_all(paths: &[&str]) -> Vec<Vec<u8>> {
    let read = |path: &&str| fs::read(of_project(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
    paths.iter().map(read).collect()
}

/// Lists the targets, and makes a test of each, so that they run side by side and can be chosen by name.
macro_rules! targets {
    ($($name:ident: $form:ident, $cases:literal, $call:expr, $seeds:expr, $more:expr;)*) => {
        const TARGETS: &[Target] = &[$(Target {
            name: stringify!($name), form: Form::$form, cases: $cases, seeds: $seeds, more: $more, call: $call,
        }),*];

        $(#[test]
        fn $name() {
            let target = TARGETS.iter().find(|target| target.name == stringify!($name));
            target.expect("it is in the list").try_mutations(concat!(module_path!(), "::", stringify!($name)));
        })*
    };
}

targets! {
    config: Text, 400, texts::config, texts::config_seeds, none;
    timings: Text, 400, texts::timings, texts::timings_seeds, none;
    experiment: Text, 300, texts::experiment, texts::experiment_seeds, none;
    net: Xml, 60, networks::net, networks::net_seeds, networks::deep_nest;
    local_net: Xml, 60, networks::local_net, networks::local_net_seeds, networks::deep_nest;
    routes: Xml, 60, networks::routes, networks::routes_seeds, networks::deep_nest;
    local_routes: Xml, 60, networks::local_routes, networks::local_routes_seeds, networks::deep_nest;
    actuated: Xml, 60, networks::actuated, networks::actuated_seeds, networks::deep_nest;
    vehicle_types: Xml, 40, numbers::vehicle_types, numbers::vehicle_types_seeds, numbers::all_of_a_type;
    sumo_options: Xml, 40, numbers::sumo_options, numbers::sumo_options_seeds, none;
    returns_csv: Text, 80, report::returns_csv, report::returns_csv_seeds, none;
    episodes_csv: Text, 80, report::episodes_csv, report::episodes_csv_seeds, none;
    aip_loss_csv: Text, 80, report::aip_loss_csv, report::aip_loss_csv_seeds, none;
    aip_drift_csv: Text, 80, report::aip_drift_csv, report::aip_drift_csv_seeds, none;
    timing_csv: Text, 80, report::timing_csv, report::timing_csv_seeds, none;
    memory_csv: Text, 80, report::memory_csv, report::memory_csv_seeds, none;
    kept_config: Text, 80, report::kept_config, report::kept_config_seeds, none;
    run_json: Text, 80, report::run_json, report::run_json_seeds, none;
    plan_json: Text, 80, report::plan_json, report::plan_json_seeds, none;
    baseline_json: Text, 80, report::baseline_json, report::baseline_json_seeds, none;
    resume: Text, 14, runs::resume, runs::resume_seeds, none;
    checkpoint: Tensors, 600, runs::checkpoint, runs::checkpoint_seeds, runs::strangers;
    crafted: Text, 24, runs::crafted, runs::crafted_seeds, none;
    policies: Tensors, 400, runs::policies, runs::policies_seeds, none;
    aips: Tensors, 400, runs::aips, runs::aips_seeds, none;
    orders: Messages, 400, messages::orders, messages::orders_seeds, none;
    reports: Messages, 400, messages::reports, messages::reports_seeds, none;
    http: Text, 4000, http::http, http::http_seeds, http::refused;
}

fn none(_: &Place) -> Vec<Vec<u8>> {
    Vec::new()
}

#[test]
fn every_input_as_it_is() {
    let outcome = runner(concat!(module_path!(), "::every_input_as_it_is"), 1, 10 * DEADLINE_MS).run(
        &Just(()).no_shrink(),
        |()| {
            let place = Place::new();
            limit_memory(MEMORY).expect("a lower limit is allowed");
            TARGETS.iter().for_each(|target| target.try_saved(&place));
            Ok(())
        },
    );
    outcome.unwrap_or_else(|error| panic!("{error}"));
}
