//! A config as text for people.

use super::{AgentTask, Described};
use crate::program::command_for_feature;
use crate::run::listing::Listing;
use dials_core::base::counted;
use dials_core::domain::RegionSpec;
use dials_core::outside::quoted;
use dials_learn::algorithms;
use dials_learn::config::Simulator;
use dials_report::words::duration;
use dials_session::experiment::estimate::Source;
use dials_session::terminal::program;

/// Largest number of agents whose names are listed.
const MOST_NAMES: usize = 12;

/// Returns the whole text.
pub(super) fn described(described: &Described) -> String {
    let mut text = Listing::default();
    agents(&mut text, described);
    task(&mut text, described);
    run(&mut text, described);
    cost(&mut text, described);
    text.finish()
}

fn agents(text: &mut Listing, Described { path, config, domain, tasks, .. }: &Described) {
    let horizon = domain.kinds().horizon();
    let count = counted(tasks.len(), "agent");
    text.paragraph(format_args!("{}: {count}, episodes of {horizon} steps", path.display()));
    let form = config.learning.short_form();
    text.paragraph(format_args!("simulator: {}: policies train on {}", form.name, form.help));
    let mut names: Vec<String> = tasks.iter().map(|agent| agent.name.clone()).take(MOST_NAMES).collect();
    if tasks.len() > MOST_NAMES {
        names.push(format!("and {} more", tasks.len() - MOST_NAMES));
    }
    text.paragraph(format_args!("agents: {}", names.join(", ")));
    for what in domain.left_out() {
        text.paragraph(format_args!("note: {what}"));
    }
}

/// Writes what agents see, do and are paid for. If they differ, the first one stands for all.
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

/// Returns the widths of an agent's task.
fn shape(AgentTask { task, .. }: &AgentTask) -> [usize; 4] {
    [task.observation.len(), task.actions.len(), task.sources.len(), task.d_set.len()]
}

fn run(text: &mut Listing, Described { config, work, .. }: &Described) {
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
        let episodes = counted(work.dataset_episodes, "episode");
        text.paragraph(format_args!(
            "  {trainings} of the predictors, each on {episodes} of the global simulator, {epochs}"
        ));
    }
    text.line("  the policies are left in policies.safetensors");
    match cfg!(feature = "torch") {
        true => text.line("  `export` makes a TorchScript module of it"),
        false => {
            let build = command_for_feature("torch");
            text.line(format_args!("  a TorchScript module of it needs a build with libtorch:\n    {build}"));
        }
    }
}

fn cost(text: &mut Listing, Described { path, workers, estimate, .. }: &Described) {
    let (time, workers) = (duration(estimate.seconds), counted(*workers, "worker"));
    text.line(format_args!("\nabout {time} and {:.0} MiB with {workers}", estimate.memory_mb));
    let source = match estimate.source {
        Source::Measured(runs) => format!("from {} of this machine in runs/", counted(runs, "run")),
        Source::Constants => "rough: from runs on two cores of another machine".to_owned(),
    };
    text.paragraph(format_args!("{source}; to measure it here:"));
    text.line(format_args!("  {} bench {}", program(), quoted(path)));
}
