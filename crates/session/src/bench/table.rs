//! The costs of a run, one column per fleet, for people; and the same as JSON.

use serde_json::{Map, Value, json};

use super::costs::{Cost, Costs, SimulatorCosts, StepCost};
use dials_core::base::Phase;

const UNIT: &str = "core-microseconds per agent and step of the simulator";
const LABEL: usize = 30;
const COLUMN: usize = 12;

type Part = (&'static str, fn(&Costs) -> Cost);
const ACTIVITIES: [Part; 4] = [
    ("training", |costs| costs.training),
    ("evaluation", |costs| costs.evaluation),
    ("collection", |costs| costs.collection),
    ("AIP training", |costs| costs.aip_training),
];

pub fn text(costs: &[Costs]) -> String {
    let line = |label: &str, value: &dyn Fn(&Costs) -> String| {
        let values = costs.iter().map(|costs| format!(" {:>COLUMN$}", value(costs)));
        format!("{label:<LABEL$}{}", values.collect::<String>())
    };
    let us = |label: &str, value: &dyn Fn(&Costs) -> f64| line(label, &|costs| format!("{:.2}", value(costs)));
    let percent = |part: f64, costs: &Costs| format!("{:.0} %", 100.0 * part / costs.all().ours);
    let is_used = |value: &dyn Fn(&Costs) -> f64| costs.iter().any(|costs| value(costs) > 0.0);
    let mut lines = vec![
        line("workers", &|costs| costs.workers.to_string()),
        line("agent-steps/s", &|costs| grouped(costs.agent_steps_per_s())),
        line("agent-steps/s and core", &|costs| grouped(costs.agent_steps_per_s() / costs.workers as f64)),
        line("inside the simulators' steps", &|costs| percent(costs.all().phase(Phase::SimulatorStep), costs)),
        line("in forward and backward passes", &|costs| percent(passes(costs), costs)),
        line("memory of all processes", &|costs| format!("{:.0} MiB", mebibytes(costs.pss_kib))),
        "\ncore-microseconds per agent-step".to_owned(),
    ];
    for phase in Phase::ALL.into_iter().filter(|&phase| is_used(&|costs| costs.training.phase(phase))) {
        lines.push(us(&format!("  {}", words(phase)), &|costs| costs.training.phase(phase)));
    }
    lines.push(us("  other", &|costs| costs.other));
    lines.push(us("  waiting for the slowest", &|costs| costs.idle));
    let activities = ACTIVITIES.into_iter().filter(|(_, cost)| is_used(&|costs| cost(costs).ours));
    lines.extend(activities.clone().map(|(name, cost)| us(name, &|costs| cost(costs).ours)));
    lines.push(us("messages and files", &|costs| costs.exchange));
    lines.push(us("all", &|costs| costs.all().ours));
    lines.push("\nfloor: SUMO's own step + products at peak, and the cost as a multiple of it".to_owned());
    for (name, cost) in activities.chain([("all", Costs::all as fn(&Costs) -> Cost)]) {
        lines.push(line(name, &|costs| format!("{:.2} x{:.2}", cost(costs).floor(), cost(costs).ratio())));
    }
    if is_used(&|costs| costs.collection.sumo) {
        lines.push(line("collection by SUMO alone", &|costs| {
            format!("{:.2} x{:.2}", costs.collection.sumo, costs.collection.ours / costs.collection.sumo)
        }));
    }
    if costs.iter().any(|costs| costs.gs_steps_per_s.is_some()) {
        lines.push(line("GS steps/s in collection", &|costs| costs.gs_steps_per_s.map_or(String::new(), grouped)));
    }
    lines.push(format!("\n{UNIT}: its own step + the work around it"));
    for (place, (name, _)) in costs[0].simulators.named.iter().enumerate() {
        lines.push(line(name, &|costs| {
            let (_, StepCost { own_us, around_us }) = costs.simulators.named[place];
            format!("{own_us:.1} + {around_us:.1}")
        }));
    }
    lines.push(line("steps of it per timestep", &|costs| costs.simulators.steps_per_timestep.to_string()));
    lines.push(us("learning per agent-step", &|costs| costs.simulators.learning_us));
    lines.join("\n")
}

/// Returns one object per fleet.
pub fn json(costs: &[Costs]) -> Value {
    costs.iter().map(object).collect()
}

fn object(costs: &Costs) -> Value {
    let cost = |cost: Cost| {
        let (floor, ratio) = (cost.floor(), cost.ratio());
        let phases = Phase::ALL.map(|phase| (phase.name().to_owned(), json!(cost.phase(phase))));
        json!({
            "us": cost.ours,
            "phases_us": phases.into_iter().collect::<Map<_, _>>(),
            "sumo_step_us": cost.sumo,
            "products_at_peak_us": cost.products,
            "floor_us": floor,
            "ratio": ratio.is_finite().then_some(ratio),
        })
    };
    let whole = costs.all().ours;
    json!({
        "workers": costs.workers,
        "agent_steps_per_s": costs.agent_steps_per_s(),
        "agent_steps_per_s_per_core": costs.agent_steps_per_s() / costs.workers as f64,
        "gs_steps_per_s_in_collection": costs.gs_steps_per_s,
        "simulators": of_simulators(&costs.simulators),
        "memory_mb": mebibytes(costs.pss_kib),
        "peak_rss_mb_of_a_process": mebibytes(costs.peak_rss_kib),
        "share_in_simulator_steps": costs.all().phase(Phase::SimulatorStep) / whole,
        "share_in_forward_and_backward": passes(costs) / whole,
        "training": cost(costs.training),
        "other_in_training_us": costs.other,
        "idle_in_training_us": costs.idle,
        "evaluation": cost(costs.evaluation),
        "collection": cost(costs.collection),
        "aip_training": cost(costs.aip_training),
        "exchange_us": costs.exchange,
        "all": cost(costs.all()),
    })
}

fn of_simulators(costs: &SimulatorCosts) -> Value {
    let cost = |name: &str| {
        let (_, cost) = costs.named.iter().find(|(other, _)| *other == name)?;
        Some(json!({ "step_us": cost.own_us, "around_us": cost.around_us }))
    };
    json!({
        "unit": UNIT,
        "steps_per_timestep": costs.steps_per_timestep,
        "gs_in_evaluation": cost("GS in evaluation"),
        "gs_in_collection": cost("GS in collection"),
        "gs_in_training": cost("GS in training"),
        "ls_in_training": cost("LS in training"),
        "learning_us_per_agent_step": costs.learning_us,
    })
}

fn passes(costs: &Costs) -> f64 {
    costs.all().phase(Phase::Forward) + costs.all().phase(Phase::Backward)
}

fn words(phase: Phase) -> String {
    match phase {
        Phase::AipSampling => "AIP sampling".to_owned(),
        Phase::Adam => "Adam".to_owned(),
        phase => phase.name().replace('_', " "),
    }
}

fn mebibytes(kib: u64) -> f64 {
    kib as f64 / 1024.0
}

/// Formats a number in groups of three digits: `57 000`.
fn grouped(value: f64) -> String {
    let digits = format!("{value:.0}");
    let groups: Vec<&[u8]> = digits.as_bytes().rchunks(3).rev().collect();
    groups.iter().map(|group| String::from_utf8_lossy(group)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_numbers_are_grouped() {
        assert_eq!([7.4, 999.0, 1000.0, 1_234_567.0].map(grouped), ["7", "999", "1 000", "1 234 567"]);
    }
}
