//! `evaluate` and `baseline`: the same episodes, the same figures.

use std::path::Path;

use serde_json::{Map, Value, json};

use super::directory;
use super::domain;
use super::plot::Plots;
use super::progress::EpisodeBar;
use super::render::render;
use super::terminal::answer;
use crate::base::Seed;
use crate::cli;
use crate::config::{Config, load};
use crate::domain::{Controller, Domain, GlobalSimulator};
use crate::error::{Error, Result};
use crate::evaluation::{self, Evaluation};
use crate::plot::About;
use crate::policy::{JointPolicyController, Selection};
use crate::report::scenario::Scenario;
use crate::sumo::Simulation;

pub fn evaluate(args: &cli::Evaluate) -> Result<()> {
    let run = directory::open(&args.run_dir).map_err(Error::Usage)?;
    let selection = if args.greedy { Selection::Greedy } else { Selection::Sampled };
    let mut controller = JointPolicyController::new(run.stack, &run.policies, selection);
    let plots = Plots::asked_for(args.output.plot.as_deref(), &run.config).map_err(Error::Usage)?;
    let domain = plots.as_ref().map_or(&*run.domain, Plots::domain);
    let mut simulator = domain.global_simulator().map_err(Error::Run)?;
    let subject = [("run", json!(args.run_dir)), ("greedy", json!(args.greedy))];
    let evaluation =
        report(domain, &run.config, &mut *simulator, &mut controller, &args.episodes, &args.output, &subject)?;
    let policies = if args.greedy { "greedy policies" } else { "policies" };
    draw(plots.as_ref(), &evaluation, &format!("{} of {}", policies, name(&args.run_dir)), &args.episodes, &run.config)
}

pub fn baseline(args: &cli::Baseline) -> Result<()> {
    let config = load(&args.config, &[]).map_err(Error::Usage)?;
    let domain = domain::open(&config).map_err(Error::Usage)?;
    domain::check(&config).map_err(Error::Usage)?;
    let plots = Plots::asked_for(args.output.plot.as_deref(), &config).map_err(Error::Usage)?;
    let domain = plots.as_ref().map_or(&*domain, Plots::domain);
    let mut baseline = domain.baseline(&args.controller).map_err(Error::Usage)?;
    let (simulator, controller) = (&mut *baseline.simulator, &mut *baseline.controller);
    let subject = [("config", json!(args.config)), ("controller", json!(args.controller))];
    let evaluation = report(domain, &config, simulator, controller, &args.episodes, &args.output, &subject)?;
    let about = format!("controller {} on {}", args.controller, name(&args.config));
    draw(plots.as_ref(), &evaluation, &about, &args.episodes, &config)
}

/// Draws the pictures that were asked for, after the figures were told.
fn draw(
    plots: Option<&Plots>,
    evaluation: &Evaluation,
    subject: &str,
    episodes: &cli::Episodes,
    config: &Config,
) -> Result<()> {
    let Some(plots) = plots else { return Ok(()) };
    let about = About { subject: subject.to_owned(), seed: episodes.seed.unwrap_or(config.seed) };
    plots.draw(evaluation, &about).map_err(Error::Run)
}

/// The last part of a path: what a run or a config is called.
fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

fn report(
    domain: &dyn Domain,
    config: &Config,
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    episodes: &cli::Episodes,
    output: &cli::Output,
    subject: &[(&str, Value)],
) -> Result<Evaluation> {
    let count = episodes.episodes.map_or(config.evaluation.episodes, |count| count as usize);
    let seed = episodes.seed.unwrap_or(config.seed);
    if let Some(dir) = &output.render {
        render(simulator, controller, Seed::new(seed), dir).map_err(Error::Usage)?;
    }
    let bar = EpisodeBar::new(count);
    let evaluation =
        evaluation::evaluate(domain, simulator, controller, Seed::new(seed), count, &mut |share| bar.set(share))
            .map_err(Error::Run)?;
    bar.finish();
    let scenario = Scenario::of(config, domain.agents()).map_err(Error::Run)?.id();
    let found = match output.json {
        true => to_json(&evaluation, seed, &scenario, subject).map_err(Error::Run)?.to_string(),
        false => table(&evaluation),
    };
    answer(found).map_err(Error::Run)?;
    Ok(evaluation)
}

fn to_json(evaluation: &Evaluation, seed: u64, scenario: &str, subject: &[(&str, Value)]) -> anyhow::Result<Value> {
    let all = evaluation.of_all();
    let mut object = Map::new();
    object.extend(subject.iter().map(|(key, value)| ((*key).to_owned(), value.clone())));
    let measures = &evaluation.measures;
    let per_agent = (0..evaluation.agents()).map(|agent| {
        let of_agent = evaluation.of_agent(agent);
        let mut object = Map::new();
        object.insert("mean_return".into(), json!(of_agent.mean));
        object.insert("median_return".into(), json!(of_agent.median));
        object.insert("std_error".into(), json!(of_agent.std_error));
        object.insert("stuck".into(), json!(evaluation.stuck[agent]));
        object.extend(measures.per_agent.iter().map(|(name, values)| (name.clone(), json!(values[agent]))));
        Value::Object(object)
    });
    object.insert("mean_return".into(), json!(all.mean));
    object.insert("median_return".into(), json!(all.median));
    object.insert("std_error".into(), json!(all.std_error));
    object.insert("episodes".into(), json!(evaluation.episodes()));
    object.insert("agents".into(), json!(evaluation.agents()));
    object.insert("stuck_agents".into(), json!(evaluation.stuck.iter().filter(|&&stuck| stuck).count()));
    object.insert("seed".into(), json!(seed));
    object.insert("scenario".into(), json!(scenario));
    object.insert("sumo_version".into(), json!(Simulation::version()?));
    object.extend(measures.system.iter().map(|(name, value)| (name.clone(), json!(value))));
    object.insert("per_agent".into(), per_agent.collect());
    Ok(Value::Object(object))
}

fn table(evaluation: &Evaluation) -> String {
    let all = evaluation.of_all();
    let mut lines = vec![format!(
        "return {:.1} +- {:.1} (mean and standard error over {} episodes), median of the agents {:.1}",
        all.mean,
        all.std_error,
        evaluation.episodes(),
        all.median
    )];
    lines.extend(evaluation.measures.system.iter().map(|(name, value)| format!("{name:>24} {value:.2}")));
    lines.push(String::new());
    let names: String = evaluation.measures.per_agent.iter().map(|(name, _)| format!(" {name}")).collect();
    lines.push(format!("{:>5} {:>8} {:>8} {:>9}{names} stuck", "agent", "mean", "median", "std_error"));
    for agent in 0..evaluation.agents() {
        let of_agent = evaluation.of_agent(agent);
        let measures = evaluation.measures.per_agent.iter();
        let measures: String =
            measures.map(|(name, values)| format!(" {:>width$.3}", values[agent], width = name.len())).collect();
        lines.push(format!(
            "{agent:>5} {:>8.1} {:>8.1} {:>9.2}{measures} {:>5}",
            of_agent.mean,
            of_agent.median,
            of_agent.std_error,
            if evaluation.stuck[agent] { "yes" } else { "no" }
        ));
    }
    lines.join("\n")
}
