//! A network as text for people: a line for each light, and then the whole.

use super::{Inspected, text};
use crate::run::listing::{aligned, line, paragraph};
use dials_traffic::agents::derive::Agent;
use dials_traffic::agents::derive::keeping::{Keeping, sentences};

/// Returns the whole text.
pub(super) fn described(inspected: &Inspected) -> String {
    let mut text = String::new();
    lights(&mut text, inspected);
    text.push('\n');
    text::summary(&mut text, inspected);
    for (sentence, why) in sentences(&inspected.derived.keeping) {
        paragraph(&mut text, format_args!("{sentence}; way out: {}", why.way_out()));
    }
    line(&mut text, "one light in full: --light ID; all of them: --all");
    text
}

fn lights(text: &mut String, Inspected { roads, derived, .. }: &Inspected) {
    let head = ["light", "program", "greens", "columns", "approaches", "in a run"].map(str::to_owned);
    let learning = derived.agents.iter().map(|Agent { plan, program, .. }| {
        let [greens, columns, approaches] =
            [plan.phases.greens().len(), plan.sensor.width(), plan.region.approaches.len()]
                .map(|count| count.to_string());
        [plan.light.clone(), program.kind.clone(), greens, columns, approaches, "learns".to_owned()]
    });
    let keeping = derived.keeping.iter().map(|Keeping { light, why }| {
        let kind = roads.programs.iter().rfind(|program| program.light == *light).map(|program| program.kind.clone());
        let none = || "-".to_owned();
        let keeps = format!("keeps its program: {}", why.short());
        [light.clone(), kind.unwrap_or_else(none), none(), none(), none(), keeps]
    });
    aligned(text, [head].into_iter().chain(learning).chain(keeping).collect());
}
