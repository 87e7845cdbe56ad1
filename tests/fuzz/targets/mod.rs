//! What is fuzzed. Each function takes an input where a user's file would be read.
//!
//! - `config`: config files and `--set`. `experiment`: experiment files. `timings`: files of fixed-time lights.
//! - `networks`: the files of a SUMO network. `report`: every file that a report reads. `resume`: CSV files of a run
//!   that is resumed.
//! - `checkpoint`, `networks_of_agents`: safetensors files. `crafted`: checkpoints with another state in them.
//! - `messages`: what coordinator and workers say.

mod checkpoint;
mod config;
mod crafted;
mod experiment;
mod messages;
mod networks;
mod networks_of_agents;
mod report;
mod resume;
mod timings;

use std::path::{Path, PathBuf};

use super::mutate::Form;
use super::verdict::Verdict;

/// Something that reads what others wrote.
pub struct Target {
    pub name: &'static str,
    pub form: Form,
    /// Number of inputs that are tried at every start of the tests.
    pub short: u64,
    /// Returns inputs that must be accepted.
    pub seeds: Seeds,
    /// Returns further inputs, which may be refused.
    pub more: Seeds,
    /// Panics if the input leads to what must not happen.
    pub call: Call,
}

type Seeds = fn() -> Vec<Vec<u8>>;
type Call = fn(&[u8]) -> Verdict;

impl Target {
    pub fn named(name: &str) -> &'static Target {
        TARGETS.iter().find(|target| target.name == name).expect("a name of the list")
    }
}

const fn target(name: &'static str, form: Form, short: u64, seeds: Seeds, call: Call) -> Target {
    Target { name, form, short, seeds, more: Vec::new, call }
}

pub const TARGETS: &[Target] = &[
    target("config", Form::Text, 400, config::seeds, config::call),
    Target { more: networks::deep_nest, ..target("net", Form::Xml, 60, networks::net_seeds, networks::net) },
    Target {
        more: networks::deep_nest,
        ..target("local_net", Form::Xml, 60, networks::local_net_seeds, networks::local_net)
    },
    Target { more: networks::deep_nest, ..target("routes", Form::Xml, 60, networks::routes_seeds, networks::routes) },
    Target {
        more: networks::deep_nest,
        ..target("local_routes", Form::Xml, 60, networks::local_routes_seeds, networks::local_routes)
    },
    Target {
        more: networks::deep_nest,
        ..target("actuated", Form::Xml, 60, networks::actuated_seeds, networks::actuated)
    },
    target("timings", Form::Text, 400, timings::seeds, timings::call),
    target("experiment", Form::Text, 300, experiment::seeds, experiment::call),
    target("returns_csv", Form::Text, 80, report::returns_seeds, report::returns),
    target("episodes_csv", Form::Text, 80, report::episodes_seeds, report::episodes),
    target("aip_loss_csv", Form::Text, 80, report::aip_loss_seeds, report::aip_loss),
    target("aip_drift_csv", Form::Text, 80, report::aip_drift_seeds, report::aip_drift),
    target("timing_csv", Form::Text, 80, report::timing_seeds, report::timing),
    target("memory_csv", Form::Text, 80, report::memory_seeds, report::memory),
    target("kept_config", Form::Text, 80, report::config_seeds, report::config),
    target("run_json", Form::Text, 80, report::run_json_seeds, report::run_json),
    target("plan_json", Form::Text, 80, report::plan_seeds, report::plan),
    target("baseline_json", Form::Text, 80, report::baseline_seeds, report::baseline),
    target("resume", Form::Text, 14, resume::seeds, resume::call),
    Target {
        more: checkpoint::strangers,
        ..target("checkpoint", Form::Tensors, 600, checkpoint::seeds, checkpoint::call)
    },
    target("crafted", Form::Text, 24, crafted::seeds, crafted::call),
    target("policies", Form::Tensors, 400, networks_of_agents::policies_seeds, networks_of_agents::policies),
    target("aips", Form::Tensors, 400, networks_of_agents::aips_seeds, networks_of_agents::aips),
    target("orders", Form::Messages, 400, messages::orders_seeds, messages::orders),
    target("reports", Form::Messages, 400, messages::reports_seeds, messages::reports),
];

/// Returns a file or folder of this project.
fn of_project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Reads files of this project.
fn read_all(paths: &[&str]) -> Vec<Vec<u8>> {
    let read = |path: &&str| std::fs::read(of_project(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
    paths.iter().map(read).collect()
}
