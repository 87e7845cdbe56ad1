//! Whether the state of agents is one that training under a config leads to. Checked before anything is restored from a
//! file, because training relies on it: it indexes by these actions, and replays these trails.
//!
//! Almost everything about a state follows from the number of timesteps: where every episode stands, and how many
//! gradient steps there were. So all sizes are those that the config gives.

use anyhow::{Context, ensure};

use super::ials::head_start;
use super::standing::Standing;
use super::state::AgentsState;
use super::stream::{AgentStream, RowStream};
use crate::base::{AgentId, Dice, Ragged, is_stuck};
use crate::config::{Config, Simulator, schedule};
use crate::domain::{Kinds, RegionSpec, Result};
use crate::influence;
use crate::policy::PolicyStack;

/// Longest wall time of a run that is believed, in seconds: three hundred years.
const LONGEST_S: f64 = 1e10;

/// Number of parameters of every agent's policy and influence predictor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Widths {
    pub policies: Vec<usize>,
    pub aips: Vec<usize>,
}

impl Widths {
    pub fn of(config: &Config, kinds: &Kinds) -> Widths {
        let policy = |spec: &RegionSpec| PolicyStack::shape(spec, &config.policy).layout().width();
        let aip = |spec: &RegionSpec| influence::layout(config.predictor(), spec, &config.aip).width();
        // Once for each kind: a layout is a list of names.
        let of_kinds: Vec<[usize; 2]> = kinds.iter().map(|kind| [policy(&kind.spec), aip(&kind.spec)]).collect();
        let of_agents = |which: usize| {
            let agents = AgentId::all(kinds.agents()).into_iter();
            agents.map(|agent| of_kinds[kinds.place(agent).kind][which]).collect()
        };
        Widths { policies: of_agents(0), aips: of_agents(1) }
    }
}

/// Returns an error that says how the standing contradicts the config that it was reached with, or the state.
pub fn check_standing(standing: &Standing, state: &AgentsState, elapsed_s: f64, config: &Config) -> Result<()> {
    let Standing { until, evaluated_at, drift } = *standing;
    ensure!(
        schedule(config).iter().any(|period| period.end == until),
        "it ends a period at step {until}, where its own schedule has none"
    );
    let steps = until.next_multiple_of(config.ppo.memory as u64);
    ensure!(
        state.steps == steps,
        "its period ends at step {until}, so training is at step {steps}, but it is at step {}",
        state.steps
    );
    ensure!(
        evaluated_at.is_none_or(|at| at <= state.steps),
        "its last evaluation is at step {}, after its own step {}",
        evaluated_at.unwrap_or(0),
        state.steps
    );
    ensure!((0.0..=LONGEST_S).contains(&elapsed_s), "it was written after {elapsed_s} seconds, which cannot be");
    let shares = [drift.share_after_training, drift.share_now];
    ensure!(
        shares.into_iter().flatten().all(|share| share >= 0.0 && share.is_finite()),
        "its drift is {drift:?}, but a loss is a positive number"
    );
    ensure!(
        drift.share_after_training.is_none() || config.simulator.trains_predictors(),
        "its drift counts from a training of influence predictors, and this run trains none"
    );
    Ok(())
}

/// Returns an error that names the first agent whose state does not fit, and how.
pub fn check_state(state: &AgentsState, config: &Config, kinds: &Kinds) -> Result<()> {
    let widths = Widths::of(config, kinds);
    let AgentsState { steps, policies, moments, aips, streams } = state;
    check_widths("policies", policies, &widths.policies)?;
    check_widths("first_moments", &moments.first, &widths.policies)?;
    check_widths("second_moments", &moments.second, &widths.policies)?;
    check_widths("aips", aips, &widths.aips)?;
    ensure!(streams.len() == kinds.agents(), "it has {} streams for {} agents", streams.len(), kinds.agents());
    let memory = config.ppo.memory as u64;
    ensure!(steps.is_multiple_of(memory), "its step {steps} is not a multiple of ppo.memory = {memory}");
    let gradient_steps = gradient_steps(*steps, config, kinds);
    ensure!(
        u64::from(moments.steps) == gradient_steps,
        "its optimiser has made {} steps, but {gradient_steps} until step {steps}",
        moments.steps
    );
    for (agent, (stream, spec)) in streams.iter().zip(kinds.specs()).enumerate() {
        check_tables(state, agent).with_context(|| format!("agent {agent}"))?;
        influence::check_values(config.predictor(), spec, aips.row(agent)).with_context(|| format!("agent {agent}"))?;
        check_stream(stream, *steps, config, spec).with_context(|| format!("agent {agent}"))?;
    }
    Ok(())
}

/// Returns how many steps the optimiser of a policy has made after this number of timesteps per agent.
fn gradient_steps(steps: u64, config: &Config, kinds: &Kinds) -> u64 {
    let memory = config.ppo.memory as u64;
    let updates = steps / memory;
    // When the actor joins the critic, the optimiser begins again.
    let of_critic = config.critic_steps().div_ceil(memory);
    let since = if updates > of_critic { updates - of_critic } else { updates };
    // A shared policy learns from the samples of all agents.
    let memories = if config.shares_policies() { kinds.agents() } else { 1 };
    let per_update = config.ppo.epochs * memories * (config.ppo.memory / config.ppo.minibatch);
    since.saturating_mul(per_update as u64)
}

fn check_widths(name: &str, table: &Ragged<f32>, widths: &[usize]) -> Result<()> {
    ensure!(table.len() == widths.len(), "its table `{name}` is of {} agents, not of {}", table.len(), widths.len());
    let wrong = table.widths().zip(widths).position(|(found, &expected)| found != expected);
    wrong.map_or(Ok(()), |agent| {
        let (found, expected) = (table.row(agent).len(), widths[agent]);
        Err(anyhow::anyhow!("its table `{name}` has {found} values of agent {agent}, not {expected}"))
    })
}

fn check_tables(state: &AgentsState, agent: usize) -> Result<()> {
    let tables = [
        ("policies", &state.policies),
        ("first_moments", &state.moments.first),
        ("second_moments", &state.moments.second),
        ("aips", &state.aips),
    ];
    for (name, table) in tables {
        if let Some(bad) = table.row(agent).iter().find(|value| !value.is_finite()) {
            anyhow::bail!("its table `{name}` holds {bad}, which is not a finite number");
        }
    }
    let negative = state.moments.second.row(agent).iter().find(|&&value| value < 0.0);
    negative.map_or(Ok(()), |bad| Err(anyhow::anyhow!("its table `second_moments` holds {bad}, but they are squares")))
}

fn check_stream(stream: &AgentStream, steps: u64, config: &Config, spec: &RegionSpec) -> Result<()> {
    check_dice("minibatches", &stream.minibatches)?;
    let copies = config.copies();
    ensure!(stream.rows.len() == copies, "it has {} copies of its region, not {copies}", stream.rows.len());
    for (copy, row) in stream.rows.iter().enumerate() {
        check_row(row, copy, steps, config, spec).with_context(|| format!("copy {copy} of its region"))?;
    }
    Ok(())
}

fn check_row(row: &RowStream, copy: usize, steps: u64, config: &Config, spec: &RegionSpec) -> Result<()> {
    let (on_gs, copies) = (config.simulator == Simulator::Global, config.copies());
    let RowStream { trail, acting, influence, state, rewards } = row;
    check_dice("actions", acting)?;
    check_dice("influence sources", influence)?;
    let staggered = config.local_simulators.stagger && !on_gs;
    let head_start = if staggered { head_start(copy, copies, spec.horizon) as u64 } else { 0 };
    // Episodes are cut by the horizon alone, so the number of steps says where each one stands.
    let played = steps / copies as u64 + head_start;
    let (episode, of_episode) = (played / spec.horizon as u64, played % spec.horizon as u64);
    let expected = if episode == 0 { of_episode - head_start } else { of_episode };
    ensure!(
        (trail.episode, trail.steps() as u64) == (episode, expected),
        "it is {} steps into episode {}, but at step {steps} of training {expected} steps into episode {episode}",
        trail.steps(),
        trail.episode
    );
    if let Some(bad) = trail.actions.iter().find(|&&action| usize::from(action) >= spec.n_actions) {
        anyhow::bail!("it took action {bad}, but there are {} actions", spec.n_actions);
    }
    let sources = if on_gs { 0 } else { spec.sources.count() };
    ensure!(
        trail.sources.len() == trail.steps() * sources,
        "it has {} values of influence sources in {} steps, not {sources} in each",
        trail.sources.len(),
        trail.steps()
    );
    if sources > 0 {
        let with_classes = trail.sources.iter().zip(spec.sources.classes.iter().cycle());
        if let Some((bad, classes)) = with_classes.into_iter().find(|(value, classes)| value >= classes) {
            anyhow::bail!("an influence source has the value {bad}, but it has {classes} classes");
        }
    }
    let width = PolicyStack::shape(spec, &config.policy).state_width();
    ensure!(state.len() == width, "the hidden state of its policy has {} values, not {width}", state.len());
    ensure!(
        state.iter().all(|value| value.is_finite()) && rewards.is_finite(),
        "the hidden state of its policy or its sum of rewards is not a finite number"
    );
    Ok(())
}

/// Rejects the one state that a generator never leaves and never comes to.
fn check_dice(of: &str, dice: &Dice) -> Result<()> {
    ensure!(!is_stuck(dice), "the dice of its {of} are all zeros, and would show the same number for ever");
    Ok(())
}
