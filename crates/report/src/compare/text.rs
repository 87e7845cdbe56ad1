//! The result of a comparison for people.

use std::collections::BTreeSet;

use super::steps::both_in_words;
use super::{ComparedSide, Reached, Verdict, quotient};
use crate::words::{duration, figure_like, interval, pairing, signed, signed_interval};
use dials_core::base::statistics::difference::{BySeed, common_episodes};
use dials_core::base::{counted, for_terminal};
use dials_core::outside::Printable;
use dials_session::records::method::steps_text;
use dials_session::records::run_record::CpuTime;

impl Verdict {
    /// Writes the comparison as text.
    pub fn to_text(&self, a: &ComparedSide, b: &ComparedSide) -> String {
        let mut lines = Vec::new();
        for ((letter, side), runs) in [("A", a), ("B", b)].into_iter().zip(&self.runs) {
            let seeds: Vec<String> = runs.iter().map(|(seed, _)| seed.to_string()).collect();
            let on = common_episodes(runs.iter().map(|(_, played)| played)).map_or(String::new(), |on| {
                format!(" ({} of evaluation.seed {})", counted(on.count, "episode"), on.seed)
            });
            let seeds = seeds.join(", ");
            lines.push(for_terminal(&format!("{letter}: {}: {}, seed {seeds}{on}", side.name, side.group.name())));
        }
        // Keys that only one side uses follow from the simulator, which has a line of its own.
        let both = self.differing.iter().filter_map(|(key, [a, b])| Some((key, a.as_ref()?, b.as_ref()?)));
        let both = both.map(|(key, a, b)| Printable(format!("{key}: {a} in A, {b} in B")).to_string());
        lines.extend(both.map(|words| for_terminal(&format!("   {words}"))));
        let at = match both_in_words(self.steps) {
            [a, b] if a == b => format!("at {a} timesteps per agent"),
            [a, b] => format!("at {a} timesteps per agent in A, {b} in B"),
        };
        lines.push(for_terminal(&format!("{}, {at}", a.title)));
        lines.push(String::new());
        let row = |what: &str, a: String, b: String, both: String| {
            format!("{what:<22}{a:>17}{b:>17}  {both}").trim_end().to_owned()
        };
        lines.push(row("", "A".to_owned(), "B".to_owned(), "B against A".to_owned()));
        let like = self.returns[0].mean;
        let [of_a, of_b] = self.returns.each_ref().map(|spread| figure_like(spread.mean, like));
        lines.push(row("mean return", of_a, of_b, signed(self.difference.mean, like)));
        if self.returns.iter().any(|spread| spread.interval.is_some()) {
            let [of_a, of_b] = self.returns.each_ref().map(|spread| interval(spread.interval, like));
            let of_both = self.difference.interval.map_or("-".to_owned(), |ends| signed_interval(ends, like));
            lines.push(row("  95 % interval", of_a, of_b, of_both));
        }
        if self.difference.interval.is_none() {
            lines.extend(self.seeds().map(|(seed, values, difference)| {
                let [of_a, of_b] = values.map(|value| value.map_or("-".to_owned(), |value| figure_like(value, like)));
                let difference = difference.map_or(String::new(), |value| signed(value, like));
                row(&format!("  seed {seed}"), of_a, of_b, difference)
            }));
        }
        let [a_median, b_median] = self.median_agents;
        let median_difference = signed(b_median - a_median, like);
        lines.push(row("median agent", figure_like(a_median, like), figure_like(b_median, like), median_difference));
        let [of_a, of_b] = self.stuck.map(|(stuck, all)| format!("{stuck} of {all}"));
        lines.push(row("stuck agents", of_a, of_b, String::new()));
        let [of_a, of_b] = self.runtimes.map(|seconds| seconds.map_or("-".to_owned(), duration));
        lines.push(row("runtime", of_a, of_b, ratio(self.runtimes)));
        let cpu = self.cpu.map(|cpu| cpu.map(CpuTime::runtime_s));
        let [of_a, of_b] = cpu.map(|seconds| seconds.map_or("-".to_owned(), duration));
        lines.push(row("CPU time", of_a, of_b, ratio(cpu)));
        let target = figure_like(self.target, like);
        let steps = self.reached.each_ref().map(Reached::steps);
        let [of_a, of_b] = self.reached.each_ref().map(|reached| {
            let steps = reached.steps().map_or("-".to_owned(), |steps| steps_text(steps as u64));
            format!("{steps} ({} of {})", reached.runs.len(), reached.of)
        });
        lines.push(row(&format!("steps to reach {target}"), of_a, of_b, ratio(steps)));
        let seconds = self.reached.each_ref().map(Reached::seconds);
        let [of_a, of_b] = seconds.map(|seconds| seconds.map_or("-".to_owned(), duration));
        lines.push(row(&format!("time to reach {target}"), of_a, of_b, ratio(seconds)));
        lines.push(String::new());
        let interval = self.returns.iter().any(|spread| spread.interval.is_some());
        let interval = if interval { "; intervals: Student's t over seeds" } else { "" };
        lines.push(format!("returns: {}{interval}", pairing(self.difference.pairing)));
        lines.push("runtime: wall time; CPU time: all processes; both without evaluations".to_owned());
        lines.push("steps and time to reach: median of the runs that reached it".to_owned());
        lines.extend(self.warnings.iter().map(|warning| for_terminal(&format!("warning: {warning}"))));
        lines.join("\n")
    }

    /// Returns all seeds with the return of each side and their difference.
    fn seeds(&self) -> impl Iterator<Item = (u64, [Option<f64>; 2], Option<f64>)> + '_ {
        let seeds: BTreeSet<u64> = self.runs.iter().flatten().map(|(seed, _)| *seed).collect();
        seeds.into_iter().map(|seed| {
            let value = |side: &BySeed| side.iter().find(|(own, _)| *own == seed).map(|(_, played)| played.mean);
            let difference = self.difference.of_seeds.iter().find(|(own, _)| *own == seed).map(|(_, value)| *value);
            (seed, self.runs.each_ref().map(value), difference)
        })
    }
}

fn ratio(values: [Option<f64>; 2]) -> String {
    quotient(values).map_or("-".to_owned(), |quotient| format!("x {quotient:.2}"))
}
