//! Runs for the tests of this crate.

use crate::group::Group;
use dials_core::domain::Scenario;
use dials_session::records::method::Method;
use dials_session::records::run_record::{EvaluationRecord, Returns, RunRecord};

/// Makes a run of four warehouse robots with these keys of its config.
pub(crate) fn run(keys: &str) -> RunRecord {
    let config = toml::from_str(&format!("{keys}\n[warehouse]\nagents_per_side = 2")).unwrap();
    RunRecord::empty(config, Scenario::new("warehouse", 4, 100))
}

/// Makes an evaluation of one episode in which all agents have the same return.
pub(crate) fn evaluation(steps: u64, mean: f64) -> EvaluationRecord {
    let all = Returns { mean, median: mean, std_error: 0.0, stuck: 0 };
    EvaluationRecord { steps, all, agents: vec![all; 4], episode_returns: vec![mean] }
}

pub(crate) fn group(runs: Vec<RunRecord>) -> Group {
    Group { method: Method::of(&runs[0].config, runs[0].scenario()), overrides: Vec::new(), runs }
}
