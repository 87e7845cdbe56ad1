//! Estimates the time and memory of a run from measured runs.
//!
//! The costs come from runs of the same scenario and simulator, or else of the same domain (for traffic: grids and
//! scenarios apart) with the nearest number of agents. Unfinished runs count only where none is finished. If there are
//! none, constants are used. These were measured on two cores of a cloud machine with the configs of this project.

use super::file::{PlannedBaseline, PlannedRun};
use crate::config::RunConfig;
use crate::cost::{Prices, Workload, cores_at_work};
use crate::domains::DomainConfig;
use crate::records::run_record::{RunRecord, Status};
use dials_core::domain::RoughCosts;
use dials_learn::config::Simulator;
use dials_traffic::config::TrafficTable;

/// Returns the seconds of wall time for one of everything on `cores` cores, of which some train.
fn prices(costs: &RoughCosts, work: &Workload, training_cores: f64, cores: usize) -> Prices<f64> {
    let of_episodes = |episodes: usize| work.gs_steps(episodes) * costs.evaluation_s / cores_at_work(cores, episodes);
    Prices {
        step: costs.training_s / training_cores,
        evaluation: of_episodes(work.evaluation_episodes),
        final_evaluation: of_episodes(work.final_episodes),
        // This includes the collection, because run directories have both in one column.
        aip_training: work.samples_per_retraining() * costs.influence_s / training_cores,
        ..Prices::default()
    }
}

/// Returns the number of cores that train.
fn training_cores(config: &RunConfig, agents: usize, cores: usize) -> f64 {
    cores_at_work(cores, config.learning.most_at_work(agents, config.has_foreign_simulator()))
}

#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    pub seconds: f64,
    pub memory_mb: f64,
    /// Number of runs from whose measurements it is. 0: it is from the constants of this project.
    pub measured_runs: usize,
}

/// Seconds that a process takes to begin and to load what it simulates.
const START_S: f64 = 2.0;

pub fn estimate(run: &PlannedRun, cores: usize, measured: &[RunRecord]) -> Estimate {
    let nearest = nearest(run, measured);
    let mut rough = run.rough_costs;
    if run.config.learning.simulator == Simulator::Global {
        rough.training_s = rough.training_on_gs_s;
    }
    let costs = costs_of(&nearest, rough);
    let work = Workload::of(&run.config, run.agents(), run.config.learning.last_step());
    let seconds = prices(&costs, &work, training_cores(&run.config, run.agents(), cores), cores).of_run(&work).sum();
    // With SUMO, copies of the GS and lanes of a shared policy are processes of their own.
    let learning = &run.config.learning;
    let most = learning.most_at_work(run.agents(), run.config.has_foreign_simulator());
    let apart = match learning.simulator {
        _ if most == 1 || !learning.learns_at_one_place() => 0,
        Simulator::Global => most,
        Simulator::Local => most.min(cores),
    };
    let memory_mb = (cores + 1 + apart) as f64 * costs.process_mb + run.agents() as f64 * costs.agent_mb;
    Estimate { seconds, memory_mb, measured_runs: nearest.len() }
}

/// Estimates the time and memory of measuring a controller, on one core.
pub fn estimate_controller(baseline: &PlannedBaseline) -> Estimate {
    let PlannedBaseline { config, episodes, agents, rough_costs, .. } = baseline;
    let steps = agents * episodes * config.horizon();
    Estimate {
        seconds: START_S + steps as f64 * rough_costs.evaluation_s,
        memory_mb: rough_costs.process_mb,
        measured_runs: 0,
    }
}

/// Returns the measured runs of the same scenario and simulator. If there are none: those of the same domain with the
/// nearest number of agents. If some of them are finished, only those.
fn nearest<'a>(run: &PlannedRun, measured: &'a [RunRecord]) -> Vec<&'a RunRecord> {
    // A step on a grid costs other than one of a scenario.
    let is_scenario = |domain: &DomainConfig| matches!(domain, DomainConfig::Traffic(TrafficTable::Scenario(_)));
    let way = |config: &RunConfig| {
        let domain = config.domain.as_ref().map(|domain| (domain.name(), is_scenario(domain)));
        (domain, config.learning.short_form().name)
    };
    let alike = |other: &&RunRecord| way(&other.config) == way(&run.config) && other.total_time().is_some();
    let is_same = |other: &RunRecord| other.scenario().id == run.scenario.id;
    let ratio = |other: &RunRecord| {
        let agents = other.scenario().id.agents as f64;
        (agents.ln() - (run.agents() as f64).ln()).abs()
    };
    let mut near: Vec<&RunRecord> = measured.iter().filter(alike).collect();
    if near.iter().any(|other| is_same(other)) {
        near.retain(|other| is_same(other));
    } else {
        let best = near.iter().map(|other| ratio(other)).fold(f64::INFINITY, f64::min);
        near.retain(|other| ratio(other) <= best + 1e-9);
    }
    let is_finished = |other: &RunRecord| other.status() == Status::Finished;
    if near.iter().any(|other| is_finished(other)) {
        near.retain(|other| is_finished(other));
    }
    near
}

/// Returns the mean costs of runs, and `fallback` for work that they did not do.
fn costs_of(runs: &[&RunRecord], fallback: RoughCosts) -> RoughCosts {
    // Core-seconds and amount of work of training, of the AIPs and of evaluation.
    let mut sums = [(0.0, 0.0); 3];
    for run in runs {
        let time = run.total_time().expect("only runs with times are near");
        let agents = run.scenario().id.agents;
        let training_cores = training_cores(&run.config, agents, run.workers);
        let evaluating_cores = cores_at_work(run.workers, run.config.learning.evaluation.episodes);
        let mut work = Workload::of(&run.config, agents, time.steps);
        if run.status() != Status::Finished {
            // The times of a period have the evaluation before it, so the last evaluation is not among them yet.
            work.final_episodes = 0;
        }
        let of_run = [
            ((time.runtime_s() - time.influence_s) * training_cores, work.agent_steps()),
            (time.influence_s * training_cores, work.whole_retrainings() * work.samples_per_retraining()),
            (time.evaluation_s * evaluating_cores, work.evaluated_steps()),
        ];
        for (sum, (spent, done)) in sums.iter_mut().zip(of_run) {
            *sum = (sum.0 + spent, sum.1 + done);
        }
    }
    // The processes have what the agents do not need.
    let of_process = |run: &&RunRecord| {
        let of_agents = run.scenario().id.agents as f64 * fallback.agent_mb;
        (run.memory.map_or(0.0, |memory| memory.total_pss_mb) - of_agents) / (run.workers as f64 + 1.0)
    };
    let process_mb = runs.iter().map(of_process).reduce(f64::max);
    let cost = |kind: usize, fallback: f64| match sums[kind] {
        (spent, done) if done > 0.0 => spent / done,
        _ => fallback,
    };
    RoughCosts {
        training_s: cost(0, fallback.training_s),
        influence_s: cost(1, fallback.influence_s),
        evaluation_s: cost(2, fallback.evaluation_s),
        process_mb: process_mb.map_or(fallback.process_mb, |mb| mb.max(0.0)),
        ..fallback
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::file;
    use crate::records::run_record::{EvaluationRecord, MemoryRecord, PeriodTime, Returns};
    use dials_core::domain::Scenario;
    use dials_learn::config::ShortForm;

    /// Episodes of 10 steps, 2 per evaluation and 8 per dataset.
    fn config(simulator: &str, total_steps: u64) -> RunConfig {
        let keys = ShortForm::called(simulator).unwrap().keys();
        let text = format!(
            "{keys}total_steps = {total_steps}\n[warehouse]\nagents_per_side = 2\nhorizon = 10\n\
             [aip]\nretrain_every_steps = 1000\ndataset_steps = 80\n[evaluation]\nevery_steps = 1000\nepisodes = 2\nfinal_episodes = 2"
        );
        toml::from_str(&text).unwrap()
    }

    fn planned(simulator: &str, total_steps: u64, agents: usize) -> PlannedRun {
        file::tests::planned(config(simulator, total_steps), Scenario::new("warehouse", agents, 10))
    }

    /// A finished run of 1000 steps that took these times.
    fn measured(simulator: &str, agents: usize, workers: usize, times_s: [f64; 3]) -> RunRecord {
        let [elapsed_s, evaluation_s, influence_s] = times_s;
        let all = Returns { mean: 1.0, median: 1.0, std_error: 0.0, stuck: 0 };
        RunRecord {
            evaluations: vec![EvaluationRecord { steps: 1000, all, agents: vec![], episode_returns: vec![] }],
            periods: vec![PeriodTime { steps: 1000, elapsed_s, evaluation_s, influence_s, ..PeriodTime::default() }],
            memory: Some(MemoryRecord { process_mb: 0.0, total_mb: 0.0, total_pss_mb: 332.0 }),
            workers,
            ..RunRecord::empty(config(simulator, 1000), Scenario::new("warehouse", agents, 10))
        }
    }

    #[test]
    fn an_estimate_is_worked_out_by_hand() {
        // On one core, 4 agents: 40 s of training, 3.2 s for a dataset and 1.6 s for two evaluations. Per unit:
        // 40 / (4 x 1000) = 0.01, 3.2 / (4 x 80) = 0.01 for 100 epochs, 1.6 / (4 x 2 x 20) = 0.01.
        let records = [measured("dials", 4, 1, [44.8, 1.6, 3.2])];
        // Twice the steps, 9 agents, 2 cores: training 9 x 2000 x 0.01 / 2 = 90; two datasets 9 x 160 x 0.01 / 2 = 7.2;
        // three evaluations 9 x 60 x 0.01 / 2 = 2.7.
        let found = estimate(&planned("dials", 2000, 9), 2, &records);
        assert!((found.seconds - 99.9).abs() < 1e-9, "{found:?}");
        assert_eq!(found.measured_runs, 1);
        // 332 MiB minus 4 agents x 8 MiB are 2 processes of 150 MiB each. Now there are 3 processes and 9 agents.
        assert!((found.memory_mb - (3.0 * 150.0 + 9.0 * 8.0)).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn an_unfinished_run_counts_only_where_none_is_finished() {
        let mut half = measured("dials", 4, 1, [44.0, 0.8, 3.2]);
        half.config.learning.total_steps = 2000;
        let run = planned("dials", 2000, 4);
        // One evaluation: 0.8 / (4 x 20) = 0.01. In all: training 80 s, two datasets 6.4 s, three evaluations 2.4 s.
        let found = estimate(&run, 1, &[half.clone()]);
        assert!((found.seconds - 88.8).abs() < 1e-9, "{found:?}");
        assert_eq!(found.measured_runs, 1);
        let whole = measured("dials", 4, 1, [22.4, 0.8, 1.6]);
        assert_eq!(estimate(&run, 1, &[half.clone(), whole.clone()]), estimate(&run, 1, &[whole]));
        // Nothing was timed yet.
        half.periods.clear();
        assert_eq!(estimate(&run, 1, &[half]).measured_runs, 0);
    }

    #[test]
    fn one_core_trains_on_the_gs_and_elsewhere_no_more_than_agents_and_none_evaluates_less_than_an_episode() {
        // Each unit costs 10 core-milliseconds: of 2 workers one trains on the GS; of 8 workers 4 train and 2 evaluate.
        let on_the_gs = [measured("gs", 4, 2, [40.0, 0.0, 0.0])];
        let local = [measured("dials", 4, 8, [10.0 + 0.8 + 0.8, 0.8, 0.8])];
        // 40 s of training and 3.2 s for the AIPs by 4 cores, and 1.6 s of evaluations by 2.
        for (simulator, records, cores, seconds) in
            [("gs", &on_the_gs, 4, 40.0), ("dials", &local, 8, 11.6), ("dials", &local, 1, 44.8)]
        {
            let found = estimate(&planned(simulator, 1000, 4), cores, records);
            assert!((found.seconds - seconds).abs() < 1e-9, "{simulator}, {cores} cores: {found:?}");
        }
    }

    #[test]
    fn runs_of_the_same_scenario_count_before_others_of_its_size_and_these_before_the_constants() {
        let with = |mut run: RunRecord, checksum| {
            run.about.scenario = Scenario::new("warehouse", 4, 10).with_checksum(checksum);
            run
        };
        let records =
            [with(measured("dials", 4, 1, [40.0, 0.0, 0.0]), 1), with(measured("dials", 4, 1, [80.0, 0.0, 0.0]), 2)];
        let mut run = planned("dials", 1000, 4);
        assert_eq!(estimate(&run, 1, &records).measured_runs, 2);
        run.scenario = run.scenario.with_checksum(2);
        let found = estimate(&run, 1, &records);
        assert_eq!((found.measured_runs, found.seconds), (1, 80.0));
        let records = [measured("dials", 4, 1, [40.0, 0.0, 0.0]), measured("dials", 100, 1, [9000.0, 0.0, 0.0])];
        let small = estimate(&planned("dials", 1000, 4), 1, &records);
        assert_eq!((small.measured_runs, small.seconds), (1, 40.0));
        assert_eq!(estimate(&planned("untrained-dials", 1000, 4), 1, &records).measured_runs, 0);
        // Runs of a grid say nothing of a scenario.
        let text =
            |table: &str| toml::from_str::<RunConfig>(&format!("simulator = 'gs'\n[traffic]\n{table}\n")).unwrap();
        let mut grid = measured("gs", 4, 1, [40.0, 0.0, 0.0]);
        grid.config = text("network = 'n'\nlocal_network = 'l'");
        let mut run = planned("gs", 1000, 4);
        run.config = text("scenario = 's.sumocfg'\nbegin_s = 0\nend_s = 3600");
        assert_eq!(estimate(&run, 1, &[grid]).measured_runs, 0);
    }

    #[test]
    fn a_controller_plays_its_episodes_on_one_core() {
        let baseline = file::tests::planned_baseline(&planned("gs", 1000, 4), 50);
        // 4 agents x 50 episodes x 10 steps x 1 ms, after 2 s.
        let found = estimate_controller(&baseline);
        assert!((found.seconds - 4.0).abs() < 1e-9 && found.memory_mb == 120.0, "{found:?}");
    }
}
