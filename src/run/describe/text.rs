//! A config as text for people.

use super::{AgentTask, Described};
use crate::features::command_for_feature;
use crate::run::listing::{line, list_columns, paragraph};
use dials_core::base::counted;
use dials_core::domain::RegionSpec;
use dials_core::outside::quoted;
use dials_learn::algorithms;
use dials_learn::config::Simulator;
use dials_report::words::duration;
use dials_session::terminal::program;

/// Largest number of agents whose names are listed.
const MOST_NAMES: usize = 12;

/// Returns the whole text.
pub(super) fn described(described: &Described) -> String {
    let mut text = String::new();
    agents(&mut text, described);
    task(&mut text, described);
    run(&mut text, described);
    cost(&mut text, described);
    text
}

fn agents(text: &mut String, Described { path, config, domain, tasks, .. }: &Described) {
    let horizon = domain.kinds().horizon();
    let count = counted(tasks.len(), "agent");
    paragraph(text, format_args!("{}: {count}, episodes of {horizon} steps", path.display()));
    let form = config.learning.short_form();
    paragraph(text, format_args!("simulator: {}: policies train on {}", form.name, form.help));
    let mut names: Vec<&str> = tasks.iter().map(|agent| agent.name.as_str()).take(MOST_NAMES).collect();
    let more = tasks.len() - names.len();
    let more = format!("and {more} more");
    if tasks.len() > MOST_NAMES {
        names.push(&more);
    }
    paragraph(text, format_args!("agents: {}", names.join(", ")));
    for what in domain.left_out() {
        paragraph(text, format_args!("note: {what}"));
    }
}

/// Writes what agents see, do and are paid for. If they differ, the first one stands for all.
fn task(text: &mut String, Described { domain, tasks, config, .. }: &Described) {
    let [AgentTask { agent, name, task }, others @ ..] = &tasks[..] else { return };
    let differing = others.iter().filter(|other| shape(other) != shape(&tasks[0])).count();
    let RegionSpec { obs_dim, n_actions, d_set_dim, sources, .. } = &domain.kinds().of(*agent).spec;
    text.push('\n');
    paragraph(text, format_args!("reward of a step: {}", task.reward));
    if differing > 0 {
        paragraph(
            text,
            format_args!(
                "agents differ in what they see and do: below is {name}; --json has all. Their networks are of one kind, as \
                 wide as the widest needs: {obs_dim} columns, {n_actions} actions, {} sources, {d_set_dim} columns of \
                 the d-set",
                sources.count()
            ),
        );
    }
    let mut list = |what: &str, names: &[String]| {
        line(text, format_args!("{}:", counted(names.len(), what)));
        list_columns(text, names);
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

fn run(text: &mut String, Described { config, work, .. }: &Described) {
    line(text, "\na run of `train`:");
    line(
        text,
        format_args!(
            "  {} steps per agent, {} updates of the policies",
            work.steps,
            updates(work.steps, algorithms::of(&config.learning).steps_per_update())
        ),
    );
    if let Some(controller) = &config.learning.policy.imitate {
        let imitation = &config.learning.imitation;
        let (played, epochs) = (imitation.episodes(work.horizon), imitation.epochs);
        paragraph(
            text,
            format_args!(
                "  first the policies imitate `{controller}` on {} of the global simulator, {}; until step {} only the \
                 critic learns",
                counted(played, "episode"),
                counted(epochs, "epoch"),
                imitation.critic_steps
            ),
        );
    }
    if config.learning.shares_policies() {
        line(text, "  all agents of a kind have one policy");
    }
    if let Some(every) = config.learning.policy.average_every_steps {
        line(text, format_args!("  all agents of a kind get the mean of their policies every {every} steps"));
    }
    let episodes = [work.evaluation_episodes, work.final_episodes].map(|episodes| counted(episodes, "episode"));
    line(
        text,
        format_args!(
            "  {} of {} on the way, one of {} at the end",
            counted(work.evaluations, "evaluation"),
            episodes[0],
            episodes[1]
        ),
    );
    if work.retrainings > 0 {
        paragraph(
            text,
            format_args!(
                "  {} of the predictors, each on {} of the global simulator, {}",
                counted(work.retrainings, "training"),
                counted(work.dataset_episodes, "episode"),
                counted(work.epochs, "epoch")
            ),
        );
    }
    line(text, "  the policies are left in policies.safetensors");
    line(text, format_args!("  {}", script()));
}

/// Returns what makes a TorchScript module of the policies.
fn script() -> String {
    match cfg!(feature = "torch") {
        true => "`export` makes a TorchScript module of it".to_owned(),
        false => {
            format!("a TorchScript module of it needs a build with libtorch:\n    {}", command_for_feature("torch"))
        }
    }
}

/// Returns the number of updates of a policy.
fn updates(steps: u64, memory: usize) -> u64 {
    steps.div_ceil(memory as u64)
}

fn cost(text: &mut String, Described { path, workers, estimate, .. }: &Described) {
    line(
        text,
        format_args!(
            "\nabout {} and {:.0} MiB with {}",
            duration(estimate.seconds),
            estimate.memory_mb,
            counted(*workers, "worker")
        ),
    );
    let source = match estimate.measured_runs {
        0 => "rough: from runs on two cores of another machine".to_owned(),
        runs => format!("from {} of this machine in runs/", counted(runs, "run")),
    };
    paragraph(text, format_args!("{source}; to measure it here:"));
    line(text, format_args!("  {} bench {}", program(), quoted(path)));
}
