//! `describe`: what a config is about, before anything is simulated.
//!
//! `text`: for people. The JSON for programs is here.

mod text;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Value, json};

use super::train::{cores, settings_with};
use crate::cli;
use dials_core::base::AgentId;
use dials_core::domain::{Domain, Task};
use dials_core::outside::{FileName, path_as_text};
use dials_session::config::{RunConfig, load};
use dials_session::cost::Workload;
use dials_session::error::{Error, Result};
use dials_session::experiment::estimate::{Estimate, Source, estimate};
use dials_session::experiment::file::PlannedRun;
use dials_session::records::find::find;
use dials_session::records::run_record::RunRecord;
use dials_session::terminal::{answer, json as in_json};
use dials_session::{build, domains};

/// Folder whose runs show how long a run takes here: where `train` writes.
const RUNS: &str = "runs";

/// Everything that is shown of a config.
struct Described {
    path: PathBuf,
    config: RunConfig,
    domain: Arc<dyn Domain>,
    tasks: Vec<AgentTask>,
    work: Workload,
    workers: usize,
    estimate: Estimate,
}

/// An agent with its name and its task.
struct AgentTask {
    agent: AgentId,
    name: String,
    task: Task,
}

pub(super) fn describe(args: &cli::DescribeArgs) -> Result<()> {
    let described = Described::of(args).map_err(Error::Usage)?;
    let found = match args.json {
        true => in_json(as_json(&described)),
        false => text::described(&described),
    };
    answer(found).map_err(Error::Run)
}

impl Described {
    fn of(args: &cli::DescribeArgs) -> anyhow::Result<Described> {
        let config = load(&args.config, &settings_with(&args.settings, args.simulator.as_deref()))?;
        let domain = domains::find(&config)?;
        let tasks = AgentId::all(domain.agents()).into_iter().map(|agent| AgentTask {
            agent,
            name: domain.agent_name(agent),
            task: domain.task(agent),
        });
        let tasks = tasks.collect();
        let run = PlannedRun {
            name: FileName::new("run")?,
            config_path: args.config.clone(),
            settings: Vec::new(),
            config: config.clone(),
            scenario: domain.scenario()?,
            rough_costs: domain.rough_costs(),
        };
        let workers = args.workers.unwrap_or_else(cores);
        let estimate = estimate(&run, workers, &runs_of_this_cpu(Path::new(RUNS)));
        let work = Workload::of(&config, domain.agents(), config.learning.last_step());
        Ok(Described { path: args.config.clone(), config, domain, tasks, work, workers, estimate })
    }
}

/// Returns the runs in a folder that a CPU of this name has computed.
fn runs_of_this_cpu(folder: &Path) -> Vec<RunRecord> {
    // A folder without runs is no reason to fail: they only make the estimate better.
    let Ok(found) = find(&[folder.to_owned()]) else { return Vec::new() };
    let here = build::cpu();
    found.runs.into_iter().filter(|run| run.about.versions.cpu == here).collect()
}

/// Returns the whole object.
fn as_json(described: &Described) -> Value {
    let Described { path, config, domain, tasks, work, workers, estimate } = described;
    let agents = tasks.iter().map(|agent| json!({ "agent": agent.agent.0, "name": agent.name, "task": agent.task }));
    let kinds = domain.kinds().specs().map(|spec| {
        json!({
            "observation_columns": spec.obs_dim,
            "actions": spec.n_actions,
            "sources": spec.sources.count(),
            "d_set_columns": spec.d_set_dim,
        })
    });
    json!({
        "config": path_as_text(path),
        "simulator": config.learning.short_form().name,
        "episode_steps": domain.kinds().horizon(),
        "not_simulated": domain.left_out(),
        "kinds": kinds.collect::<Vec<_>>(),
        "agents": agents.collect::<Vec<_>>(),
        "run": {
            "steps_per_agent": work.steps,
            "evaluations": work.evaluations + 1,
            "evaluation_episodes": work.evaluation_episodes,
            "final_episodes": work.final_episodes,
            "aip_trainings": work.retrainings,
            "dataset_episodes": work.dataset_episodes,
            "aip_epochs": work.epochs,
        },
        "cost": {
            "workers": workers,
            "seconds": estimate.seconds,
            "memory_mib": estimate.memory_mb,
            "measured_runs": match estimate.source {
                Source::Measured(runs) => runs,
                Source::Constants => 0,
            },
        },
    })
}
