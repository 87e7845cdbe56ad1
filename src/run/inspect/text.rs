//! A network as text for people: its lights in full.

use super::Inspected;
use crate::run::listing::{aligned, line, list_columns, paragraph};
use dials_core::base::counted;
use dials_traffic::agents::derive::keeping::Keeping;
use dials_traffic::agents::derive::safety;
use dials_traffic::agents::derive::{Agent, Derived};
use dials_traffic::agents::phase_plan::{Interval, PhasePlan};
use dials_traffic::agents::plan::{AgentPlan, Border};

/// Returns what is said of the whole, and all lights.
pub(super) fn all(inspected: &Inspected) -> String {
    let mut text = String::new();
    summary(&mut text, inspected);
    for (number, agent) in inspected.derived.agents.iter().enumerate() {
        text.push('\n');
        describe(&mut text, inspected, number, agent);
    }
    for kept in &inspected.derived.keeping {
        text.push('\n');
        describe_keeping(&mut text, kept);
    }
    text
}

/// Returns what is said of one light. `None`: there is no such light.
pub(super) fn one(inspected: &Inspected, light: &str) -> Option<String> {
    let Derived { agents, keeping } = &inspected.derived;
    let mut text = String::new();
    if let Some(number) = agents.iter().position(|agent| agent.plan.light == light) {
        describe(&mut text, inspected, number, &agents[number]);
    } else {
        describe_keeping(&mut text, keeping.iter().find(|kept| kept.light == light)?);
    }
    Some(text)
}

/// Writes what is said of the whole.
pub(super) fn summary(text: &mut String, inspected: &Inspected) {
    let Inspected { net, derived, padding, influence, rules, left_out, .. } = inspected;
    let (learning, keeping) = (derived.agents.len(), derived.keeping.len());
    let lights = counted(learning + keeping, "light");
    line(text, format_args!("{}: {lights}; {learning} learn, {keeping} keep their program", net.display()));
    line(
        text,
        format_args!(
            "an agent sees {} m before its stop lines\nyellow: {}; green: {} s at least",
            rules.approach_m, rules.yellow, rules.min_green_s
        ),
    );
    line(
        text,
        format_args!(
            "all agents are of one kind: {} columns ({:.0} % of them padding), {} actions",
            padding.columns,
            100.0 * padding.padded,
            padding.actions
        ),
    );
    line(
        text,
        format_args!(
            "an influence predictor sees {} columns (the d-set) and predicts {} sources",
            influence.columns, influence.sources
        ),
    );
    let states: usize = derived.agents.iter().map(|agent| safety::states(&agent.plan.phases).count()).sum();
    paragraph(
        text,
        format_args!(
            "{states} states checked: where links cross, at most one has G, but for those to which the light's own program gives \
             it together"
        ),
    );
    left_out.iter().for_each(|what| paragraph(text, format_args!("not simulated: {what}")));
}

fn describe_keeping(text: &mut String, Keeping { light, why }: &Keeping) {
    line(text, format_args!("light {light}: keeps its program\n  why: {why}\n  way out: {}", why.way_out()));
}

fn describe(text: &mut String, inspected: &Inspected, number: usize, agent: &Agent) {
    let Agent { plan, region, .. } = agent;
    let [x, y] = plan.place_m;
    line(text, format_args!("light {}: learns, agent {number}", plan.light));
    line(text, format_args!("  place: {x:.1}, {y:.1}"));
    let ids = |junctions: &mut dyn Iterator<Item = _>| {
        let ids: Vec<&str> = junctions.map(|&junction| inspected.roads.junction(junction).id.as_str()).collect();
        if ids.is_empty() { "none".to_owned() } else { ids.join(", ") }
    };
    line(text, format_args!("  junctions under the light: {}", ids(&mut region.own.iter())));
    line(text, format_args!("  uncontrolled junctions on the way to it: {}", ids(&mut region.passed.iter())));
    describe_phases(text, &plan.phases);
    describe_lanes(text, plan);
    describe_columns(text, "observation column", &plan.sensor.columns(&plan.region));
    let Border { plan: border, d_set } = &inspected.borders[number];
    describe_columns(text, "influence source", &border.source_names());
    describe_columns(text, "d-set column", &d_set.columns(border));
}

fn describe_phases(text: &mut String, phases: &PhasePlan) {
    line(text, format_args!("  {}, and what is shown before another one:", counted(phases.greens().len(), "green")));
    for (from, green) in phases.greens().iter().enumerate() {
        line(text, format_args!("    {from}  {green}"));
        // Often the way to several greens is the same.
        let mut ways: Vec<(&[Interval], Vec<String>)> = Vec::new();
        for to in (0..phases.greens().len()).filter(|&to| to != from) {
            let clearing = phases.clearing(from, to);
            match ways.iter_mut().find(|(known, _)| *known == clearing) {
                Some((_, targets)) => targets.push(to.to_string()),
                None => ways.push((clearing, vec![to.to_string()])),
            }
        }
        for (clearing, targets) in ways {
            let states: Vec<String> =
                clearing.iter().map(|Interval { state, steps }| format!("{state} {steps} s")).collect();
            let states = if states.is_empty() { "nothing to clear".to_owned() } else { states.join(", ") };
            line(text, format_args!("       {states}  before {}", targets.join(", ")));
        }
    }
}

fn describe_lanes(text: &mut String, plan: &AgentPlan) {
    let region = &plan.region;
    let at_stop_line = region.approaches.iter().filter(|approach| approach.ahead_m == 0.0).count();
    line(
        text,
        format_args!(
            "  {}, {at_stop_line} of them at the stop line:",
            counted(region.approaches.len(), "approach lane")
        ),
    );
    let head = ["lane", "length m", "to the stop line m", "limit m/s", "letters"].map(str::to_owned);
    let rows = region.approaches.iter().map(|approach| {
        let mut letters: Vec<usize> = approach.links.iter().map(|&link| region.links[link].letter).collect();
        letters.sort_unstable();
        letters.dedup();
        let letters: Vec<String> = letters.iter().map(usize::to_string).collect();
        [
            approach.lane.clone(),
            format!("{:.1}", approach.length_m),
            format!("{:.1}", approach.ahead_m),
            format!("{:.1}", approach.speed_limit_mps),
            letters.join(" "),
        ]
    });
    aligned(text, [head].into_iter().chain(rows).collect());
    line(text, format_args!("  {}:", counted(region.links.len(), "link")));
    let head = ["letter", "from", "to"].map(str::to_owned);
    let rows = region.links.iter().map(|link| {
        let [from, to] = [&region.approaches[link.from].lane, &region.exits[link.to].lane];
        [link.letter.to_string(), from.clone(), to.clone()]
    });
    aligned(text, [head].into_iter().chain(rows).collect());
    line(text, format_args!("  {}:", counted(region.exits.len(), "exit lane")));
    let rows = region.exits.iter().map(|exit| {
        let leads = if exit.leaves_the_net { "leaves the net" } else { "leads to another light" };
        [exit.lane.clone(), format!("{:.1} m", exit.length_m), leads.to_owned()]
    });
    aligned(text, rows.collect());
}

fn describe_columns(text: &mut String, what: &str, names: &[String]) {
    line(text, format_args!("  {}:", counted(names.len(), what)));
    list_columns(text, names);
}
