//! A network as text for people.

use super::Inspected;
use crate::run::listing::Listing;
use dials_core::base::counted;
use dials_traffic::agents::derive::crossings::Walking;
use dials_traffic::agents::derive::keeping::{Keeping, sentences};
use dials_traffic::agents::derive::limits::Because;
use dials_traffic::agents::derive::safety;
use dials_traffic::agents::derive::warnings::walk_s;
use dials_traffic::agents::derive::{Agent, Derived};
use dials_traffic::agents::phase_plan::Interval;
use dials_traffic::agents::plan::{AgentPlan, Border};

pub(super) fn overview(inspected: &Inspected) -> String {
    let mut text = Listing::default();
    lights(&mut text, inspected);
    text.line("");
    summary(&mut text, inspected);
    for (sentence, why) in sentences(&inspected.derived.keeping) {
        text.paragraph(format_args!("{sentence}; way out: {}", why.way_out()));
    }
    text.line("one light in full: --light ID; all of them: --all");
    text.finish()
}

fn lights(text: &mut Listing, Inspected { roads, derived, .. }: &Inspected) {
    let head = ["light", "program", "greens", "columns", "approaches", "in a run"].map(str::to_owned);
    let learning = derived.agents.iter().map(|Agent { plan, program, .. }| {
        let [greens, columns, approaches] =
            [plan.phases.greens().len(), plan.width(), plan.region.approaches.len()].map(|count| count.to_string());
        [plan.light.clone(), program.kind.clone(), greens, columns, approaches, "learns".to_owned()]
    });
    let keeping = derived.keeping.iter().map(|Keeping { light, why }| {
        let kind = roads.programs.iter().rfind(|program| program.light == *light).map(|program| program.kind.clone());
        let none = || "-".to_owned();
        let keeps = format!("keeps its program: {}", why.short());
        [light.clone(), kind.unwrap_or_else(none), none(), none(), none(), keeps]
    });
    text.table([head].into_iter().chain(learning).chain(keeping).collect());
}

pub(super) fn all(inspected: &Inspected) -> String {
    let mut text = Listing::default();
    summary(&mut text, inspected);
    for (number, agent) in inspected.derived.agents.iter().enumerate() {
        text.line("");
        describe(&mut text, inspected, number, agent);
    }
    for kept in &inspected.derived.keeping {
        text.line("");
        describe_keeping(&mut text, kept);
    }
    text.finish()
}

pub(super) fn one(inspected: &Inspected, light: &str) -> Option<String> {
    let Derived { agents, keeping } = &inspected.derived;
    let mut text = Listing::default();
    if let Some(number) = agents.iter().position(|agent| agent.plan.light == light) {
        describe(&mut text, inspected, number, &agents[number]);
    } else {
        describe_keeping(&mut text, keeping.iter().find(|kept| kept.light == light)?);
    }
    Some(text.finish())
}

fn summary(text: &mut Listing, inspected: &Inspected) {
    let Inspected { net, derived, padding, influence, rules, notes, .. } = inspected;
    let (learning, keeping) = (derived.agents.len(), derived.keeping.len());
    let lights = counted(learning + keeping, "light");
    text.line(format_args!("{}: {lights}; {learning} learn, {keeping} keep their program", net.display()));
    text.line(format_args!(
        "an agent sees {} m before its stop lines\nyellow: {}; green: {} s at least",
        rules.approach_m, rules.yellow, rules.min_green_s
    ));
    let bound = |binds: fn(&Because) -> bool| {
        derived.agents.iter().filter(|agent| agent.shortest.iter().any(|shortest| binds(&shortest.because))).count()
    };
    for (count, why) in [
        (bound(|because| *because == Because::Program), "as their programs say (minDur)"),
        (bound(|because| matches!(because, Because::Crossing(_))), "so that people on foot get across"),
        (bound(|because| *because == Because::Overrides), "as agents.toml says"),
    ] {
        if count > 0 {
            text.line(format_args!("another shortest green at {}, {why}", counted(count, "light")));
        }
    }
    let crossings: usize = derived.agents.iter().map(|agent| agent.crossings.len()).sum();
    if let Some(Walking { speed_mps, walk_s }) = rules.walking.filter(|_| crossings > 0) {
        text.line(format_args!(
            "{} with a signal: a green lasts {walk_s} s and the length of its longest one at {speed_mps} m/s",
            counted(crossings, "crossing")
        ));
    }
    text.line(format_args!(
        "all agents are of one kind: {} columns ({:.0} % of them padding), {} actions",
        padding.columns,
        100.0 * padding.padded,
        padding.actions
    ));
    text.line(format_args!(
        "an influence predictor sees {} columns (the d-set) and predicts {} sources",
        influence.columns, influence.sources
    ));
    let states: usize = derived.agents.iter().map(|agent| safety::states(&agent.plan.phases).count()).sum();
    text.paragraph(format_args!(
        "{states} states checked: where links cross, at most one has G, but for those to which the light's own program \
         gives it together"
    ));
    inspected.warnings().iter().for_each(|what| text.paragraph(format_args!("warning: {what}")));
    notes.left_out.iter().for_each(|what| text.paragraph(format_args!("not simulated: {what}")));
    notes.without_locally.iter().for_each(|what| text.paragraph(format_args!("local simulators: {what}")));
    notes.not_local.iter().for_each(|why| text.paragraph(format_args!("no local simulators: {why}")));
}

fn describe_keeping(text: &mut Listing, Keeping { light, why }: &Keeping) {
    text.line(format_args!("light {light}: keeps its program\n  why: {why}\n  way out: {}", why.way_out()));
}

fn describe(text: &mut Listing, inspected: &Inspected, number: usize, agent: &Agent) {
    let Agent { plan, region, .. } = agent;
    let [x, y] = plan.place_m;
    text.line(format_args!("light {}: learns, agent {number}", plan.light));
    text.line(format_args!("  place: {x:.1}, {y:.1}"));
    let ids = |junctions: &mut dyn Iterator<Item = _>| {
        let ids: Vec<&str> = junctions.map(|&junction| inspected.roads.junction(junction).id.as_str()).collect();
        if ids.is_empty() { "none".to_owned() } else { ids.join(", ") }
    };
    text.line(format_args!("  junctions under the light: {}", ids(&mut region.own.iter())));
    text.line(format_args!("  uncontrolled junctions on the way to it: {}", ids(&mut region.passed.iter())));
    describe_phases(text, agent);
    describe_crossings(text, agent);
    describe_lanes(text, plan);
    let Border { plan: border, d_set } = &inspected.borders[number];
    for (what, names) in [
        ("observation column", plan.columns()),
        ("influence source", border.source_names()),
        ("d-set column", d_set.columns(border)),
    ] {
        text.line(format_args!("  {}:", counted(names.len(), what)));
        text.columns(&names);
    }
}

fn describe_phases(text: &mut Listing, Agent { plan, shortest, .. }: &Agent) {
    let phases = &*plan.phases;
    text.line(format_args!("  {}, and what is shown before another one:", counted(phases.greens().len(), "green")));
    for (from, green) in phases.greens().iter().enumerate() {
        let least = &shortest[from];
        let because = if least.because == Because::Config { String::new() } else { format!(" ({})", least.because) };
        let most = phases.max_green_steps()[from].map_or(String::new(), |most| format!(", at most {most} s"));
        text.line(format_args!("    {from}  {green}  at least {} s{because}{most}", least.seconds));
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
            text.line(format_args!("       {states}  before {}", targets.join(", ")));
        }
    }
}

/// Writes the crossings and the longest reds, if there are some.
fn describe_crossings(text: &mut Listing, agent: &Agent) {
    let longest: Vec<(usize, u32)> = agent.plan.phases.max_red_steps().collect();
    for group in longest.chunk_by(|one, other| one.1 == other.1) {
        let letters: Vec<String> = group.iter().map(|(letter, _)| letter.to_string()).collect();
        text.line(format_args!("  red for at most {} s: letters {}", group[0].1, letters.join(" ")));
    }
    if agent.crossings.is_empty() {
        return;
    }
    text.line(format_args!("  {}:", counted(agent.crossings.len(), "crossing")));
    let head = ["crossing", "letter", "length m", "needs s", "program s", "in greens", "binds"].map(str::to_owned);
    let rows = agent.crossings.iter().map(|crossing| {
        let greens = agent.greens_of(crossing);
        let binds = greens.iter().filter(
            |&&green| matches!(&agent.shortest[green].because, Because::Crossing(edge) if *edge == crossing.edge),
        );
        let names = |greens: &mut dyn Iterator<Item = &usize>| {
            let names: Vec<String> = greens.map(usize::to_string).collect();
            if names.is_empty() { "none".to_owned() } else { names.join(" ") }
        };
        [
            crossing.edge.clone(),
            crossing.letter.to_string(),
            format!("{:.1}", crossing.length_m),
            crossing.needed_s.to_string(),
            walk_s(&agent.program, crossing).map_or("-".to_owned(), |seconds| seconds.to_string()),
            names(&mut greens.iter()),
            names(&mut { binds }),
        ]
    });
    text.table([head].into_iter().chain(rows).collect());
}

fn describe_lanes(text: &mut Listing, plan: &AgentPlan) {
    let region = &plan.region;
    let at_stop_line = region.approaches.iter().filter(|approach| approach.ahead_m == 0.0).count();
    text.line(format_args!(
        "  {}, {at_stop_line} of them at the stop line:",
        counted(region.approaches.len(), "approach lane")
    ));
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
    text.table([head].into_iter().chain(rows).collect());
    text.line(format_args!("  {}:", counted(region.links.len(), "link")));
    let head = ["letter", "from", "to"].map(str::to_owned);
    let rows = region.links.iter().map(|link| {
        let [from, to] = [&region.approaches[link.from].lane, &region.exits[link.to].lane];
        [link.letter.to_string(), from.clone(), to.clone()]
    });
    text.table([head].into_iter().chain(rows).collect());
    text.line(format_args!("  {}:", counted(region.exits.len(), "exit lane")));
    let rows = region.exits.iter().map(|exit| {
        let leads = if exit.leaves_the_net { "leaves the net" } else { "leads to a light" };
        [exit.lane.clone(), format!("{:.1} m", exit.length_m), leads.to_owned()]
    });
    text.table(rows.collect());
}
