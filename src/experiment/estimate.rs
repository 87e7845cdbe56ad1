//! How long a run will take and how much memory, from runs that were measured.
//!
//! Measured are core-seconds: per agent and timestep of training, per agent and dataset of the AIPs' training, per agent
//! and timestep of evaluation. Runs of the same domain and simulator count, those with the nearest number of agents. Where
//! there are none, constants stand in that were measured on two cores of a cloud machine with the configs of this project.

use super::file::PlannedRun;
use crate::config::{Config, SimulatorKind, schedule};
use crate::report::run_dir::RunRecord;

/// Core-seconds and memory of one kind of run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// Per agent and timestep.
    pub training_s: f64,
    /// Per agent and GS step of a dataset, for collecting it and training on it.
    pub influence_s: f64,
    /// Per agent and step of an evaluation episode.
    pub evaluation_s: f64,
    /// Of each process, whatever it does.
    pub process_mb: f64,
    /// For each agent, in all processes together.
    pub agent_mb: f64,
}

/// Where an estimate is from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Runs in the same folder, so many.
    Measured(usize),
    Constants,
}

/// What one run will take from its beginning to its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    pub seconds: f64,
    pub memory_mb: f64,
    pub source: Source,
}

/// Measured with traffic_4.toml and traffic_100.toml.
const TRAFFIC: Costs =
    Costs { training_s: 37e-6, influence_s: 90e-6, evaluation_s: 25e-6, process_mb: 120.0, agent_mb: 4.0 };
/// Likewise on the GS, without AIPs.
const TRAFFIC_GS: Costs = Costs { training_s: 40e-6, ..TRAFFIC };
/// Measured with warehouse_4.toml and warehouse_100.toml.
const WAREHOUSE: Costs =
    Costs { training_s: 60e-6, influence_s: 900e-6, evaluation_s: 12e-6, process_mb: 110.0, agent_mb: 8.0 };
const WAREHOUSE_GS: Costs = Costs { training_s: 60e-6, ..WAREHOUSE };

/// Estimates one run on so many cores.
pub fn estimate(run: &PlannedRun, cores: usize, measured: &[RunRecord]) -> Estimate {
    let nearest = nearest(run, measured);
    let (costs, source) = match costs_of(&nearest) {
        Some(costs) => (costs, Source::Measured(nearest.len())),
        None => (constants(&run.config), Source::Constants),
    };
    let amounts = Amounts::of(&run.config, run.agents, run.config.last_step());
    let training_cores = if run.config.simulator == SimulatorKind::Gs { 1 } else { cores };
    let seconds = amounts.training * costs.training_s / training_cores as f64
        + (amounts.influence * costs.influence_s + amounts.evaluation * costs.evaluation_s) / cores as f64;
    let memory_mb = (cores + 1) as f64 * costs.process_mb + run.agents as f64 * costs.agent_mb;
    Estimate { seconds, memory_mb, source }
}

fn constants(config: &Config) -> Costs {
    match (config.traffic.is_some(), config.simulator) {
        (true, SimulatorKind::Gs) => TRAFFIC_GS,
        (true, _) => TRAFFIC,
        (false, SimulatorKind::Gs) => WAREHOUSE_GS,
        (false, _) => WAREHOUSE,
    }
}

/// How much of each kind of work there is until a step.
struct Amounts {
    /// Agents x timesteps.
    training: f64,
    /// Agents x GS steps of all datasets.
    influence: f64,
    /// Agents x steps of all evaluation episodes.
    evaluation: f64,
}

impl Amounts {
    fn of(config: &Config, agents: usize, steps: u64) -> Amounts {
        let (agents, horizon) = (agents as f64, config.horizon() as f64);
        let periods = schedule(config);
        let begun = || periods.iter().filter(|period| period.start < steps);
        let datasets = begun().filter(|period| period.retrain_aips).count() as f64;
        // There is one more at the end.
        let evaluations = begun().filter(|period| period.evaluate).count() as f64 + 1.0;
        Amounts {
            training: agents * steps as f64,
            influence: agents * datasets * config.dataset_episodes(config.horizon()) as f64 * horizon,
            evaluation: agents * evaluations * config.evaluation.episodes as f64 * horizon,
        }
    }
}

/// Measured runs of the same domain and simulator, those with the nearest number of agents.
fn nearest<'a>(run: &PlannedRun, measured: &'a [RunRecord]) -> Vec<&'a RunRecord> {
    let alike = |other: &&RunRecord| {
        let (a, b) = (&other.config, &run.config);
        (a.traffic.is_some(), a.simulator) == (b.traffic.is_some(), b.simulator)
            && other.total_time().is_some()
            && other.agents().is_some()
    };
    let ratio = |other: &RunRecord| {
        let agents = other.agents().expect("looked at before") as f64;
        (agents.ln() - (run.agents as f64).ln()).abs()
    };
    let alike: Vec<&RunRecord> = measured.iter().filter(alike).collect();
    let best = alike.iter().map(|other| ratio(other)).fold(f64::INFINITY, f64::min);
    alike.into_iter().filter(|other| ratio(other) <= best + 1e-9).collect()
}

/// What runs cost together; none where there are none.
fn costs_of(runs: &[&RunRecord]) -> Option<Costs> {
    let mut spent = [0.0; 3];
    let mut done = [0.0; 3];
    let (mut process_mb, mut agent_mb) = (0.0_f64, 0.0_f64);
    for run in runs {
        let (time, agents) = (run.total_time()?, run.agents()?);
        let cores = run.workers as f64;
        let training_cores = if run.config.simulator == SimulatorKind::Gs { 1.0 } else { cores };
        let amounts = Amounts::of(&run.config, agents, time.steps);
        let training_s = time.runtime_s() - time.influence_s;
        for (sum, value) in
            spent.iter_mut().zip([training_s * training_cores, time.influence_s * cores, time.evaluation_s * cores])
        {
            *sum += value;
        }
        for (sum, value) in done.iter_mut().zip([amounts.training, amounts.influence, amounts.evaluation]) {
            *sum += value;
        }
        let fallback = constants(&run.config);
        let total = run.memory.map_or(0.0, |memory| memory.total_pss_mb.unwrap_or(memory.total_mb));
        // What is above the agents' share is the processes' own.
        let of_agents = agents as f64 * fallback.agent_mb;
        process_mb = process_mb.max((total - of_agents) / (cores + 1.0));
        agent_mb = agent_mb.max(fallback.agent_mb);
    }
    let fallback = constants(&runs.first()?.config);
    let cost = |kind: usize, fallback: f64| if done[kind] > 0.0 { spent[kind] / done[kind] } else { fallback };
    Some(Costs {
        training_s: cost(0, fallback.training_s),
        influence_s: cost(1, fallback.influence_s),
        evaluation_s: cost(2, fallback.evaluation_s),
        process_mb,
        agent_mb,
    })
}
