//! The lines of the CSV files of a run, in the order of their [`columns`].

use std::time::Duration;

use super::columns::{self, ALL};
use dials_core::base::statistics::mean;
use dials_core::base::{Activity, Phase, Timesheet};
use dials_learn::algorithms::Metrics;
use dials_learn::algorithms::imitation::ImitationLoss;
use dials_learn::evaluation::{Evaluation, Summary};
use dials_learn::fleet::{FleetLoad, Footprint};
use dials_learn::predictors::{AipLoss, FreshLoss, mean_loss};
use dials_learn::progress::Moment;
use dials_learn::steps::train_policies::PolicyTraining;

/// A line of a CSV file, one string per column.
pub(super) type CsvLine = Vec<String>;

/// Makes a header of fixed columns.
pub(super) fn header(columns: &[&str]) -> CsvLine {
    columns.iter().map(|&column| column.to_owned()).collect()
}

pub(super) fn evaluation_header(evaluation: &Evaluation) -> CsvLine {
    let per_agent = evaluation.measures.per_agent.iter().map(|(name, _)| name.clone());
    let system = evaluation.measures.system.iter().map(|(name, _)| name.clone());
    header(&columns::OF_RETURNS).into_iter().chain(per_agent).chain(system).collect()
}

/// Makes a line for all agents (`stuck`: their number), then one per agent (`stuck`: 0 or 1; no figures of the whole
/// system).
pub(super) fn evaluation_lines(steps: u64, evaluation: &Evaluation) -> Vec<CsvLine> {
    let line = |agent: String, summary: Summary, stuck: usize| {
        let mut line = vec![steps.to_string(), agent];
        line.extend([summary.mean, summary.median, summary.std_error].map(|value| format!("{value:.4}")));
        line.extend([evaluation.episodes().to_string(), stuck.to_string()]);
        line
    };
    let measures = &evaluation.measures;
    let mut all = line(ALL.to_owned(), evaluation.of_all(), evaluation.stuck.iter().filter(|&&stuck| stuck).count());
    let means = measures.per_agent.iter().map(|(_, values)| values.iter().sum::<f64>() / values.len() as f64);
    all.extend(means.chain(measures.system.iter().map(|&(_, value)| value)).map(|value| format!("{value:.4}")));
    let mut lines = vec![all];
    for agent in 0..evaluation.agents() {
        let mut of_agent = line(agent.to_string(), evaluation.of_agent(agent), usize::from(evaluation.stuck[agent]));
        of_agent.extend(measures.per_agent.iter().map(|(_, values)| format!("{:.4}", values[agent])));
        of_agent.extend(measures.system.iter().map(|_| String::new()));
        lines.push(of_agent);
    }
    lines
}

/// Makes a line per episode of an evaluation, with the mean return of all agents.
pub(super) fn episode_lines(steps: u64, evaluation: &Evaluation) -> Vec<CsvLine> {
    let episodes = evaluation.returns.iter().enumerate();
    episodes
        .map(|(episode, returns)| vec![steps.to_string(), episode.to_string(), format!("{:.6}", mean(returns))])
        .collect()
}

/// Makes a line for the mean of all agents, then one per agent.
pub(super) fn imitation_lines(steps: u64, losses: &[ImitationLoss]) -> Vec<CsvLine> {
    let line = |agent: String, loss: &ImitationLoss| {
        let values = loss.cross_entropy.into_iter().chain(loss.accuracy);
        [steps.to_string(), agent].into_iter().chain(values.map(|value| format!("{value:.5}"))).collect()
    };
    let of_agents = losses.iter().enumerate().map(|(agent, loss)| line(agent.to_string(), loss));
    std::iter::once(line(ALL.to_owned(), &ImitationLoss::mean_of(losses))).chain(of_agents).collect()
}

/// Makes a line for the mean of all agents, each with the mean of its sources. Then for each agent, one line for that mean
/// and one per source.
pub(super) fn aip_lines(steps: u64, losses: &[AipLoss]) -> Vec<CsvLine> {
    let mut of_agents: Vec<[f64; 6]> = Vec::new();
    let mut lines = Vec::new();
    let line = |agent: &str, source: &str, values: &[f64; 6]| -> CsvLine {
        let keys = [steps.to_string(), agent.to_owned(), source.to_owned()];
        keys.into_iter().chain(values.map(|value| format!("{value:.5}"))).collect()
    };
    let (choose, mut sources_on_marginals) = (choose_marginals(losses), 0);
    for (agent, loss) in losses.iter().enumerate() {
        let of_sources: Vec<[f64; 6]> = (0..loss.marginals.len())
            .map(|source| {
                let [training, held_out] = [&loss.training, &loss.held_out];
                [
                    training[0][source],
                    training[1][source],
                    held_out[0][source],
                    held_out[1][source],
                    loss.marginals[source],
                    loss.frequencies[source],
                ]
            })
            .collect();
        let agent = agent.to_string();
        let on_marginals = loss.on_marginals.iter().map(|&on_marginals| usize::from(on_marginals));
        let of_agent: usize = on_marginals.clone().sum();
        let mut all = line(&agent, ALL, &mean_of(&of_sources));
        all.extend(choose.then(|| of_agent.to_string()));
        lines.push(all);
        let first = lines.len();
        lines.extend(of_sources.iter().enumerate().map(|(source, values)| line(&agent, &source.to_string(), values)));
        lines[first..]
            .iter_mut()
            .zip(on_marginals)
            .for_each(|(line, on_marginals)| line.push(on_marginals.to_string()));
        of_agents.push(mean_of(&of_sources));
        sources_on_marginals += of_agent;
    }
    let mut all = line(ALL, ALL, &mean_of(&of_agents));
    all.extend(choose.then(|| sources_on_marginals.to_string()));
    lines.insert(0, all);
    lines
}

/// Returns the columns of `aip_loss.csv` for these losses.
pub(super) fn aip_header(losses: &[AipLoss]) -> CsvLine {
    let further = choose_marginals(losses).then(|| columns::SOURCES_ON_MARGINALS.to_owned());
    header(&columns::OF_AIP_LOSS).into_iter().chain(further).collect()
}

/// Returns whether these predictors choose between a network and marginals.
fn choose_marginals(losses: &[AipLoss]) -> bool {
    losses.iter().any(|loss| !loss.on_marginals.is_empty())
}

fn mean_of(rows: &[[f64; 6]]) -> [f64; 6] {
    std::array::from_fn(|column| mean_loss(&rows.iter().map(|row| row[column]).collect::<Vec<_>>()))
}

/// Makes a line for the mean of all agents, then one per agent, each the mean of its sources.
pub(super) fn drift_lines(steps: u64, after: Moment, losses: &[FreshLoss]) -> Vec<CsvLine> {
    let line = |agent: String, [loss, marginals]: [f64; 2]| {
        vec![steps.to_string(), agent, after.name().to_owned(), format!("{loss:.5}"), format!("{marginals:.5}")]
    };
    let of_agents = losses.iter().enumerate().map(|(agent, loss)| line(agent.to_string(), loss.means()));
    std::iter::once(line(ALL.to_owned(), FreshLoss::means_of_all(losses))).chain(of_agents).collect()
}

pub(super) fn training_header(training: &PolicyTraining) -> CsvLine {
    let metrics = training.metrics.names().map(str::to_owned);
    let counters = training.counters.iter().map(|(name, _)| name.clone());
    header(&columns::OF_TRAINING).into_iter().chain(metrics).chain(counters).collect()
}

/// Makes a line for all agents (means; numbers of episodes and counters added up), then one per agent. Metrics are empty
/// where there was no update.
pub(super) fn training_lines(steps: u64, training: &PolicyTraining) -> Vec<CsvLine> {
    let Metrics { of_agents, settings } = &training.metrics;
    let weight = 1.0 / training.agents.len() as f64;
    let returns: Vec<f64> = training.agents.iter().filter_map(|agent| agent.mean_return).collect();
    let mean_return = (!returns.is_empty()).then(|| returns.iter().sum::<f64>() / returns.len() as f64);
    let episodes = training.agents.iter().map(|agent| agent.episodes).sum();
    let line = |agent: String, mean_return: Option<f64>, episodes: u64, metric: &dyn Fn(&[f64]) -> f64| {
        let mut line = vec![steps.to_string(), agent];
        line.push(mean_return.map_or(String::new(), |value| format!("{value:.4}")));
        line.push(episodes.to_string());
        let updated = |text: String| if training.updates > 0 { text } else { String::new() };
        line.extend(of_agents.iter().map(|(_, values)| updated(format!("{:.5}", metric(values)))));
        line.extend(settings.iter().map(|(_, value)| updated(format!("{value:e}"))));
        line
    };
    let mean = |values: &[f64]| values.iter().fold(0.0, |sum, value| sum + weight * value);
    let mut all = line(ALL.to_owned(), mean_return, episodes, &mean);
    all.extend(training.counters.iter().map(|(_, count)| count.to_string()));
    let mut lines = vec![all];
    for (index, agent) in training.agents.iter().enumerate() {
        let mut of_agent = line(index.to_string(), agent.mean_return, agent.episodes, &|values| values[index]);
        of_agent.extend(training.counters.iter().map(|_| String::new()));
        lines.push(of_agent);
    }
    lines
}

/// Wall time of a period.
pub(super) struct Wall {
    pub(crate) period: Duration,
    /// Wall time of the run so far.
    pub(crate) elapsed: Duration,
    /// Wall time in which no worker had an order.
    pub(crate) exchange: Duration,
}

/// Makes a line for the mean of all workers, then one per worker. Idle time is neither an activity nor an exchange. The
/// phases are those of the policies' training. Only CPU time is a sum: of all processes, the coordinator included.
pub(super) fn timing_lines(steps: u64, load: &FleetLoad, wall: &Wall) -> Vec<CsvLine> {
    let workers: Vec<&Timesheet> = load.workers.iter().map(|worker| &worker.timesheet).collect();
    let line = |worker: String, of: &[&Timesheet], coordinator_cpu: Duration| {
        let mean = |pick: &dyn Fn(&Timesheet) -> Duration| {
            of.iter().map(|timesheet| pick(timesheet).as_secs_f64()).sum::<f64>() / of.len().max(1) as f64
        };
        let whole = [wall.period, wall.elapsed, wall.exchange].map(|time| time.as_secs_f64());
        let activities = Activity::ALL.map(|activity| mean(&|timesheet| timesheet.whole(activity)));
        let idle = (whole[0] - whole[2] - activities.iter().sum::<f64>()).max(0.0);
        let phases = Phase::ALL.map(|phase| mean(&|timesheet| timesheet.phases(Activity::Training).spent(phase)));
        let cpu = [
            of.iter().map(|timesheet| timesheet.cpu()).sum::<Duration>() + coordinator_cpu,
            of.iter().map(|timesheet| timesheet.cpu_of(Activity::Evaluation)).sum(),
        ];
        let [period, elapsed, exchange] = whole;
        let [cpu, cpu_of_evaluation] = cpu.map(|time| time.as_secs_f64());
        let whole = [period, elapsed, cpu, cpu_of_evaluation, exchange];
        let seconds = whole.into_iter().chain(activities).chain([idle]).chain(phases);
        [steps.to_string(), worker]
            .into_iter()
            .chain(seconds.map(|seconds| format!("{seconds:.3}")))
            .collect::<CsvLine>()
    };
    let each = workers.iter().enumerate().map(|(index, worker)| line(index.to_string(), &[worker], Duration::ZERO));
    std::iter::once(line(ALL.to_owned(), &workers, load.coordinator_cpu)).chain(each).collect()
}

/// Makes a line for the total, then one per process.
pub(super) fn memory_lines(steps: u64, load: &FleetLoad) -> Vec<CsvLine> {
    let workers = load.workers.iter().enumerate().map(|(index, worker)| (index.to_string(), worker.footprint));
    let coordinator = load.coordinator.map(|footprint| ("coordinator".to_owned(), footprint));
    let processes: Vec<(String, Footprint)> = workers.chain(coordinator).collect();
    let total = processes.iter().fold(Footprint::default(), |total, (_, process)| Footprint {
        peak_rss_kib: total.peak_rss_kib + process.peak_rss_kib,
        pss_kib: total.pss_kib + process.pss_kib,
    });
    let megabytes = |kib: u64| format!("{:.1}", kib as f64 / 1024.0);
    let line = |(process, footprint): (String, Footprint)| {
        vec![steps.to_string(), process, megabytes(footprint.peak_rss_kib), megabytes(footprint.pss_kib)]
    };
    std::iter::once((ALL.to_owned(), total)).chain(processes).map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::base::Stopwatch;
    use dials_learn::fleet::WorkerLoad;

    #[test]
    fn sources_on_marginals_are_counted_only_if_aips_choose() {
        let loss = |on_marginals: &[bool]| AipLoss {
            training: [vec![0.5; 2], vec![0.5; 2]],
            held_out: [vec![0.5; 2], vec![0.5; 2]],
            marginals: vec![0.5; 2],
            frequencies: vec![0.5; 2],
            on_marginals: on_marginals.to_vec(),
        };
        let choosing = [loss(&[true, false]), loss(&[true, true])];
        let header = aip_header(&choosing);
        assert_eq!((header.len(), header.last().unwrap().as_str()), (10, "sources_on_marginals"));
        let lines = aip_lines(128, &choosing);
        let last: Vec<&str> = lines.iter().map(|line| line.last().unwrap().as_str()).collect();
        assert_eq!(last, ["3", "1", "1", "0", "2", "1", "1"], "all; agent 0 and its sources; agent 1 and its sources");
        assert!(lines.iter().all(|line| line.len() == 10));
        let without_sources = AipLoss {
            training: [vec![], vec![]],
            held_out: [vec![], vec![]],
            marginals: vec![],
            frequencies: vec![],
            on_marginals: vec![],
        };
        let lines = aip_lines(128, &[loss(&[true, false]), without_sources]);
        let last: Vec<&str> = lines.iter().map(|line| line.last().unwrap().as_str()).collect();
        assert_eq!(last, ["1", "1", "1", "0", "0"], "a light that nobody reaches from outside has no line per source");
        assert_eq!(lines[4][3], "0.00000", "it has nothing to predict, so it loses nothing");
        let plain = [loss(&[])];
        assert_eq!(aip_header(&plain), header[..9]);
        assert!(aip_lines(128, &plain).iter().all(|line| line.len() == 9));
    }

    #[test]
    fn seconds_of_two_workers_are_worked_out_by_hand() {
        let worker = |training: u64, step: u64, evaluation: u64| {
            let mut timesheet = Timesheet::default();
            let mut phases = Stopwatch::default();
            phases.note(Phase::SimulatorStep, Duration::from_secs(step));
            timesheet.note(Activity::Training, Duration::from_secs(training), &phases);
            // Two threads train.
            timesheet.note_cpu(Duration::from_secs(2 * training));
            // Steps of an evaluation do not count as training.
            let mut of_evaluation = Timesheet::default();
            of_evaluation.note(Activity::Evaluation, Duration::from_secs(evaluation), &phases);
            of_evaluation.note_cpu(Duration::from_secs(evaluation));
            timesheet.add(&of_evaluation);
            WorkerLoad { timesheet, footprint: Footprint::default() }
        };
        let load = FleetLoad {
            workers: vec![worker(10, 4, 5), worker(12, 6, 7)],
            coordinator_cpu: Duration::from_secs(1),
            ..FleetLoad::default()
        };
        let [period, elapsed, exchange] = [21, 30, 1].map(Duration::from_secs);
        let lines = timing_lines(128, &load, &Wall { period, elapsed, exchange });
        let header = columns::of_timing();
        let column =
            |line: usize, name: &str| lines[line][header.iter().position(|column| column == name).unwrap()].as_str();
        let of_all = ["steps", "worker", "wall_s", "exchange_s", "training_s", "evaluation_s", "simulator_step_s"];
        assert_eq!(of_all.map(|name| column(0, name)), ["128", "all", "21.000", "1.000", "11.000", "6.000", "5.000"]);
        // Idle: 21 - 1 - 10 - 5 = 5 and 21 - 1 - 12 - 7 = 1, on average 3.
        assert_eq!([0, 1, 2].map(|line| column(line, "idle_s")), ["3.000", "5.000", "1.000"]);
        // 2 x 10 + 5 = 25 and 2 x 12 + 7 = 31; with 1 of the coordinator 57.
        assert_eq!([0, 1, 2].map(|line| column(line, "cpu_s")), ["57.000", "25.000", "31.000"]);
        assert_eq!([0, 1, 2].map(|line| column(line, "cpu_evaluation_s")), ["12.000", "5.000", "7.000"]);
        assert_eq!([0, 1, 2].map(|line| lines[line].len()), [header.len(); 3]);
    }
}
