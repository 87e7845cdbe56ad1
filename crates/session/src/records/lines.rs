//! The lines of the CSV files of a run, in the order of their [`columns`].

use std::time::Duration;

use super::columns::{self, ALL};
use dials_core::base::statistics::mean;
use dials_core::base::{Activity, Phase, Timesheet};
use dials_learn::algorithms::Metrics;
use dials_learn::algorithms::imitation::ImitationLoss;
use dials_learn::evaluation::csv::Lines;
use dials_learn::evaluation::{Evaluation, Summary};
use dials_learn::fleet::{FleetLoad, Footprint};
use dials_learn::predictors::{AipLoss, FreshLoss, mean_loss};
use dials_learn::progress::Moment;
use dials_learn::steps::train_policies::PolicyTraining;

pub(super) type CsvLine = Vec<String>;

/// Returns lines under fixed columns and `further` ones. A line that is short ends with empty fields.
fn under<'a>(columns: &[&'a str], further: impl IntoIterator<Item = &'a str>, mut lines: Vec<CsvLine>) -> Lines {
    let header: CsvLine = columns.iter().copied().chain(further).map(str::to_owned).collect();
    lines.iter_mut().for_each(|line| line.resize(header.len(), String::new()));
    Lines { header, lines }
}

/// Makes the beginning of a line: the timesteps, and the agent, worker or process that it is of.
fn begin(steps: u64, of: impl ToString) -> CsvLine {
    vec![steps.to_string(), of.to_string()]
}

fn extend(line: &mut CsvLine, figures: impl IntoIterator<Item = f64>, decimals: usize) {
    line.extend(figures.into_iter().map(|figure| format!("{figure:.decimals$}")));
}

/// Makes a line for all agents, then one per agent, without figures of the whole system and `stuck` 0 or 1.
pub(super) fn evaluation_lines(steps: u64, evaluation: &Evaluation) -> Lines {
    let (per_agent, system) = (&evaluation.measures.per_agent, &evaluation.measures.system);
    let line = |agent: String, summary: Summary, stuck: usize, measures: Vec<f64>| {
        let mut line = begin(steps, agent);
        extend(&mut line, [summary.mean, summary.median, summary.std_error], 4);
        line.extend([evaluation.episodes().to_string(), stuck.to_string()]);
        extend(&mut line, measures, 4);
        line
    };
    let means = per_agent.iter().map(|(_, values)| values.iter().sum::<f64>() / values.len() as f64);
    let of_all = means.chain(system.iter().map(|&(_, value)| value)).collect();
    let stuck = evaluation.stuck.iter().filter(|&&stuck| stuck).count();
    let mut lines = vec![line(ALL.to_owned(), evaluation.of_all(), stuck, of_all)];
    for agent in 0..evaluation.agents() {
        let stuck = usize::from(evaluation.stuck[agent]);
        let measures = per_agent.iter().map(|(_, values)| values[agent]).collect();
        lines.push(line(agent.to_string(), evaluation.of_agent(agent), stuck, measures));
    }
    let names = per_agent.iter().map(|(name, _)| &**name).chain(system.iter().map(|(name, _)| &**name));
    under(&columns::OF_RETURNS, names, lines)
}

/// Makes a line per episode of an evaluation, with the mean return of all agents.
pub(super) fn episode_lines(steps: u64, evaluation: &Evaluation) -> Lines {
    let episodes = evaluation.returns.iter().enumerate();
    let line = |(episode, returns): (usize, &[f64])| {
        let mut line = begin(steps, episode);
        extend(&mut line, [mean(returns)], 6);
        line
    };
    under(&columns::OF_EPISODES, [], episodes.map(line).collect())
}

/// Makes a line for the mean of all agents, then one per agent.
pub(super) fn imitation_lines(steps: u64, losses: &[ImitationLoss]) -> Lines {
    let line = |agent: String, loss: &ImitationLoss| {
        let mut line = begin(steps, agent);
        extend(&mut line, loss.cross_entropy.into_iter().chain(loss.accuracy), 5);
        line
    };
    let mut lines = vec![line(ALL.to_owned(), &ImitationLoss::mean_of(losses))];
    lines.extend(losses.iter().enumerate().map(|(agent, loss)| line(agent.to_string(), loss)));
    under(&columns::OF_IMITATION, [], lines)
}

/// Makes a line for the mean of all agents, each with the mean of its sources. Then for each agent, one line for that mean
/// and one per source. If predictors choose between a network and marginals, each line ends with the number of sources
/// on marginals.
pub(super) fn aip_lines(steps: u64, losses: &[AipLoss]) -> Lines {
    let choose = losses.iter().any(|loss| !loss.on_marginals.is_empty());
    let line = |agent: &str, source: &str, figures: [f64; 6], on_marginals: usize| {
        let mut line = begin(steps, agent);
        line.push(source.to_owned());
        extend(&mut line, figures, 5);
        line.extend(choose.then(|| on_marginals.to_string()));
        line
    };
    let (mut lines, mut of_agents, mut on_marginals_in_all) = (Vec::new(), Vec::new(), 0);
    for (agent, loss) in losses.iter().enumerate() {
        let agent = agent.to_string();
        let ([before, after], [held_out_before, held_out_after]) = (&loss.training, &loss.held_out);
        let figures_of = |source: usize| {
            let held_out = [held_out_before[source], held_out_after[source]];
            [before[source], after[source], held_out[0], held_out[1], loss.marginals[source], loss.frequencies[source]]
        };
        let of_sources: Vec<[f64; 6]> = (0..loss.marginals.len()).map(figures_of).collect();
        let on_marginals = loss.on_marginals.iter().filter(|&&on_marginals| on_marginals).count();
        lines.push(line(&agent, ALL, mean_of(&of_sources), on_marginals));
        for (source, &figures) in of_sources.iter().enumerate() {
            let on_marginals = usize::from(loss.on_marginals.get(source) == Some(&true));
            lines.push(line(&agent, &source.to_string(), figures, on_marginals));
        }
        of_agents.push(mean_of(&of_sources));
        on_marginals_in_all += on_marginals;
    }
    lines.insert(0, line(ALL, ALL, mean_of(&of_agents), on_marginals_in_all));
    under(&columns::OF_AIP_LOSS, choose.then_some(columns::SOURCES_ON_MARGINALS), lines)
}

fn mean_of(rows: &[[f64; 6]]) -> [f64; 6] {
    std::array::from_fn(|column| mean_loss(&rows.iter().map(|row| row[column]).collect::<Vec<_>>()))
}

/// Makes a line for the mean of all agents, then one per agent, each the mean of its sources.
pub(super) fn drift_lines(steps: u64, after: Moment, losses: &[FreshLoss]) -> Lines {
    let line = |agent: String, figures: [f64; 2]| {
        let mut line = begin(steps, agent);
        line.push(after.name().to_owned());
        extend(&mut line, figures, 5);
        line
    };
    let mut lines = vec![line(ALL.to_owned(), FreshLoss::means_of_all(losses))];
    lines.extend(losses.iter().enumerate().map(|(agent, loss)| line(agent.to_string(), loss.means())));
    under(&columns::OF_AIP_DRIFT, [], lines)
}

/// Makes a line for all agents (means; sums of episodes and counters), then one per agent. No update: no metrics.
pub(super) fn training_lines(steps: u64, training: &PolicyTraining) -> Lines {
    let Metrics { of_agents, settings } = &training.metrics;
    let weight = 1.0 / training.agents.len() as f64;
    let returns: Vec<f64> = training.agents.iter().filter_map(|agent| agent.mean_return()).collect();
    let mean_return = (!returns.is_empty()).then(|| returns.iter().sum::<f64>() / returns.len() as f64);
    let line = |agent: String, mean_return: Option<f64>, episodes: u64, metric: &dyn Fn(&[f64]) -> f64| {
        let mut line = begin(steps, agent);
        line.push(mean_return.map_or(String::new(), |value| format!("{value:.4}")));
        line.push(episodes.to_string());
        let updated = |text: String| if training.updates > 0 { text } else { String::new() };
        line.extend(of_agents.iter().map(|(_, values)| updated(format!("{:.5}", training.mean(metric(values))))));
        line.extend(settings.iter().map(|(_, value)| updated(format!("{value:e}"))));
        line
    };
    let episodes = training.agents.iter().map(|agent| agent.episodes).sum();
    let mean = |values: &[f64]| values.iter().fold(0.0, |sum, value| sum + weight * value);
    let mut all = line(ALL.to_owned(), mean_return, episodes, &mean);
    all.extend(training.counters.iter().map(|(_, count)| count.to_string()));
    let agents = training.agents.iter().enumerate();
    let of_agents = agents
        .map(|(index, agent)| line(index.to_string(), agent.mean_return(), agent.episodes, &|values| values[index]));
    let lines = std::iter::once(all).chain(of_agents).collect();
    let counters = training.counters.iter().map(|(name, _)| &**name);
    under(&columns::OF_TRAINING, training.metrics.names().chain(counters), lines)
}

pub(super) struct Wall {
    pub(crate) period: Duration,
    /// Wall time of the run so far.
    pub(crate) elapsed: Duration,
    /// Wall time in which no worker had an order.
    pub(crate) exchange: Duration,
}

/// Makes a line for the mean of all workers, then one per worker. Idle time is neither an activity nor an exchange. The
/// phases are those of the policies' training. Only CPU time is a sum: of all processes, the coordinator included.
pub(super) fn timing_lines(steps: u64, load: &FleetLoad, wall: &Wall) -> Lines {
    let workers: Vec<&Timesheet> = load.workers.iter().map(|worker| &worker.timesheet).collect();
    let line = |worker: String, of: &[&Timesheet], coordinator_cpu: Duration| {
        let mean = |pick: &dyn Fn(&Timesheet) -> Duration| {
            of.iter().map(|timesheet| pick(timesheet).as_secs_f64()).sum::<f64>() / of.len().max(1) as f64
        };
        let cpu = of.iter().map(|timesheet| timesheet.cpu()).sum::<Duration>() + coordinator_cpu;
        let cpu_of_evaluation = of.iter().map(|timesheet| timesheet.cpu_of(Activity::Evaluation)).sum();
        let whole = [wall.period, wall.elapsed, cpu, cpu_of_evaluation, wall.exchange].map(|time| time.as_secs_f64());
        let [period, .., exchange] = whole;
        let activities = Activity::ALL.map(|activity| mean(&|timesheet| timesheet.whole(activity)));
        let idle = (period - exchange - activities.iter().sum::<f64>()).max(0.0);
        let phases = Phase::ALL.map(|phase| mean(&|timesheet| timesheet.phases(Activity::Training).spent(phase)));
        let mut line = begin(steps, worker);
        extend(&mut line, whole.into_iter().chain(activities).chain([idle]).chain(phases), 3);
        line
    };
    let mut lines = vec![line(ALL.to_owned(), &workers, load.coordinator_cpu)];
    lines.extend(workers.iter().enumerate().map(|(index, worker)| line(index.to_string(), &[worker], Duration::ZERO)));
    Lines { header: columns::of_timing(), lines }
}

/// Makes a line for the total, then one per process.
pub(super) fn memory_lines(steps: u64, load: &FleetLoad) -> Lines {
    let workers = load.workers.iter().enumerate().map(|(index, worker)| (index.to_string(), worker.footprint));
    let coordinator = load.coordinator.map(|footprint| ("coordinator".to_owned(), footprint));
    let processes: Vec<(String, Footprint)> = workers.chain(coordinator).collect();
    let total = processes.iter().fold(Footprint::default(), |total, (_, process)| Footprint {
        peak_rss_kib: total.peak_rss_kib + process.peak_rss_kib,
        pss_kib: total.pss_kib + process.pss_kib,
    });
    let line = |(process, footprint): (String, Footprint)| {
        let mut line = begin(steps, process);
        extend(&mut line, [footprint.peak_rss_kib, footprint.pss_kib].map(|kib| kib as f64 / 1024.0), 1);
        line
    };
    let lines = std::iter::once((ALL.to_owned(), total)).chain(processes).map(line).collect();
    under(&columns::OF_MEMORY, [], lines)
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
        let Lines { header, lines } = aip_lines(128, &[loss(&[true, false]), loss(&[true, true])]);
        assert_eq!((header.len(), header.last().unwrap().as_str()), (10, "sources_on_marginals"));
        let last = |lines: &[CsvLine]| lines.iter().map(|line| line.last().unwrap().clone()).collect::<Vec<_>>();
        assert_eq!(
            last(&lines),
            ["3", "1", "1", "0", "2", "1", "1"],
            "all; agent 0 and its sources; agent 1 and its sources"
        );
        assert!(lines.iter().all(|line| line.len() == 10));
        let nothing = || [vec![], vec![]];
        let without_sources = AipLoss { training: nothing(), held_out: nothing(), marginals: vec![], ..loss(&[]) };
        let Lines { lines, .. } = aip_lines(128, &[loss(&[true, false]), without_sources]);
        assert_eq!(
            last(&lines),
            ["1", "1", "1", "0", "0"],
            "a light that nobody reaches from outside has no line per source"
        );
        assert_eq!(lines[4][3], "0.00000", "it has nothing to predict, so it loses nothing");
        let Lines { header, lines } = aip_lines(128, &[loss(&[])]);
        assert_eq!(header.len(), 9);
        assert!(lines.iter().all(|line| line.len() == 9));
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
        let Lines { header, lines } = timing_lines(128, &load, &Wall { period, elapsed, exchange });
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
