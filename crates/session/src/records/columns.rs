//! The columns of each CSV file of a run: one list for the writer and the reader of the file.
//!
//! `docs/figures.md` explains each column. Some files have more columns after these, which the domain names.

use dials_core::base::{Activity, Phase};

/// The value in the second column of the lines about all agents, workers or processes.
pub(crate) const ALL: &str = "all";

/// Name of the first column of every file: timesteps per agent.
pub(crate) const STEPS: &str = "steps";
pub(crate) const AGENT: &str = "agent";
pub(crate) const EPISODES: &str = "episodes";

pub(crate) const MEAN: &str = "mean";
pub(crate) const MEDIAN: &str = "median";
pub(crate) const STD_ERROR: &str = "std_error";
pub(crate) const STUCK: &str = "stuck";
/// `returns.csv`, before the measures of the domain.
pub(crate) const OF_RETURNS: [&str; 7] = [STEPS, AGENT, MEAN, MEDIAN, STD_ERROR, EPISODES, STUCK];

pub(crate) const EPISODE: &str = "episode";
pub(crate) const RETURN: &str = "return";
/// `episodes.csv`
pub(crate) const OF_EPISODES: [&str; 3] = [STEPS, EPISODE, RETURN];

/// `imitation.csv`
pub(crate) const OF_IMITATION: [&str; 6] =
    [STEPS, AGENT, "cross_entropy_before", "cross_entropy_after", "accuracy_before", "accuracy_after"];

/// `training.csv`, before the metrics of the algorithm and the counters of the simulators.
pub(crate) const OF_TRAINING: [&str; 4] = [STEPS, AGENT, "mean_return", EPISODES];

/// Counters of `training.csv` with which local simulators are compared with the global one, if the domain has them.
pub(crate) const LOCAL_DECISIONS: &str = "local_decisions";
pub(crate) const LOCAL_CARS: &str = "local_cars";
pub(crate) const LOCAL_SPEED_MMPS: &str = "local_speed_mmps";
/// What `returns.csv` has beside them.
pub(crate) const CARS_PER_LIGHT: &str = "cars_per_light";
pub(crate) const MEAN_SPEED_MPS: &str = "mean_speed_mps";

pub(crate) const SOURCE: &str = "source";
pub(crate) const HELD_OUT_BEFORE: &str = "held_out_before";
pub(crate) const HELD_OUT_AFTER: &str = "held_out_after";
pub(crate) const HELD_OUT_MARGINALS: &str = "held_out_marginals";
/// `aip_loss.csv`
pub(crate) const OF_AIP_LOSS: [&str; 9] = [
    STEPS,
    AGENT,
    SOURCE,
    "training_before",
    "training_after",
    HELD_OUT_BEFORE,
    HELD_OUT_AFTER,
    HELD_OUT_MARGINALS,
    "frequency",
];

/// Further column of `aip_loss.csv` if AIPs correct marginals.
pub(crate) const SOURCES_ON_MARGINALS: &str = "sources_on_marginals";

pub(crate) const AFTER: &str = "after";
pub(crate) const LOSS: &str = "loss";
pub(crate) const MARGINALS: &str = "marginals";
/// `aip_drift.csv`
pub(crate) const OF_AIP_DRIFT: [&str; 5] = [STEPS, AGENT, AFTER, LOSS, MARGINALS];

pub(crate) const WORKER: &str = "worker";
pub(crate) const ELAPSED_S: &str = "elapsed_s";
pub(crate) const CPU_S: &str = "cpu_s";
pub(crate) const CPU_EVALUATION_S: &str = "cpu_evaluation_s";

/// Returns the columns of `timing.csv`.
pub(crate) fn of_timing() -> Vec<String> {
    let fixed = [STEPS, WORKER, "wall_s", ELAPSED_S, CPU_S, CPU_EVALUATION_S, "exchange_s"].map(str::to_owned);
    let activities = Activity::ALL.map(|activity| seconds_of(activity.name()));
    let phases = Phase::ALL.map(|phase| seconds_of(phase.name()));
    fixed.into_iter().chain(activities).chain(["idle_s".to_owned()]).chain(phases).collect()
}

/// Returns the column of `timing.csv` with the seconds of an activity, or of a phase of the policies' training.
pub(crate) fn seconds_of(name: &str) -> String {
    format!("{name}_s")
}

pub(crate) const PROCESS: &str = "process";
pub(crate) const PEAK_RSS_MB: &str = "peak_rss_mb";
pub(crate) const PSS_MB: &str = "pss_mb";
/// `memory.csv`
pub(crate) const OF_MEMORY: [&str; 4] = [STEPS, PROCESS, PEAK_RSS_MB, PSS_MB];
