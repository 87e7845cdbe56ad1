//! A network as JSON for programs.

use serde_json::{Value, json};

use super::Inspected;
use dials_traffic::agents::derive::Agent;
use dials_traffic::agents::phase_plan::{Interval, PhasePlan};
use dials_traffic::agents::plan::Border;
use dials_traffic::agents::region_plan::RegionPlan;

/// Returns the whole object. Indices (`links` of an approach, `from`, `to`) count the other lists of the same light.
pub(super) fn described(inspected: &Inspected) -> Value {
    let Inspected { net, derived, padding, rules, left_out, .. } = inspected;
    let agents = derived.agents.iter().zip(&inspected.borders).map(|(agent, border)| light(inspected, agent, border));
    let keeping = derived
        .keeping
        .iter()
        .map(|kept| json!({ "light": kept.light, "why": kept.why.to_string(), "way_out": kept.why.way_out() }));
    json!({
        "net": net.display().to_string(),
        "approach_m": rules.approach_m,
        "yellow_s": rules.yellow,
        "min_green_s": rules.min_green_s,
        "kind": { "columns": padding.columns, "actions": padding.actions, "padded_share": padding.padded },
        "influence": { "d_set_columns": inspected.influence.columns, "sources": inspected.influence.sources },
        "left_out": left_out,
        "learning": agents.collect::<Vec<_>>(),
        "keeping": keeping.collect::<Vec<_>>(),
    })
}

fn light(inspected: &Inspected, Agent { plan, region, .. }: &Agent, border: &Border) -> Value {
    let roads = &inspected.roads;
    let ids = |junctions: &mut dyn Iterator<Item = _>| -> Vec<&str> {
        junctions.map(|&junction| roads.junction(junction).id.as_str()).collect()
    };
    let RegionPlan { approaches, exits, links } = &plan.region;
    json!({
        "light": plan.light,
        "place_m": plan.place_m,
        "junctions": ids(&mut region.own.iter()),
        "uncontrolled_junctions": ids(&mut region.passed.iter()),
        "greens": plan.phases.greens().iter().map(|green| green.as_str()).collect::<Vec<_>>(),
        "changes": changes(&plan.phases),
        "approaches": approaches.iter().map(|approach| json!({
            "lane": approach.lane,
            "length_m": approach.length_m,
            "ahead_m": approach.ahead_m,
            "speed_limit_mps": approach.speed_limit_mps,
            "links": approach.links,
        })).collect::<Vec<_>>(),
        "exits": exits.iter().map(|exit| json!({
            "lane": exit.lane,
            "length_m": exit.length_m,
            "leaves_the_net": exit.leaves_the_net,
        })).collect::<Vec<_>>(),
        "links": links.iter().map(|link| json!({
            "letter": link.letter,
            "from": link.from,
            "to": link.to,
        })).collect::<Vec<_>>(),
        "columns": plan.sensor.columns(&plan.region),
        "sources": border.plan.source_names(),
        "d_set_columns": border.d_set.columns(&border.plan),
    })
}

/// Returns what is shown between every two greens.
fn changes(phases: &PhasePlan) -> Vec<Value> {
    let greens = 0..phases.greens().len();
    let pairs = greens.clone().flat_map(|from| greens.clone().map(move |to| (from, to)));
    let pairs = pairs.filter(|(from, to)| from != to);
    let shown = |interval: &Interval| json!({ "state": interval.state.as_str(), "seconds": interval.steps });
    pairs
        .map(|(from, to)| {
            let states: Vec<Value> = phases.clearing(from, to).iter().map(shown).collect();
            json!({ "from": from, "to": to, "states": states })
        })
        .collect()
}
