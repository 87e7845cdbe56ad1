//! Reads a run directory, also of a run that is being written.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, ensure};

use super::checkpoint::owner::check_kept;
use super::columns::{self, ALL};
use super::csv_table::{CsvTable, Order, TableLine};
use super::files;
use super::likeness;
use super::run_json::RunJson;
use super::run_record::{
    AipTrainingRecord, CpuTime, EvaluationRecord, FreshLossRecord, MemoryRecord, PeriodTime, Returns, RunRecord,
};
use dials_core::base::{Activity, Phase};
use dials_learn::progress::Moment;

/// Largest number of worker processes of a run. Every one of them has at least an agent.
const MOST_WORKERS: u64 = 1_000_000;

impl RunRecord {
    /// Reads a run directory. Errors: a damaged file, and a domain or networks that were changed after the run began.
    pub fn read(dir: &Path) -> Result<RunRecord> {
        let config = crate::config::load_kept(&dir.join(files::CONFIG))?;
        let about = RunJson::read(dir)?;
        check_kept(dir, &config, &about)?;
        let timing = CsvTable::read(&dir.join(files::TIMING))?;
        let returns = CsvTable::read(&dir.join(files::RETURNS))?;
        let episodes = CsvTable::read(&dir.join(files::EPISODES))?;
        let evaluations = read_evaluations(&returns, &episodes, about.scenario.id.agents)?;
        let workers = read_workers(&timing)?.or(about.workers).map_or(1, |workers| workers.max(1));
        Ok(RunRecord {
            config,
            about,
            evaluations,
            aip_trainings: read_aip_trainings(&CsvTable::read(&dir.join(files::AIP_LOSS))?)?,
            fresh_losses: read_fresh_losses(&CsvTable::read(&dir.join(files::AIP_DRIFT))?)?,
            likeness: likeness::read(&returns, &CsvTable::read(&dir.join(files::TRAINING))?)?,
            periods: read_periods(&timing)?,
            memory: read_memory(&CsvTable::read(&dir.join(files::MEMORY))?)?,
            workers,
            dir: dir.to_owned(),
        })
    }
}

/// Returns the number of workers: one more than the largest number of one. `None`: none has ended a period yet.
fn read_workers(timing: &CsvTable) -> Result<Option<usize>> {
    let mut workers = None;
    for line in timing.lines().filter(|line| line.text(columns::WORKER).is_some_and(|worker| worker != ALL)) {
        let worker = line.required_whole(columns::WORKER)?;
        ensure!(
            worker < MOST_WORKERS,
            line.bad(columns::WORKER, &worker.to_string(), "too large for the number of a worker")
        );
        workers = workers.max(Some(worker as usize + 1));
    }
    Ok(workers)
}

/// Reads the evaluations. A kill may have cut the last one short; then it is left out. `table`: `returns.csv`;
/// `episodes`: `episodes.csv`; `agents`: number of agents.
fn read_evaluations(table: &CsvTable, episodes: &CsvTable, agents: usize) -> Result<Vec<EvaluationRecord>> {
    let mut of_episodes = read_episodes(episodes)?;
    let (mut evaluations, mut lengths): (Vec<EvaluationRecord>, Vec<usize>) = Default::default();
    let mut order = Order::default();
    for line in table.lines() {
        let returns = Returns {
            mean: line.required(columns::MEAN)?,
            median: line.required(columns::MEDIAN)?,
            std_error: line.required(columns::STD_ERROR)?,
            stuck: line.whole(columns::STUCK)?.unwrap_or(0) as usize,
        };
        match (line.text(columns::AGENT), evaluations.last_mut()) {
            (Some(ALL), _) => {
                let steps = order.later(line)?;
                let episode_returns = of_episodes.remove(&steps).unwrap_or_default();
                evaluations.push(EvaluationRecord { steps, all: returns, agents: Vec::new(), episode_returns });
                lengths.push(line.required_whole(columns::EPISODES)? as usize);
            }
            (_, Some(evaluation)) => {
                let (steps, agent) = (line.steps()?, line.required_whole(columns::AGENT)?);
                let (of, next) = (evaluation.steps, evaluation.agents.len());
                ensure!(steps == of, line.bad(columns::STEPS, &steps.to_string(), &format!("not the {of} of `{ALL}`")));
                // A hole is told below, with what is missing.
                let what = format!("not the number of the next agent, at least {next}");
                ensure!(agent >= next as u64, line.bad(columns::AGENT, &agent.to_string(), &what));
                evaluation.agents.push(returns);
            }
            (_, None) => anyhow::bail!("{}: begins with an agent instead of `{ALL}`", files::RETURNS),
        }
    }
    // The episodes are written last.
    let is_cut =
        |last: &EvaluationRecord, length: &usize| last.agents.len() < agents || last.episode_returns.len() < *length;
    if evaluations.last().zip(lengths.last()).is_some_and(|(last, length)| is_cut(last, length)) {
        evaluations.pop();
    }
    for (EvaluationRecord { steps, agents: of_agents, episode_returns, .. }, length) in evaluations.iter().zip(lengths)
    {
        let (found, returns) = (of_agents.len(), episode_returns.len());
        ensure!(found == agents, "{}: has {found} of {agents} agents at step {steps}", files::RETURNS);
        ensure!(returns == length, "{}: has {returns} of {length} episodes at step {steps}", files::EPISODES);
    }
    Ok(evaluations)
}

/// Reads the mean returns of all agents by steps, episode by episode.
fn read_episodes(table: &CsvTable) -> Result<BTreeMap<u64, Vec<f64>>> {
    let mut of_steps: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    let mut order = Order::default();
    for line in table.lines() {
        let (steps, episode) = (order.next(line)?, line.required_whole(columns::EPISODE)? as usize);
        let returns = of_steps.entry(steps).or_default();
        anyhow::ensure!(
            episode == returns.len(),
            "{}: has episode {episode} at step {steps}, where episode {} is expected",
            files::EPISODES,
            returns.len()
        );
        returns.push(line.required(columns::RETURN)?);
    }
    Ok(of_steps)
}

fn of_all_sources(line: TableLine) -> bool {
    line.text(columns::AGENT) == Some(ALL) && line.text(columns::SOURCE).is_none_or(|source| source == ALL)
}

fn read_aip_trainings(table: &CsvTable) -> Result<Vec<AipTrainingRecord>> {
    let mut order = Order::default();
    let trainings = table.lines().filter(|&line| of_all_sources(line)).map(|line| {
        Ok(AipTrainingRecord {
            steps: order.next(line)?,
            before: line.required(columns::HELD_OUT_BEFORE)?,
            after: line.required(columns::HELD_OUT_AFTER)?,
            marginals: line.required(columns::HELD_OUT_MARGINALS)?,
        })
    });
    trainings.collect()
}

fn read_fresh_losses(table: &CsvTable) -> Result<Vec<FreshLossRecord>> {
    let mut order = Order::default();
    let losses = table.lines().filter(|&line| of_all_sources(line)).map(|line| {
        Ok(FreshLossRecord {
            steps: order.next(line)?,
            after_training: line.text(columns::AFTER) == Some(Moment::Training.name()),
            loss: line.required(columns::LOSS)?,
            marginals: line.required(columns::MARGINALS)?,
        })
    });
    losses.collect()
}

/// Activities that are not part of training the policies. If a file lacks the column of one, no time was spent on it.
const EVALUATION: [Activity; 1] = [Activity::Evaluation];
const INFLUENCE: [Activity; 2] = [Activity::Collection, Activity::AipTraining];
/// Phases of the policies' training in which PPO makes its gradient steps.
const UPDATE: [Phase; 3] = [Phase::Forward, Phase::Backward, Phase::Adam];

/// Reads sums of seconds since the run began.
///
/// A period waits for its slowest worker. So the wall time of an activity is that of the worker that took longest.
fn read_periods(table: &CsvTable) -> Result<Vec<PeriodTime>> {
    let columns_of = |activities: &[Activity]| activities.iter().copied().map(columns::seconds_of).collect::<Vec<_>>();
    let update = UPDATE.map(columns::seconds_of_phase);
    let parts = [columns_of(&EVALUATION), columns_of(&INFLUENCE), update.to_vec()];
    let mut spent = [0.0; 3];
    let mut cpu = CpuTime::default();
    let (mut periods, mut order) = (Vec::new(), Order::default());
    let lines: Vec<TableLine> = table.lines().collect();
    // The line of all workers, then one of each.
    let of_all = |line: &TableLine| line.text(columns::WORKER) == Some(ALL);
    for block in lines.chunk_by(|_, next| !of_all(next)).filter(|block| of_all(&block[0])) {
        let line = block[0];
        for (sum, columns) in spent.iter_mut().zip(&parts) {
            for column in columns {
                let of_workers = block.iter().map(|line| Ok(line.number(column)?.unwrap_or(0.0)));
                *sum += of_workers.collect::<Result<Vec<f64>>>()?.into_iter().fold(0.0, f64::max);
            }
        }
        let (steps, elapsed_s) = (order.next(line)?, line.required(columns::ELAPSED_S)?);
        cpu.total_s += line.required(columns::CPU_S)?;
        cpu.evaluation_s += line.required(columns::CPU_EVALUATION_S)?;
        let [evaluation_s, influence_s, update_s] = spent;
        periods.push(PeriodTime { steps, elapsed_s, evaluation_s, influence_s, update_s, cpu });
    }
    Ok(periods)
}

fn read_memory(table: &CsvTable) -> Result<Option<MemoryRecord>> {
    let mut memory: Option<MemoryRecord> = None;
    for line in table.lines() {
        let (rss, pss) = (line.required(columns::PEAK_RSS_MB)?, line.required(columns::PSS_MB)?);
        let here = match line.text(columns::PROCESS) {
            Some(ALL) => MemoryRecord { process_mb: 0.0, total_mb: rss, total_pss_mb: pss },
            _ => MemoryRecord { process_mb: rss, total_mb: 0.0, total_pss_mb: 0.0 },
        };
        memory = Some(memory.map_or(here, |so_far| so_far.max(here)));
    }
    Ok(memory)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::RunConfig;
    use crate::records::checkpoint::owner::Owner;
    use crate::records::joint_layout::JointLayout;
    use crate::records::networks::Layouts;
    use crate::records::run_log::RunLog;
    use crate::records::run_record::Status;
    use dials_core::base::{Ragged, Rows, Timesheet};
    use dials_core::domain::{Domain, Measures, Scenario};
    use dials_core::outside::Directory;
    use dials_learn::algorithms::{Metrics, Tables};
    use dials_learn::evaluation;
    use dials_learn::fleet::{FleetLoad, Footprint, WorkerLoad};
    use dials_learn::observer::Recorder;
    use dials_learn::predictors;
    use dials_learn::progress::TrainingProgress;
    use dials_learn::state::AgentsState;
    use dials_learn::steps::train_policies::{AgentTraining, PolicyTraining};
    use dials_testkit::toy::Coins;
    use stacknets::Layout;
    use std::time::Duration;

    fn describe(dir: &Path, agents: usize) {
        let about = RunJson::new(Scenario::new("ants", agents, 5), Vec::new(), 1);
        about.write(&Directory::open(dir).unwrap()).unwrap();
    }

    #[test]
    fn what_the_log_writes_the_reader_reads() {
        let dir = tempfile::tempdir().unwrap();
        let text = "warehouse = { agents_per_side = 2 }\n";
        std::fs::write(dir.path().join(files::CONFIG), text).unwrap();
        describe(dir.path(), 2);
        let config: RunConfig = toml::from_str(text).unwrap();
        let coins = Coins::new(1);
        let layout = || JointLayout::new(coins.kinds(), |_| Layout::new(vec![("w".to_owned(), vec![1])]));
        let owner = Owner::of(&config, &coins).unwrap();
        let mut log =
            RunLog::begin(Directory::lock(dir.path()).unwrap(), owner, Layouts { policies: layout(), aips: layout() });
        let table = || Ragged::from_vec(vec![0.5, 0.25], [1, 1]).unwrap();
        let moments = ["first_moments", "second_moments"].map(|name| (name.to_owned(), table()));
        let learners = Tables { numbers: moments.into(), ..Tables::default() };
        let agents = AgentsState { steps: 128, policies: table(), learners, aips: table(), streams: vec![] };

        // Agents' means 2 and 4; episode means 1 and 5: deviation sqrt(8), standard error sqrt(8 / 2) = 2.
        let returns = Rows::from_vec(vec![0.0, 2.0, 4.0, 6.0], 2);
        let played = evaluation::Evaluation { returns, measures: Measures::default(), stuck: vec![false, true] };
        log.evaluated(&agents, &played).unwrap();
        let loss = |before, after| predictors::AipLoss {
            training: [vec![9.0], vec![9.0]],
            held_out: [vec![before], vec![after]],
            marginals: vec![0.5],
            frequencies: vec![0.25],
            on_marginals: Vec::new(),
        };
        log.aips_trained(&agents, &[loss(0.75, 0.25), loss(0.25, 0.25)]).unwrap();
        let fresh = predictors::FreshLoss { predictor: vec![0.375], marginals: vec![0.5] };
        log.aips_measured(&agents, Moment::Training, &[fresh.clone(), fresh]).unwrap();
        let mut timesheet = Timesheet::default();
        timesheet.note(Activity::Evaluation, Duration::from_secs(3), &Default::default());
        timesheet.note(Activity::Collection, Duration::from_secs(2), &Default::default());
        timesheet.note_cpu(Duration::from_secs(7));
        let mebibytes = |peak: u64, shared: u64| Footprint { peak_rss_kib: peak << 10, pss_kib: shared << 10 };
        let worker = WorkerLoad { timesheet, footprint: mebibytes(30, 20) };
        let load = FleetLoad { workers: vec![worker], coordinator: Some(mebibytes(40, 10)), ..FleetLoad::default() };
        let of_agent = AgentTraining { mean_return: None, episodes: 0 };
        let metrics = Metrics { of_agents: vec![("loss".to_owned(), vec![0.5; 2])], settings: Vec::new() };
        let training = PolicyTraining { agents: vec![of_agent; 2], metrics, updates: 1, counters: Vec::new() };
        log.period_done(&agents, &TrainingProgress::default(), &training, load).unwrap();

        let read = RunRecord::read(dir.path()).unwrap();
        let [found] = &read.evaluations[..] else { panic!("{:?}", read.evaluations) };
        assert_eq!((found.steps, found.all.mean, found.all.std_error, found.all.stuck), (128, 3.0, 2.0, 1));
        assert_eq!((found.agents[1].mean, found.agents[1].stuck), (4.0, 1));
        assert_eq!(found.episode_returns, [1.0, 5.0]);
        let AipTrainingRecord { steps, before, after, marginals } = read.aip_trainings[0];
        assert_eq!((steps, before, after, marginals), (128, 0.5, 0.25, 0.5));
        let FreshLossRecord { after_training, loss, marginals, .. } = read.fresh_losses[0];
        assert_eq!((after_training, loss, marginals), (true, 0.375, 0.5));
        let time = read.total_time().unwrap();
        assert_eq!((time.evaluation_s, time.influence_s, time.cpu.total_s), (3.0, 2.0, 7.0));
        let memory = read.memory.unwrap();
        assert_eq!((memory.process_mb, memory.total_mb, memory.total_pss_mb), (40.0, 70.0, 30.0));
        assert_eq!(read.workers, 1);
    }

    /// Reads evaluations of two agents and no episodes.
    fn evaluations(text: &str) -> Result<Vec<(u64, usize)>> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(files::RETURNS);
        let lines: String = text.lines().map(|line| format!("{line},0\n")).collect();
        std::fs::write(&path, format!("steps,agent,mean,median,std_error,episodes\n{lines}")).unwrap();
        let read = read_evaluations(&CsvTable::read(&path)?, &CsvTable::read(&dir.path().join(files::EPISODES))?, 2)?;
        Ok(read.iter().map(|evaluation| (evaluation.steps, evaluation.agents.len())).collect())
    }

    #[test]
    fn an_evaluation_that_was_cut_short_is_none_and_a_hole_in_the_middle_is_told() {
        let block = |steps: u64, agents: usize| {
            let names = std::iter::once("all".to_owned()).chain((0..agents).map(|agent| agent.to_string()));
            names.map(|name| format!("{steps},{name},1,1,0\n")).collect::<String>()
        };
        assert_eq!(evaluations(&(block(0, 2) + &block(100, 1))).unwrap(), [(0, 2)]);
        assert_eq!(evaluations(&block(0, 0)).unwrap(), [], "without agents there is no evaluation");
        let error = evaluations(&(block(0, 2) + &block(100, 1) + &block(200, 2))).unwrap_err().to_string();
        assert_eq!(error, "returns.csv: has 1 of 2 agents at step 100");
    }

    #[test]
    fn episodes_belong_to_the_evaluation_of_their_step() {
        let dir = tempfile::tempdir().unwrap();
        let read = |episodes: &str| -> Result<Vec<EvaluationRecord>> {
            let [returns, file] = [files::RETURNS, files::EPISODES].map(|name| dir.path().join(name));
            let blocks = "0,all,1,1,0,1\n0,0,1,1,0,1\n100,all,2,2,0,2\n100,0,2,2,0,2\n";
            std::fs::write(&returns, format!("steps,agent,mean,median,std_error,episodes\n{blocks}")).unwrap();
            std::fs::write(&file, format!("steps,episode,return\n{episodes}")).unwrap();
            read_evaluations(&CsvTable::read(&returns)?, &CsvTable::read(&file)?, 1)
        };
        let found = read("0,0,1.000000\n100,0,1.500000\n100,1,2.500000\n").unwrap();
        assert_eq!((&found[0].episode_returns[..], &found[1].episode_returns[..]), (&[1.0][..], &[1.5, 2.5][..]));
        let error = |episodes| read(episodes).unwrap_err().to_string();
        for unfinished in ["0,0,1\n", "0,0,1\n100,0,1.5\n"] {
            assert_eq!(read(unfinished).unwrap().len(), 1, "the last ones are still being written");
        }
        assert_eq!(error("0,0,1\n0,1,1\n"), "episodes.csv: has 2 of 1 episodes at step 0");
        assert_eq!(error("100,1,1.5\n"), "episodes.csv: has episode 1 at step 100, where episode 0 is expected");
    }

    #[test]
    fn lines_that_this_program_never_writes_are_refused() {
        let block = "0,all,1,1,0\n0,0,1,1,0\n0,1,1,1,0\n";
        for (text, message) in [
            ("100,all,1,1,0\n50,all,1,1,0\n", "`steps` holds \"50\", which is not later than 100 before it"),
            ("100,all,1,1,0\n100,all,1,1,0\n", "`steps` holds \"100\", which is not later than 100 before it"),
            ("-1,all,1,1,0\n", "`steps` holds \"-1\", which is not a whole number"),
            ("9e15,all,1,1,0\n", "`steps` holds \"9e15\", which is not a whole number"),
            ("10000000000000000,all,1,1,0\n", "which is not a whole number from 0 to 1000000000000000"),
            ("100,all,,1,0\n", "line 5: has no `mean`"),
            ("100,all,1,inf,0\n", "line 5: `median` holds \"inf\", which is not a finite number"),
            ("100,all,1,1,1e300\n", "line 5: `std_error` holds \"1e300\", which is too large"),
            ("100,all,1,1,0\n99,0,1,1,0\n", "line 6: `steps` holds \"99\", which is not the 100 of `all`"),
            ("100,all,1,1,0\n100,,1,1,0\n", "line 6: has no `agent`"),
            ("100,all,1,1,0\n100,x,1,1,0\n", "line 6: `agent` holds \"x\", which is not a whole number"),
            ("100,all,1,1,0\n100,0,1,1,0\n100,0,1,1,0\n", "`agent` holds \"0\", which is not the number of the next"),
        ] {
            let error = evaluations(&format!("{block}{text}")).unwrap_err().to_string();
            assert!(error.contains(message) && error.contains("returns.csv"), "{error}");
        }
    }

    #[test]
    fn a_period_waits_for_its_slowest_worker() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(files::TIMING);
        // Two workers: one evaluates for 6 s, the other trains AIPs for 5 s and collects for 1 s.
        let lines = "0,all,10,9,4,3,1.5,2.5,1,1,2\n0,0,10,,,6,2,0,2,2,4\n0,1,10,,,0,1,5,0,0,0\n\
                     100,all,20,8,3,0,0,0,1,1,1\n100,0,20,,,0,0,0,2,2,2\n";
        let header = "steps,worker,elapsed_s,cpu_s,cpu_evaluation_s,evaluation_s,collection_s,aip_training_s,forward_s,backward_s,adam_s";
        std::fs::write(&path, format!("{header}\n{lines}")).unwrap();
        let periods = read_periods(&CsvTable::read(&path).unwrap()).unwrap();
        let times = |time: &PeriodTime| (time.elapsed_s, time.evaluation_s, time.influence_s, time.update_s);
        assert_eq!(periods.iter().map(times).collect::<Vec<_>>(), [(10.0, 6.0, 7.0, 8.0), (20.0, 6.0, 7.0, 14.0)]);
        assert_eq!(periods[1].cpu, CpuTime { total_s: 17.0, evaluation_s: 7.0 });
    }

    #[test]
    fn a_file_without_the_column_of_steps_is_damaged_and_an_empty_one_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(files::RETURNS);
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            CsvTable::read(&path).map(|table| table.lines().count()).map_err(|error| error.to_string())
        };
        assert_eq!([read(""), read("steps,agent\n"), read("ste")], [Ok(0), Ok(0), Ok(0)]);
        assert!(
            read("{\n")
                .unwrap_err()
                .ends_with("has no column `steps`; the file is damaged: copy it again, or train again")
        );
    }

    #[test]
    fn workers_are_counted_by_their_numbers() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(files::TIMING);
        let workers = |lines: &str| {
            std::fs::write(&path, format!("steps,worker\n{lines}")).unwrap();
            read_workers(&CsvTable::read(&path).unwrap()).map_err(|error| error.to_string())
        };
        assert_eq!([workers(""), workers("1,all\n1,0\n1,3\n2,all\n")], [Ok(None), Ok(Some(4))]);
        for absurd in ["18446744073709551615", "1000000", "-1", "x"] {
            assert!(workers(&format!("1,{absurd}\n")).unwrap_err().contains("line 2: `worker` holds"), "{absurd}");
        }
    }

    #[test]
    fn a_run_whose_files_disagree_on_the_agents_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join(files::CONFIG), "warehouse = { agents_per_side = 2 }\n").unwrap();
        describe(dir.path(), 3);
        let read = |evaluations: u64, agents: u64| {
            let block = |steps: u64| {
                let agents = (0..agents).map(|agent| format!("{steps},{agent},1,1,0,0\n"));
                format!("{steps},all,1,1,0,0\n{}", agents.collect::<String>())
            };
            let blocks: String = (0..evaluations).map(block).collect();
            let text = format!("steps,agent,mean,median,std_error,episodes\n{blocks}");
            std::fs::write(dir.path().join(files::RETURNS), text).unwrap();
            RunRecord::read(dir.path())
        };
        for (evaluations, agents) in [(2, 1), (1, 4)] {
            let error = format!("{:#}", read(evaluations, agents).unwrap_err());
            assert!(error.ends_with(&format!("returns.csv: has {agents} of 3 agents at step 0")), "{error}");
        }
        assert_eq!(read(1, 2).unwrap().status(), Status::Empty, "its first evaluation was cut short");
        assert_eq!(read(1, 3).unwrap().status(), Status::Unfinished { steps: 0 });
    }
}
