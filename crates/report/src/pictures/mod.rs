//! The charts of a report: which numbers each one shows.
//!
//! - `over_time`: training as it proceeds. `at_the_end`: what runs have come to. `by_cores`: how long they would take
//!   elsewhere.

mod at_the_end;
mod by_cores;
mod over_time;

use super::chart::Axis;
use super::group::{Comparison, Group};
use dials_core::base::counted;
use dials_core::base::statistics::{Bounds, ENOUGH_SEEDS};

pub(crate) use at_the_end::{ablation, agents, final_bars, runtime_bars};
pub(crate) use by_cores::time_by_cores;
pub(crate) use over_time::{Against, cross_entropy, learning};

fn return_axis(comparison: &Comparison) -> Axis {
    let episode = &comparison.scenario.episode;
    let label = format!("mean return of an agent, {} {}", episode.length, episode.unit);
    Axis { label, format: plain }
}

/// Whether a chart shows the single seeds: several, but too few for an interval.
fn shows_seeds(runs: usize) -> bool {
    (2..ENOUGH_SEEDS).contains(&runs)
}

fn label_with_runs(comparison: &Comparison, group: &Group) -> String {
    format!("{} ({})", comparison.short_label(group), counted(group.runs.len(), "run"))
}

fn ends(Bounds { low, high }: Bounds) -> (f64, f64) {
    (low, high)
}

fn joined(notes: &[(bool, &str)]) -> String {
    let notes: Vec<&str> = notes.iter().filter(|(applies, _)| *applies).map(|(_, note)| *note).collect();
    notes.join("; ")
}

fn plain(value: f64) -> String {
    // Three decimals are enough for the ticks of an axis, and hide their rounding errors.
    format!("{}", (value * 1000.0).round() / 1000.0)
}

fn time_unit(longest_s: f64) -> (&'static str, f64) {
    match longest_s {
        s if s < 180.0 => ("seconds", 1.0),
        s if s < 3.0 * 3600.0 => ("minutes", 60.0),
        _ => ("hours", 3600.0),
    }
}

/// Whether a run is long enough to compare with a figure of the paper: at least nine tenths of its steps.
pub(crate) fn comparable(steps: u64, paper_steps: u64) -> bool {
    10 * steps >= 9 * paper_steps
}
