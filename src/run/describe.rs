//! `describe`: what a config is about, before anything is simulated.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Map, Value, json};

use super::train::{cores, settings_with};
use crate::cli;
use crate::run::listing::Listing;
use dials_core::base::{AgentId, counted};
use dials_core::domain::{Domain, RegionSpec, Task};
use dials_core::outside::{FileName, path_as_text, quoted};
use dials_learn::algorithms;
use dials_learn::config::{Predictor, Simulator, short_forms};
use dials_report::words::duration;
use dials_session::config::{RunConfig, load};
use dials_session::cost::Workload;
use dials_session::domains::DomainConfig;
use dials_session::error::{Error, Result};
use dials_session::experiment::estimate::{Estimate, estimate};
use dials_session::experiment::file::PlannedRun;
use dials_session::records::find::find;
use dials_session::records::run_record::RunRecord;
use dials_session::terminal::{answer, json as in_json, program};
use dials_session::{build, domains};
use dials_traffic::config::TrafficTable;

/// Folder whose runs show how long a run takes here: where `train` writes.
const RUNS: &str = "runs";

struct Described {
    path: PathBuf,
    config: RunConfig,
    domain: Arc<dyn Domain>,
    tasks: Vec<AgentTask>,
    work: Workload,
    workers: usize,
    estimate: Estimate,
    /// What the run would take on each simulator.
    simulators: Vec<(&'static str, Estimate)>,
}

struct AgentTask {
    agent: AgentId,
    name: String,
    task: Task,
}

pub(super) fn describe(args: &cli::DescribeArgs) -> Result<()> {
    let described = Described::of(args).map_err(Error::Usage)?;
    let found = match args.json {
        true => in_json(as_json(&described)),
        false => as_text(&described),
    };
    answer(found).map_err(Error::Run)
}

impl Described {
    fn of(args: &cli::DescribeArgs) -> anyhow::Result<Described> {
        let config = load(&args.config, &settings_with(&args.settings.all(), args.simulator.as_deref()))?;
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
        let measured = runs_of_this_cpu(Path::new(RUNS));
        // What a predictor in Python costs, only Python knows.
        let forms = short_forms().into_iter().filter(|form| form.predictor != Some(Predictor::Outside));
        let simulators = forms.map(|form| {
            let mut other = run.clone();
            form.choose(&mut other.config.learning);
            (form.name, estimate(&other, workers, &measured))
        });
        let simulators = simulators.collect();
        let estimate = estimate(&run, workers, &measured);
        let work = Workload::of(&config, domain.agents(), config.learning.last_step());
        Ok(Described { path: args.config.clone(), config, domain, tasks, work, workers, estimate, simulators })
    }
}

/// Returns the runs in a folder that a CPU of this name has computed.
fn runs_of_this_cpu(folder: &Path) -> Vec<RunRecord> {
    // A folder without runs is no reason to fail: they only make the estimate better.
    let Ok(found) = find(&[folder.to_owned()]) else { return Vec::new() };
    let here = build::cpu();
    found.runs.into_iter().filter(|run| run.about.versions.cpu == here).collect()
}

fn as_json(described: &Described) -> Value {
    let Described { path, config, domain, tasks, work, workers, estimate, simulators } = described;
    let of_simulators: Map<String, Value> =
        simulators.iter().map(|(name, estimate)| ((*name).to_owned(), json!(estimate.seconds))).collect();
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
        "warnings": domain.warnings(),
        "not_simulated": domain.left_out(),
        "not_in_local_simulators": domain.without_locally(),
        "kinds": kinds.collect::<Vec<_>>(),
        "agents": agents.collect::<Vec<_>>(),
        "run": {
            "steps_per_agent": work.steps,
            "evaluations": work.evaluations + 1,
            "evaluation_episodes": work.evaluation_episodes,
            "final_episodes": work.final_episodes,
            "aip_trainings": work.retrainings,
            "dataset_episodes": work.dataset_episodes,
            "first_dataset_episodes": work.first_dataset_episodes,
            "aip_epochs": work.epochs,
        },
        "cost": {
            "workers": workers,
            "seconds": estimate.seconds,
            "memory_mib": estimate.memory_mb,
            "measured_runs": estimate.measured_runs,
            "seconds_by_simulator": of_simulators,
        },
    })
}

const MOST_NAMES: usize = 12;

fn as_text(described: &Described) -> String {
    let mut text = Listing::default();
    agents(&mut text, described);
    // The cost comes first: people ask for it before a run, and the columns may fill screens.
    cost(&mut text, described);
    run(&mut text, described);
    task(&mut text, described);
    text.finish()
}

fn agents(text: &mut Listing, Described { path, config, domain, tasks, .. }: &Described) {
    let horizon = domain.kinds().horizon();
    let count = counted(tasks.len(), "agent");
    let of_seconds = match &config.domain {
        Some(DomainConfig::Traffic(TrafficTable::Scenario(table))) if table.decision_s > 1 => {
            let (each, all) = (u64::from(table.decision_s), horizon as u64 * u64::from(table.decision_s));
            format!(" of {each} s ({all} s)")
        }
        _ => String::new(),
    };
    text.paragraph(format_args!("{}: {count}, episodes of {horizon} steps{of_seconds}", path.display()));
    let form = config.learning.short_form();
    text.paragraph(format_args!("simulator: {}: policies train on {}", form.name, form.help));
    let mut names: Vec<String> = tasks.iter().map(|agent| agent.name.clone()).take(MOST_NAMES).collect();
    if tasks.len() > MOST_NAMES {
        names.push(format!("and {} more", tasks.len() - MOST_NAMES));
    }
    text.paragraph(format_args!("agents: {}", names.join(", ")));
    for what in domain.warnings() {
        text.paragraph(format_args!("warning: {what}"));
    }
    for what in domain.left_out() {
        text.paragraph(format_args!("note: {what}"));
    }
    if config.learning.simulator != Simulator::Global {
        for what in domain.without_locally() {
            text.paragraph(format_args!("note: local simulators: {what}"));
        }
    }
}

/// Writes what agents see, do and are rewarded for. If they differ, the first one stands for all.
fn task(text: &mut Listing, Described { domain, tasks, config, .. }: &Described) {
    let [AgentTask { agent, name, task }, others @ ..] = &tasks[..] else { return };
    let differing = others.iter().filter(|other| shape(other) != shape(&tasks[0])).count();
    let RegionSpec { obs_dim, n_actions, d_set_dim, sources, .. } = &domain.kinds().of(*agent).spec;
    text.line("");
    text.paragraph(format_args!("reward of a step: {}", task.reward));
    if differing > 0 {
        let sources = sources.count();
        text.paragraph(format_args!(
            "agents differ in what they see and do: below is {name}; --json has all. Their networks are of one kind, as \
             wide as the widest needs: {obs_dim} columns, {n_actions} actions, {sources} sources, {d_set_dim} columns of \
             the d-set"
        ));
    }
    let mut list = |what: &str, names: &[String]| {
        text.line(format_args!("{}:", counted(names.len(), what)));
        text.columns(names);
    };
    list("observation column", &task.observation);
    list("action", &task.actions);
    if config.learning.simulator != Simulator::Global {
        list("influence source", &task.sources);
        list("d-set column", &task.d_set);
    }
}

fn shape(AgentTask { task, .. }: &AgentTask) -> [usize; 4] {
    [task.observation.len(), task.actions.len(), task.sources.len(), task.d_set.len()]
}

fn run(text: &mut Listing, Described { config, domain, work, .. }: &Described) {
    let steps = work.steps;
    let updates = steps.div_ceil(algorithms::of(&config.learning).steps_per_update() as u64);
    text.line("\na run of `train`:");
    text.line(format_args!("  {steps} steps per agent, {updates} updates of the policies"));
    if let Some(controller) = &config.learning.policy.imitate {
        let imitation = &config.learning.imitation;
        let played = counted(imitation.episodes(work.horizon), "episode");
        let (epochs, until) = (counted(imitation.epochs, "epoch"), imitation.critic_steps);
        text.paragraph(format_args!(
            "  first the policies imitate `{controller}` on {played} of the global simulator, {epochs}; until step {until} \
             only the critic learns"
        ));
    }
    if config.learning.shares_policies() {
        text.line("  all agents of a kind have one policy");
    }
    if let Some(every) = config.learning.policy.average_every_steps {
        text.line(format_args!("  all agents of a kind get the mean of their policies every {every} steps"));
    }
    let evaluations = counted(work.evaluations, "evaluation");
    let [each, last] = [work.evaluation_episodes, work.final_episodes].map(|episodes| counted(episodes, "episode"));
    text.line(format_args!("  {evaluations} of {each} on the way, one of {last} at the end"));
    if work.retrainings > 0 {
        let (trainings, epochs) = (counted(work.retrainings, "training"), counted(work.epochs, "epoch"));
        // A step of SUMO's is a second of the demand.
        let seconds = work.horizon * domain.simulator_steps_per_timestep();
        let demand = |episodes: usize| match domain.foreign_simulator() {
            Some(_) => format!(" ({:.1} hours of demand)", (episodes * seconds) as f64 / 3600.0),
            None => String::new(),
        };
        let (first, later) = (work.first_dataset_episodes, work.dataset_episodes);
        let on_first = format!("on {} of the global simulator{}", counted(first, "episode"), demand(first));
        let on = match work.retrainings {
            1 => on_first,
            _ if first == later => format!("each {on_first}"),
            _ => format!("the first {on_first}, each later one on {later}{}", demand(later)),
        };
        text.paragraph(format_args!("  {trainings} of the predictors, {on}, {epochs}"));
    }
    text.line("  the policies are left in policies.safetensors");
    if let Some(DomainConfig::Traffic(TrafficTable::Scenario(_))) = &config.domain {
        text.line("  `plan` makes fixed times of them, which plain SUMO plays");
    }
}

fn cost(text: &mut Listing, described: &Described) {
    let Described { path, domain, workers, estimate, simulators, .. } = described;
    let (time, workers) = (duration(estimate.seconds), counted(*workers, "worker"));
    text.line(format_args!("\na run takes about {time} and {:.0} MiB with {workers}", estimate.memory_mb));
    let source = match estimate.measured_runs {
        0 => "rough: from runs on two cores of another machine".to_owned(),
        runs => format!("from {} of this machine in runs/", counted(runs, "run")),
    };
    text.paragraph(format_args!("{source}; to measure it here:"));
    text.line(format_args!("  {} bench {}", program(), quoted(path)));
    let each: Vec<String> =
        simulators.iter().map(|(name, estimate)| format!("{name} {}", duration(estimate.seconds))).collect();
    text.paragraph(format_args!("on each simulator: {}", each.join(", ")));
    if let Some(why) = domain.default_simulator() {
        text.paragraph(why);
    }
}
