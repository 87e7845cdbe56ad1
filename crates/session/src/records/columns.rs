//! The columns of each CSV file of a run: one list for the writer and the reader of the file.
//!
//! `docs/figures.md` explains each column. Some files have more columns after these, which the domain names.

use dials_core::base::{Activity, Phase};

/// The value in the second column of the lines about all agents, workers or processes.
pub const ALL: &str = "all";

/// Name of the first column of every file: timesteps per agent.
pub const STEPS: &str = "steps";
pub const AGENT: &str = "agent";
pub const EPISODES: &str = "episodes";

pub const MEAN: &str = "mean";
pub const MEDIAN: &str = "median";
pub const STD_ERROR: &str = "std_error";
pub const STUCK: &str = "stuck";
/// `returns.csv`, before the measures of the domain.
pub const OF_RETURNS: [&str; 7] = [STEPS, AGENT, MEAN, MEDIAN, STD_ERROR, EPISODES, STUCK];

pub const EPISODE: &str = "episode";
pub const RETURN: &str = "return";
/// `episodes.csv`
pub const OF_EPISODES: [&str; 3] = [STEPS, EPISODE, RETURN];

/// `imitation.csv`
pub const OF_IMITATION: [&str; 6] =
    [STEPS, AGENT, "cross_entropy_before", "cross_entropy_after", "accuracy_before", "accuracy_after"];

/// `training.csv`, before the metrics of the algorithm and the counters of the simulators.
pub const OF_TRAINING: [&str; 4] = [STEPS, AGENT, "mean_return", EPISODES];

/// Counters of `training.csv` with which local simulators are compared with the global one, if the domain has them.
pub const LOCAL_DECISIONS: &str = "local_decisions";
pub const LOCAL_CARS: &str = "local_cars";
pub const LOCAL_SPEED_MMPS: &str = "local_speed_mmps";
/// What `returns.csv` has beside them.
pub const CARS_PER_LIGHT: &str = "cars_per_light";
pub const MEAN_SPEED_MPS: &str = "mean_speed_mps";

pub const SOURCE: &str = "source";
pub const HELD_OUT_BEFORE: &str = "held_out_before";
pub const HELD_OUT_AFTER: &str = "held_out_after";
pub const HELD_OUT_MARGINALS: &str = "held_out_marginals";
/// `aip_loss.csv`
pub const OF_AIP_LOSS: [&str; 9] = [
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
pub const SOURCES_ON_MARGINALS: &str = "sources_on_marginals";

pub const AFTER: &str = "after";
pub const LOSS: &str = "loss";
pub const MARGINALS: &str = "marginals";
/// `aip_drift.csv`
pub const OF_AIP_DRIFT: [&str; 5] = [STEPS, AGENT, AFTER, LOSS, MARGINALS];

pub const WORKER: &str = "worker";
pub const ELAPSED_S: &str = "elapsed_s";
pub const CPU_S: &str = "cpu_s";
pub const CPU_EVALUATION_S: &str = "cpu_evaluation_s";

/// Returns the columns of `timing.csv`.
pub fn of_timing() -> Vec<String> {
    let fixed = [STEPS, WORKER, "wall_s", ELAPSED_S, CPU_S, CPU_EVALUATION_S, "exchange_s"].map(str::to_owned);
    let phases = Phase::ALL.map(seconds_of_phase);
    fixed.into_iter().chain(Activity::ALL.map(seconds_of)).chain(["idle_s".to_owned()]).chain(phases).collect()
}

/// Returns the column of `timing.csv` with the seconds of an activity.
pub fn seconds_of(activity: Activity) -> String {
    format!("{}_s", activity.name())
}

/// Returns the column of `timing.csv` with the seconds of a phase of the policies' training.
pub fn seconds_of_phase(phase: Phase) -> String {
    format!("{}_s", phase.name())
}

pub const PROCESS: &str = "process";
pub const PEAK_RSS_MB: &str = "peak_rss_mb";
pub const PSS_MB: &str = "pss_mb";
/// `memory.csv`
pub const OF_MEMORY: [&str; 4] = [STEPS, PROCESS, PEAK_RSS_MB, PSS_MB];
