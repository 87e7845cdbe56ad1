//! The figures of players, as JSON for programs.

use serde_json::{Map, Value, json};

use super::{Evaluation, Finding, RETURN, figures};
use dials_core::base::AgentId;
use dials_core::base::statistics::{Interval, median};
use dials_core::domain::Domain;

/// Returns all figures of one player.
pub fn of_one(domain: &dyn Domain, finding: &Finding) -> Map<String, Value> {
    let evaluation = Evaluation::new(domain, &finding.episodes);
    let all = evaluation.of_all();
    let figures = figures(&finding.episodes);
    let measures = &evaluation.measures;
    let per_agent = (0..evaluation.agents()).map(|agent| {
        let of_agent = evaluation.of_agent(agent);
        let mut object = Map::new();
        object.insert("name".into(), json!(domain.agent_name(AgentId(agent))));
        object.insert(RETURN.into(), json!(of_agent.mean));
        object.insert("mean_return".into(), json!(of_agent.mean));
        object.insert("median_return".into(), json!(of_agent.median));
        object.insert("std_error".into(), json!(of_agent.std_error));
        object.insert("half_width_95".into(), json!(finding.of_agent(agent).half_width));
        object.insert("stuck".into(), json!(evaluation.stuck[agent]));
        object.extend(measures.per_agent.iter().map(|(name, values)| (name.clone(), json!(values[agent]))));
        Value::Object(object)
    });
    let mut object: Map<String, Value> =
        finding.player.keys.iter().map(|(key, value)| ((*key).to_owned(), value.clone())).collect();
    object.insert(RETURN.into(), json!(all.mean));
    object.insert("mean_return".into(), json!(all.mean));
    object.insert("median_return".into(), json!(all.median));
    object.insert("std_error".into(), json!(all.std_error));
    object.insert("episodes".into(), json!(evaluation.episodes()));
    object.insert("episode_returns".into(), json!(figures[0].1));
    object.insert("agents".into(), json!(evaluation.agents()));
    object.insert("stuck_agents".into(), json!(evaluation.stuck.iter().filter(|&&stuck| stuck).count()));
    object.extend(measures.system.iter().map(|(name, value)| (name.clone(), json!(value))));
    let half_widths = figures.iter().map(|(name, values)| (name.clone(), json!(Interval::of(values).half_width)));
    object.insert("half_width_95".into(), Value::Object(half_widths.collect()));
    let medians = figures.iter().map(|(name, values)| (name.clone(), json!(median(values))));
    object.insert("episode_median".into(), Value::Object(medians.collect()));
    object.insert("per_agent".into(), per_agent.collect());
    object
}

/// Returns all figures of several players, and their differences from the first player.
pub fn of_all(domain: &dyn Domain, findings: &[Finding]) -> Map<String, Value> {
    let reference = figures(&findings[0].episodes);
    let differences = findings[1..].iter().map(|finding| {
        let mut object = Map::new();
        object.insert("of".into(), json!(finding.player.label));
        object.insert("less".into(), json!(findings[0].player.label));
        for ((name, values), (_, reference)) in figures(&finding.episodes).iter().zip(&reference) {
            object.insert(name.clone(), json!(Interval::of_differences(values, reference)));
        }
        Value::Object(object)
    });
    let mut object = Map::new();
    object.insert("differences".into(), differences.collect());
    object
        .insert("controllers".into(), findings.iter().map(|finding| Value::Object(of_one(domain, finding))).collect());
    object
}
