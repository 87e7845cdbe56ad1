//! Wall time by number of cores: a model of how long the runs of a group would take elsewhere.
//!
//! The model is [`Sharing`] of the measured CPU time of a run. With local simulators and with copies of the GS, cores share all of
//! it. A single GS runs on one core, however many there are. There cores share only the gradient steps of PPO, of one agent each.
//! Measured points stand beside it and show how much the model leaves out.

use std::collections::{BTreeMap, BTreeSet};

use super::compare::steps::are_alike;
use super::document::Table;
use super::finals::Runtime;
use super::group::{Comparison, Group};
use super::words::duration;
use dials_core::base::statistics::mean;
use dials_session::cost::Sharing;
use dials_session::records::method::steps_text;

const CORES: [usize; 6] = [1, 2, 8, 32, 128, 1024];

/// The time of a group's runs without evaluations.
pub(crate) struct ByCores {
    /// Timesteps per agent.
    pub(crate) steps: u64,
    /// CPU seconds of a run, mean over seeds.
    pub(crate) cpu: Sharing,
    /// Wall seconds by number of workers, means over the runs that had it.
    pub(crate) measured: BTreeMap<usize, f64>,
}

impl ByCores {
    /// Returns the model of the runs that count for the final return; `None` unless they finished.
    pub(crate) fn of(group: &Group, agents: usize) -> Option<ByCores> {
        let Runtime { steps, finished: true, cpu, .. } = Runtime::of(group)? else { return None };
        let (_, runs) = group.finals()?;
        let mut seconds: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        let mut updates = Vec::new();
        let config = &runs.first()?.config;
        let learning = &config.learning;
        // A shared policy has only one learner. That two threads may take a tower each of it is left out.
        let learners = if learning.shares_policies() { 1 } else { agents };
        for run in &runs {
            let time = run.time_at(steps)?;
            seconds.entry(run.workers).or_default().push(time.runtime_s());
            // On the GS as many threads as there are workers make the updates, unless the workers are ranks of MPI.
            updates.push(time.update_s * run.workers.min(learners) as f64);
        }
        let cpu_s = cpu.runtime_s();
        let updates_s = mean(&updates).min(cpu_s);
        let foreign = config.has_foreign_simulator();
        // Native copies are computed one after the other, like a single GS.
        let one_gs = group.simulator() == "gs" && (learning.copies() == 1 || !foreign);
        let most = learning.most_at_work(agents, foreign);
        let (alone_s, most) = match (one_gs, learning.shares_policies()) {
            (true, true) => (cpu_s, 1),
            (true, false) => (cpu_s - updates_s, agents),
            (false, true) => (updates_s, most),
            (false, false) => (0.0, most),
        };
        Some(ByCores {
            steps,
            cpu: Sharing { alone_s, shared_s: cpu_s - alone_s, most },
            measured: seconds.into_iter().map(|(workers, seconds)| (workers, mean(&seconds))).collect(),
        })
    }
}

/// Returns the groups with their models: only those with the most timesteps, up to a hundredth.
pub(crate) fn by_cores(comparison: &Comparison) -> Vec<(&Group, ByCores)> {
    let agents = comparison.scenario.agents;
    let mut all: Vec<(&Group, ByCores)> =
        comparison.groups.iter().filter_map(|group| Some((group, ByCores::of(group, agents)?))).collect();
    let most = all.iter().map(|(_, model)| model.steps).max().unwrap_or(0);
    all.retain(|(_, model)| are_alike([model.steps, most]));
    all
}

/// Makes the table of times by number of cores; `None` if no run measured CPU time.
pub(crate) fn table(comparison: &Comparison) -> Option<Table> {
    let all = by_cores(comparison);
    let steps = all.iter().map(|(_, model)| model.steps).max()?;
    let gs = all.iter().find(|(group, _)| group.simulator() == "gs" && group.overrides.is_empty());
    let most = all.iter().map(|(_, model)| model.cpu.most).max()?;
    // Beyond the number of agents nothing changes any more.
    let cores: BTreeSet<usize> = CORES.into_iter().map(|cores| cores.min(most)).collect();
    let mut header = vec!["time on".to_owned()];
    header.extend(cores.iter().map(|&cores| if cores == 1 { "1 core".to_owned() } else { format!("{cores} cores") }));
    header.push("measured".to_owned());
    header.extend(gs.map(|_| "faster than the GS".to_owned()));
    let row = |(group, model): &(&Group, ByCores)| {
        let mut row = vec![comparison.short_label(group)];
        row.extend(cores.iter().map(|&cores| duration(model.cpu.seconds(cores))));
        row.push(by_workers(&model.measured));
        row.extend(gs.map(|(of_gs, gs)| match model.cpu.faster_from(&gs.cpu) {
            _ if std::ptr::eq(*of_gs, *group) => "-".to_owned(),
            Some(1) => "always".to_owned(),
            Some(cores) => format!("from {cores} cores on"),
            None => "never".to_owned(),
        }));
        row
    };
    Some(Table {
        caption: format!(
            "Wall time of a run by number of cores, {}, {} timesteps, without evaluations: a model. It spreads the \
             measured CPU time over the cores, at most one core per agent, or per copy of the GS. A single GS runs on \
             one core; there cores share only PPO's gradient steps. Measured: wall time with this number of workers, \
             mean over the runs that had it.",
            comparison.title,
            steps_text(steps)
        ),
        header,
        rows: all.iter().map(row).collect(),
    })
}

fn by_workers(measured: &BTreeMap<usize, f64>) -> String {
    let words = measured.iter().map(|(workers, seconds)| format!("{} with {workers}", duration(*seconds)));
    words.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;
    use dials_session::records::run_record::{CpuTime, PeriodTime, RunRecord};

    #[test]
    fn the_gradient_steps_of_the_gs_are_read_from_its_runs() {
        // A finished run that took 70 s, and 90 CPU seconds without evaluations.
        let cpu = CpuTime { total_s: 100.0, evaluation_s: 10.0 };
        let of = |keys: &str, workers: usize| {
            let run = fixtures::run(&format!("simulator = 'gs'\n{keys}"));
            let steps = run.config.learning.total_steps;
            let run = RunRecord {
                evaluations: vec![fixtures::evaluation(steps, 1.0)],
                periods: vec![PeriodTime { steps, elapsed_s: 70.0, update_s: 20.0, cpu, ..PeriodTime::default() }],
                workers,
                ..run
            };
            let model = ByCores::of(&fixtures::group(vec![run]), 4).unwrap();
            (model.cpu.alone_s, model.cpu.shared_s, model.cpu.most)
        };
        assert_eq!(of("", 1), (70.0, 20.0, 4));
        assert_eq!(of("", 2), (50.0, 40.0, 4), "two threads for 20 s");
        assert_eq!(of("policy.share = 'kind'", 2), (90.0, 0.0, 1), "one policy has one learner");
        assert_eq!(of("policy.share = 'kind'\ngs.copies = 8", 2), (90.0, 0.0, 1), "native copies are in one thread");
    }
}
