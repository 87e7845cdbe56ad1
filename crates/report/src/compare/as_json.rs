//! The result of a comparison for programs.

use serde_json::{Value, json};

use super::{ComparedSide, Verdict, quotient};
use dials_core::base::statistics::difference::common_episodes;
use dials_session::records::run_record::CpuTime;

impl Verdict {
    /// Writes the comparison as JSON.
    pub fn to_json(&self, a: &ComparedSide, b: &ComparedSide) -> Value {
        let side = |index: usize, side: &ComparedSide| {
            let (returns, reached) = (&self.returns[index], &self.reached[index]);
            let episodes = common_episodes(self.runs[index].iter().map(|(_, played)| played));
            json!({
                "name": side.name,
                "method": side.group.name(),
                "steps": self.steps[index],
                "seeds": self.runs[index].iter().map(|(seed, _)| *seed).collect::<Vec<u64>>(),
                "runs": returns.runs(),
                "mean_return": returns.mean,
                "returns": returns.values,
                "interval_95": returns.interval.map(|interval| [interval.low, interval.high]),
                "evaluation_seed": episodes.map(|episodes| episodes.seed),
                "episodes": episodes.map(|episodes| episodes.count),
                "median_agent": self.median_agents[index],
                "stuck_agents": self.stuck[index].0,
                "agents": self.stuck[index].1,
                "runtime_s": self.runtimes[index],
                "cpu_s": self.cpu[index].map(CpuTime::runtime_s),
                "reached_runs": reached.runs.len(),
                "reached_steps": reached.steps(),
                "reached_s": reached.seconds(),
            })
        };
        json!({
            "scenario": a.scenario.word(),
            "steps": self.steps[0].min(self.steps[1]),
            "a": side(0, a),
            "b": side(1, b),
            "difference": self.difference.mean,
            "interval_95": self.difference.interval.map(|interval| [interval.low, interval.high]),
            "paired_by": self.difference.pairing.name(),
            "differences": self.difference.of_seeds.iter().map(|(seed, value)| json!({ "seed": seed, "difference": value })).collect::<Vec<_>>(),
            "runtime_ratio": quotient(self.runtimes),
            "cpu_ratio": quotient(self.cpu.map(|cpu| cpu.map(CpuTime::runtime_s))),
            "reach": self.target,
            "differing": self.differing.iter().map(|(key, values)| (key.clone(), json!(values))).collect::<serde_json::Map<_, _>>(),
            "warnings": self.warnings,
        })
    }
}
