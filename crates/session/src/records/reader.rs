//! Reads a run directory, also of a run that is being written.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, ensure};

use super::checkpoint::owner::check_kept;
use super::columns::{self, ALL};
use super::csv_table::{CsvTable, Order, TableLine};
use super::files;
use super::run_json::RunJson;
use super::run_record::{
    AipTrainingRecord, CpuTime, EvaluationRecord, FreshLossRecord, LikenessRecord, MemoryRecord, PeriodTime, Returns,
    RunRecord,
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
            likeness: read_likeness(&returns, &CsvTable::read(&dir.join(files::TRAINING))?)?,
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

/// Reads the evaluations of `returns.csv` and `episodes.csv`. If a kill has cut the last one short, it is left out.
fn read_evaluations(table: &CsvTable, episodes: &CsvTable, agents: usize) -> Result<Vec<EvaluationRecord>> {
    let mut of_episodes = read_episodes(episodes)?;
    let (mut evaluations, mut order) = (Vec::new(), Order::default());
    let blocks = table.blocks(columns::AGENT);
    for (place, block) in blocks.iter().enumerate() {
        let (&of_all, lines) = block.split_first().expect("a block has a line");
        ensure!(of_all.is_of_all(columns::AGENT), "{}: begins with an agent instead of `{ALL}`", files::RETURNS);
        let (all, steps) = (read_returns(of_all)?, order.later(of_all)?);
        let episodes = of_all.required_whole(columns::EPISODES)? as usize;
        let mut of_agents = Vec::new();
        for &line in lines {
            let (at, agent) = (line.steps()?, line.required_whole(columns::AGENT)?);
            let what = format!("not the {steps} of `{ALL}`");
            ensure!(at == steps, line.bad(columns::STEPS, &at.to_string(), &what));
            // A hole is reported below, with what is missing.
            let what = format!("not the number of the next agent, at least {}", of_agents.len());
            ensure!(agent >= of_agents.len() as u64, line.bad(columns::AGENT, &agent.to_string(), &what));
            of_agents.push(read_returns(line)?);
        }
        let episode_returns = of_episodes.remove(&steps).unwrap_or_default();
        let (found, played) = (of_agents.len(), episode_returns.len());
        // The episodes are written last.
        if place + 1 == blocks.len() && (found < agents || played < episodes) {
            break;
        }
        ensure!(found == agents, "{}: has {found} of {agents} agents at step {steps}", files::RETURNS);
        ensure!(played == episodes, "{}: has {played} of {episodes} episodes at step {steps}", files::EPISODES);
        evaluations.push(EvaluationRecord { steps, all, agents: of_agents, episode_returns });
    }
    Ok(evaluations)
}

fn read_returns(line: TableLine) -> Result<Returns> {
    Ok(Returns {
        mean: line.required(columns::MEAN)?,
        median: line.required(columns::MEDIAN)?,
        std_error: line.required(columns::STD_ERROR)?,
        stuck: line.whole(columns::STUCK)?.unwrap_or(0) as usize,
    })
}

/// Reads the mean returns of all agents by steps, episode by episode.
fn read_episodes(table: &CsvTable) -> Result<BTreeMap<u64, Vec<f64>>> {
    let mut of_steps: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    let mut order = Order::default();
    for line in table.lines() {
        let (steps, episode) = (order.next(line)?, line.required_whole(columns::EPISODE)? as usize);
        let returns = of_steps.entry(steps).or_default();
        ensure!(
            episode == returns.len(),
            "{}: has episode {episode} at step {steps}, where episode {} is expected",
            files::EPISODES,
            returns.len()
        );
        returns.push(line.required(columns::RETURN)?);
    }
    Ok(of_steps)
}

/// Returns the lines of all agents and all sources.
fn of_all(table: &CsvTable) -> impl Iterator<Item = TableLine<'_>> {
    let of_all_sources = |line: &TableLine| line.text(columns::SOURCE).is_none_or(|source| source == ALL);
    table.lines().filter(move |line| line.is_of_all(columns::AGENT) && of_all_sources(line))
}

fn read_aip_trainings(table: &CsvTable) -> Result<Vec<AipTrainingRecord>> {
    let mut order = Order::default();
    let read = |line: TableLine| {
        Ok(AipTrainingRecord {
            steps: order.next(line)?,
            before: line.required(columns::HELD_OUT_BEFORE)?,
            after: line.required(columns::HELD_OUT_AFTER)?,
            marginals: line.required(columns::HELD_OUT_MARGINALS)?,
        })
    };
    of_all(table).map(read).collect()
}

fn read_fresh_losses(table: &CsvTable) -> Result<Vec<FreshLossRecord>> {
    let mut order = Order::default();
    let read = |line: TableLine| {
        Ok(FreshLossRecord {
            steps: order.next(line)?,
            after_training: line.text(columns::AFTER) == Some(Moment::Training.name()),
            loss: line.required(columns::LOSS)?,
            marginals: line.required(columns::MARGINALS)?,
        })
    };
    of_all(table).map(read).collect()
}

/// Reads what the GS showed in each evaluation beside what the local simulators showed since the one before it.
fn read_likeness(returns: &CsvTable, training: &CsvTable) -> Result<Vec<LikenessRecord>> {
    let mut counted = Vec::new();
    for line in of_all(training) {
        let Some(decisions) = line.whole(columns::LOCAL_DECISIONS)? else { continue };
        let [cars, speed_mmps] = [columns::LOCAL_CARS, columns::LOCAL_SPEED_MMPS].map(|name| line.required_whole(name));
        counted.push((line.steps()?, [decisions, cars?, speed_mmps?]));
    }
    let (mut found, mut before) = (Vec::new(), 0);
    for line in of_all(returns) {
        let steps = line.steps()?;
        let since = counted.iter().filter(|(end, _)| (before + 1..=steps).contains(end));
        let [decisions, cars, speed_mmps] =
            since.fold([0.0; 3], |sums, (_, counts)| std::array::from_fn(|place| sums[place] + counts[place] as f64));
        before = steps;
        let [gs_cars, gs_speed] = [columns::CARS_PER_LIGHT, columns::MEAN_SPEED_MPS].map(|name| line.number(name));
        if let (Some(gs_cars), Some(gs_speed)) = (gs_cars?, gs_speed?)
            && cars > 0.0
        {
            let (cars, speed_mps) = ([gs_cars, cars / decisions], [gs_speed, speed_mmps / 1000.0 / cars]);
            found.push(LikenessRecord { steps, cars, speed_mps });
        }
    }
    Ok(found)
}

/// Reads sums of seconds since the run began. If a file lacks a column of seconds, no time was spent on that.
/// A period waits for its slowest worker. So the wall time of an activity is that of the worker that took longest.
fn read_periods(table: &CsvTable) -> Result<Vec<PeriodTime>> {
    let evaluation = vec![Activity::Evaluation.name()];
    let influence = vec![Activity::Collection.name(), Activity::AipTraining.name()];
    // The phases of the policies' training in which PPO makes its gradient steps.
    let update = vec![Phase::Forward.name(), Phase::Backward.name(), Phase::Adam.name()];
    let parts = [evaluation, influence, update];
    let (mut spent, mut cpu) = ([0.0; 3], CpuTime::default());
    let (mut periods, mut order) = (Vec::new(), Order::default());
    for block in table.blocks(columns::WORKER) {
        let line = block[0];
        if !line.is_of_all(columns::WORKER) {
            continue;
        }
        for (sum, names) in spent.iter_mut().zip(&parts) {
            for name in names {
                let column = columns::seconds_of(name);
                let of_workers = block.iter().map(|line| Ok(line.number(&column)?.unwrap_or(0.0)));
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
        let [process_mb, total_mb, total_pss_mb] =
            if line.is_of_all(columns::PROCESS) { [0.0, rss, pss] } else { [rss, 0.0, 0.0] };
        let here = MemoryRecord { process_mb, total_mb, total_pss_mb };
        memory = Some(memory.map_or(here, |so_far| so_far.max(here)));
    }
    Ok(memory)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads evaluations of two agents and no episodes.
    fn evaluations(text: &str) -> Result<Vec<(u64, usize)>> {
        let lines: String = text.lines().map(|line| format!("{line},0\n")).collect();
        let returns = CsvTable::of(&format!("steps,agent,mean,median,std_error,episodes\n{lines}"));
        let read = read_evaluations(&returns, &CsvTable::of(""), 2)?;
        Ok(read.iter().map(|evaluation| (evaluation.steps, evaluation.agents.len())).collect())
    }

    #[test]
    fn episodes_belong_to_the_evaluation_of_their_step() {
        let blocks = "0,all,1,1,0,1\n0,0,1,1,0,1\n100,all,2,2,0,2\n100,0,2,2,0,2\n";
        let returns = CsvTable::of(&format!("steps,agent,mean,median,std_error,episodes\n{blocks}"));
        let read =
            |episodes: &str| read_evaluations(&returns, &CsvTable::of(&format!("steps,episode,return\n{episodes}")), 1);
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
        let block = "100,all,1,1,0\n100,0,1,1,0\n100,1,1,1,0\n";
        for (text, message) in [
            ("200,all,,1,0\n", "line 5: has no `mean`"),
            ("200,all,1,1,0\n99,0,1,1,0\n", "line 6: `steps` holds \"99\", which is not the 200 of `all`"),
            ("200,all,1,1,0\n200,,1,1,0\n", "line 6: has no `agent`"),
            ("200,all,1,1,0\n200,x,1,1,0\n", "line 6: `agent` holds \"x\", which is not a whole number"),
            ("200,all,1,1,0\n200,0,1,1,0\n200,0,1,1,0\n", "`agent` holds \"0\", which is not the number of the next"),
            ("200,all,1,1,0\n200,0,1,1,0\n200,1,1,1,0\n200,2,1,1,0\n", "has 3 of 2 agents at step 200"),
        ] {
            let error = evaluations(&format!("{block}{text}")).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }

    #[test]
    fn a_period_waits_for_its_slowest_worker() {
        // Two workers: one evaluates for 6 s, the other trains AIPs for 5 s and collects for 1 s.
        let header = "steps,worker,elapsed_s,cpu_s,cpu_evaluation_s,evaluation_s,collection_s,aip_training_s,forward_s,backward_s,adam_s";
        let lines = "0,all,10,9,4,3,1.5,2.5,1,1,2\n0,0,10,,,6,2,0,2,2,4\n0,1,10,,,0,1,5,0,0,0\n\
                     100,all,20,8,3,0,0,0,1,1,1\n100,0,20,,,0,0,0,2,2,2\n";
        let periods = read_periods(&CsvTable::of(&format!("{header}\n{lines}"))).unwrap();
        let times = |time: &PeriodTime| (time.elapsed_s, time.evaluation_s, time.influence_s, time.update_s);
        assert_eq!(periods.iter().map(times).collect::<Vec<_>>(), [(10.0, 6.0, 7.0, 8.0), (20.0, 6.0, 7.0, 14.0)]);
        assert_eq!(periods[1].cpu, CpuTime { total_s: 17.0, evaluation_s: 7.0 });
    }

    #[test]
    fn an_evaluation_is_compared_with_all_periods_since_the_one_before() {
        let returns = CsvTable::of(
            "steps,agent,mean_speed_mps,cars_per_light\n0,all,9,2\n0,0,,\n20,all,8,4\n20,0,,\n30,all,5,10\n30,0,,\n",
        );
        let training = CsvTable::of(
            "steps,agent,local_decisions,local_cars,local_speed_mmps\n10,all,100,300,3000000\n10,0,,,\n\
             20,all,100,500,1000000\n20,0,,,\n30,all,0,0,0\n30,0,,,\n",
        );
        // 800 cars at 200 decisions, at 4 000 000 / 1000 / 800 m/s. Then the roads of no row were filled.
        let expected = LikenessRecord { steps: 20, cars: [4.0, 4.0], speed_mps: [8.0, 5.0] };
        assert_eq!(read_likeness(&returns, &training).unwrap(), [expected]);
        let without = CsvTable::of("steps,agent,sampled_arrivals\n10,all,7\n");
        assert_eq!(read_likeness(&returns, &without).unwrap(), [], "a run that counts nothing compares nothing");
    }

    #[test]
    fn workers_are_counted_by_their_numbers() {
        let workers = |lines: &str| {
            read_workers(&CsvTable::of(&format!("steps,worker\n{lines}"))).map_err(|error| error.to_string())
        };
        assert_eq!([workers(""), workers("1,all\n1,0\n1,3\n2,all\n")], [Ok(None), Ok(Some(4))]);
        for absurd in ["18446744073709551615", "1000000", "-1", "x"] {
            assert!(workers(&format!("1,{absurd}\n")).unwrap_err().contains("line 2: `worker` holds"), "{absurd}");
        }
    }
}
