//! The result of a comparison for people, and for programs.

use std::collections::BTreeSet;

use serde_json::{Map, Value, json};

use super::steps::both_in_words;
use super::{ComparedSide, SideResult, Verdict};
use crate::words::{duration, figure_like, interval, pairing, signed, signed_interval};
use dials_core::base::statistics::difference::common_episodes;
use dials_core::base::{counted, for_terminal};
use dials_core::outside::Printable;
use dials_session::records::method::steps_text;

impl Verdict {
    pub fn to_json(&self, a: &ComparedSide, b: &ComparedSide) -> Value {
        let [of_a, of_b] = &self.sides;
        let of_seed = |(seed, value): &(u64, f64)| json!({ "seed": seed, "difference": value });
        let of_key = |(key, values): &(String, [Option<String>; 2])| (key.clone(), json!(values));
        json!({
            "scenario": a.scenario.word(),
            "steps": of_a.steps.min(of_b.steps),
            "a": of_a.to_json(a),
            "b": of_b.to_json(b),
            "difference": self.difference.mean,
            "interval_95": self.difference.interval.map(|interval| [interval.low, interval.high]),
            "paired_by": self.difference.pairing.name(),
            "differences": self.difference.of_seeds.iter().map(of_seed).collect::<Vec<_>>(),
            "runtime_ratio": quotient([of_a.runtime_s, of_b.runtime_s]),
            "cpu_ratio": quotient([of_a.cpu_s, of_b.cpu_s]),
            "reach": self.target,
            "differing": self.differing.iter().map(of_key).collect::<Map<_, _>>(),
            "warnings": self.warnings,
        })
    }

    pub fn to_text(&self, a: &ComparedSide, b: &ComparedSide) -> String {
        let mut lines = Vec::new();
        for ((letter, side), result) in [("A", a), ("B", b)].into_iter().zip(&self.sides) {
            let seeds: Vec<String> = result.runs.iter().map(|(seed, _)| seed.to_string()).collect();
            let on = common_episodes(result.runs.iter().map(|(_, played)| played)).map_or(String::new(), |on| {
                format!(" ({} of evaluation.seed {})", counted(on.count, "episode"), on.seed)
            });
            let seeds = seeds.join(", ");
            lines.push(for_terminal(&format!("{letter}: {}: {}, seed {seeds}{on}", side.name, side.group.name())));
        }
        // Keys that only one side uses follow from the simulator, which has a line of its own.
        let both = self.differing.iter().filter_map(|(key, [a, b])| Some((key, a.as_ref()?, b.as_ref()?)));
        let both = both.map(|(key, a, b)| Printable(format!("{key}: {a} in A, {b} in B")).to_string());
        lines.extend(both.map(|words| for_terminal(&format!("   {words}"))));
        let at = match both_in_words(self.sides.each_ref().map(|side| side.steps)) {
            [a, b] if a == b => format!("at {a} timesteps per agent"),
            [a, b] => format!("at {a} timesteps per agent in A, {b} in B"),
        };
        lines.push(for_terminal(&format!("{}, {at}", a.title)));
        lines.push(String::new());
        let mut row = |what: &str, [a, b]: [String; 2], both: String| {
            lines.push(format!("{what:<22}{a:>17}{b:>17}  {both}").trim_end().to_owned());
        };
        let sides = &self.sides;
        let like = sides[0].returns.mean;
        let or_dash = |word: Option<String>| word.unwrap_or("-".to_owned());
        let times = |values: [Option<f64>; 2]| values.map(|seconds| or_dash(seconds.map(duration)));
        row("", ["A", "B"].map(str::to_owned), "B against A".to_owned());
        let means = sides.each_ref().map(|side| figure_like(side.returns.mean, like));
        row("mean return", means, signed(self.difference.mean, like));
        let has_interval = sides.iter().any(|side| side.returns.interval.is_some());
        if has_interval {
            let of_sides = sides.each_ref().map(|side| interval(side.returns.interval, like));
            row("  95 % interval", of_sides, or_dash(self.difference.interval.map(|ends| signed_interval(ends, like))));
        }
        if self.difference.interval.is_none() {
            let seeds: BTreeSet<u64> = sides.iter().flat_map(|side| &side.runs).map(|(seed, _)| *seed).collect();
            for seed in seeds {
                let of_side = |side: &SideResult| {
                    let played = side.runs.iter().find(|(own, _)| *own == seed);
                    or_dash(played.map(|(_, played)| figure_like(played.mean, like)))
                };
                let difference = self.difference.of_seeds.iter().find(|(own, _)| *own == seed);
                let difference = difference.map_or(String::new(), |(_, value)| signed(*value, like));
                row(&format!("  seed {seed}"), sides.each_ref().map(of_side), difference);
            }
        }
        let [of_a, of_b] = sides.each_ref().map(|side| side.median_agent);
        row("median agent", [of_a, of_b].map(|median| figure_like(median, like)), signed(of_b - of_a, like));
        row(
            "stuck agents",
            sides.each_ref().map(|side| format!("{} of {}", side.stuck.0, side.stuck.1)),
            String::new(),
        );
        let runtimes = sides.each_ref().map(|side| side.runtime_s);
        row("runtime", times(runtimes), ratio(runtimes));
        let cpu = sides.each_ref().map(|side| side.cpu_s);
        row("CPU time", times(cpu), ratio(cpu));
        let target = figure_like(self.target, like);
        let steps = sides.each_ref().map(|side| side.median_reached()[0]);
        let of_sides = sides.each_ref().map(|side| {
            let steps = or_dash(side.median_reached()[0].map(|steps| steps_text(steps as u64)));
            format!("{steps} ({} of {})", side.reached.len(), side.runs.len())
        });
        row(&format!("steps to reach {target}"), of_sides, ratio(steps));
        let seconds = sides.each_ref().map(|side| side.median_reached()[1]);
        row(&format!("time to reach {target}"), times(seconds), ratio(seconds));
        lines.push(String::new());
        let interval = if has_interval { "; intervals: Student's t over seeds" } else { "" };
        lines.push(format!("returns: {}{interval}", pairing(self.difference.pairing)));
        lines.push("runtime: wall time; CPU time: all processes; both without evaluations".to_owned());
        lines.push("steps and time to reach: median of the runs that reached it".to_owned());
        lines.extend(self.warnings.iter().map(|warning| for_terminal(&format!("warning: {warning}"))));
        lines.join("\n")
    }
}

impl SideResult {
    fn to_json(&self, side: &ComparedSide) -> Value {
        let episodes = common_episodes(self.runs.iter().map(|(_, played)| played));
        let [steps, seconds] = self.median_reached();
        json!({
            "name": side.name,
            "method": side.group.name(),
            "steps": self.steps,
            "seeds": self.runs.iter().map(|(seed, _)| *seed).collect::<Vec<u64>>(),
            "runs": self.returns.runs(),
            "mean_return": self.returns.mean,
            "returns": self.returns.values,
            "interval_95": self.returns.interval.map(|interval| [interval.low, interval.high]),
            "evaluation_seed": episodes.map(|episodes| episodes.seed),
            "episodes": episodes.map(|episodes| episodes.count),
            "median_agent": self.median_agent,
            "stuck_agents": self.stuck.0,
            "agents": self.stuck.1,
            "runtime_s": self.runtime_s,
            "cpu_s": self.cpu_s,
            "reached_runs": self.reached.len(),
            "reached_steps": steps,
            "reached_s": seconds,
        })
    }
}

fn quotient([a, b]: [Option<f64>; 2]) -> Option<f64> {
    Some(b? / a?).filter(|quotient| quotient.is_finite())
}

fn ratio(values: [Option<f64>; 2]) -> String {
    quotient(values).map_or("-".to_owned(), |quotient| format!("x {quotient:.2}"))
}
