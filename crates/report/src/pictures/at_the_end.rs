//! Charts of what runs have come to: final returns, runtimes, and every agent.

use anyhow::Result;

use super::{comparable, ends, joined, label_with_runs, plain, return_axis, shows_seeds, time_unit};
use crate::chart::{Axis, Bar, BarChart, Cluster, HeatMap, Looks, NamedChart, Panel, Row, RowChart, Scale, Series};
use crate::drawing::Svg;
use crate::family::Family;
use crate::finals::{Final, Runtime};
use crate::group::{Comparison, Group};
use crate::paper;
use crate::words::{difference, figure, signed};
use dials_core::base::statistics::difference::Difference;
use dials_core::base::statistics::{Bounds, ENOUGH_SEEDS, Spread};
use dials_core::domain::{FirstRow, Map};
use dials_session::records::method::steps_text;
use dials_session::records::run_record::Returns;

/// Draws the final returns of an ablation, a row per group; `None` without an evaluated reference.
pub(crate) fn ablation(comparison: &Comparison) -> Option<Result<Svg>> {
    let (opponent, reference) = (comparison.reference()?, &comparison.groups[comparison.reference?]);
    let (mut of_reference, mut others): (Vec<_>, Vec<_>) =
        comparison.ends().into_iter().partition(|(group, _)| std::ptr::eq(*group, reference));
    let (_, of_reference) = of_reference.pop()?;
    others.sort_by(|(_, a), (_, b)| b.returns.mean.total_cmp(&a.returns.mean));
    let row = |group: &Group, end: &Final, against: String| Row {
        label: comparison.short_label(group),
        points: end.returns.values.clone(),
        mean: end.returns.mean,
        interval: end.returns.interval.map(ends),
        words: [figure(end.returns.mean), against, format!("{} of {}", end.stuck.len(), end.agents)],
    };
    let to_reference = |group: &Group, end: &Final| match opponent.difference(group, end) {
        Some(found) => short_difference(found, end.returns.mean),
        None => format!("at {} steps", steps_text(end.steps)),
    };
    let mut rows = vec![row(reference, &of_reference, "the reference".to_owned())];
    rows.extend(others.iter().map(|(group, end)| row(group, end, to_reference(group, end))));
    let enough = rows.iter().any(|row| row.interval.is_some());
    let few = rows.iter().any(|row| row.interval.is_none());
    let note = match (enough, few) {
        (true, false) => "diamond and bar: mean and 95 % Student's t interval over seeds; circles: seeds",
        (true, true) => {
            "diamond: mean; bar: 95 % Student's t interval over seeds (five or more); circles: seeds; n: their number"
        }
        (false, _) => {
            "diamond: mean; circles: seeds, too few for an interval; in brackets: the difference for each seed"
        }
    };
    let chart = RowChart {
        title: format!("{}: what each setting changes", comparison.heading()),
        x: Axis { label: format!("final {}", return_axis(comparison).label), ..return_axis(comparison) },
        rows,
        header: ["mean", if enough { "minus the reference [95 %]" } else { "minus the reference" }, "stuck"]
            .map(str::to_owned),
        note: note.to_owned(),
    };
    Some(chart.draw())
}

pub(crate) fn final_bars(family: &Family, looks: &Looks) -> Result<Svg> {
    let clusters = clusters(family, looks, 1.0, |comparison, group| {
        let end = Final::of(group)?;
        let paper = paper::final_return(&comparison.scenario, group.simulator(), group.method.retraining);
        let paper = paper.filter(|paper| comparable(end.steps, paper.steps)).map(|paper| paper.mean);
        Some((end.finished, end.returns, paper))
    });
    let chart = BarChart {
        title: format!("Final return, {}", family.title),
        y: return_axis(family.comparisons[0]),
        format: figure,
        scale: Scale::Linear,
        note: note_on_bars(&clusters, ""),
        clusters,
    };
    chart.draw()
}

/// Draws the runtimes of a family, a cluster per size; `None` if no run has trained yet.
pub(crate) fn runtime_bars(family: &Family, looks: &Looks) -> Result<Option<Svg>> {
    let groups = family.comparisons.iter().flat_map(|comparison| &comparison.groups);
    let longest = groups.filter_map(|group| Some(Runtime::of(group)?.total.mean)).fold(0.0, f64::max);
    let (unit, seconds) = time_unit(longest);
    let clusters = clusters(family, looks, seconds, |comparison, group| {
        // A run that has not trained yet has no place on an axis of powers.
        let time = Runtime::of(group).filter(|time| time.total.mean > 0.0)?;
        let paper = paper::runtime(&comparison.scenario, group.simulator(), group.method.retraining);
        let paper = paper.filter(|_| comparable(time.steps, paper::STEPS)).map(|paper| paper.total * 3600.0);
        Some((time.finished, time.total, paper))
    });
    if clusters.iter().all(|cluster| cluster.bars.is_empty()) {
        return Ok(None);
    }
    let chart = BarChart {
        title: format!("Runtime, {}", family.title),
        y: Axis { label: format!("{unit}, powers of 2"), format: plain },
        format: short,
        scale: Scale::Log2,
        note: note_on_bars(&clusters, "wall time of a run without its evaluations"),
        clusters,
    };
    chart.draw().map(Some)
}

/// `figure`: whether the runs of a group are finished, their figures, and the paper's. `unit`: 1 in the chart.
fn clusters(
    family: &Family,
    looks: &Looks,
    unit: f64,
    figure: impl Fn(&Comparison, &Group) -> Option<(bool, Spread, Option<f64>)>,
) -> Vec<Cluster> {
    let bar = |comparison: &Comparison, group: &Group| {
        let (finished, spread, paper) = figure(comparison, group)?;
        // A short label may differ between scenarios.
        let label = if family.comparisons.len() == 1 { comparison.short_label(group) } else { group.label() };
        let single = spread.values.iter().map(|value| value / unit);
        Some(Bar {
            label: format!("{label}{}", if finished { "" } else { ", unfinished" }),
            look: looks.of(&group.label()),
            value: spread.mean / unit,
            whisker: spread.interval.map(|Bounds { low, high }| (low / unit, high / unit)),
            points: if shows_seeds(spread.runs()) { single.collect() } else { Vec::new() },
            paper: paper.map(|paper| paper / unit),
        })
    };
    let clusters = family.comparisons.iter().map(|comparison| Cluster {
        label: comparison.size(),
        bars: comparison.groups.iter().filter_map(|group| bar(comparison, group)).collect(),
    });
    clusters.collect()
}

/// Writes a difference like [`difference`], but without the number of seeds: `+4.1 (+3.0, +5.0, +4.3)`.
fn short_difference(found: Difference, like: f64) -> String {
    if !found.pairing.by_episode() {
        return difference(&Difference { of_seeds: Vec::new(), ..found }, like);
    }
    match found.interval {
        None if shows_seeds(found.of_seeds.len()) => {
            let seeds: Vec<String> = found.of_seeds.iter().map(|(_, value)| signed(*value, like)).collect();
            format!("{} ({})", signed(found.mean, like), seeds.join(", "))
        }
        _ => difference(&found, like),
    }
}

/// Explains whiskers and circles after another note, which may be empty.
fn note_on_bars(clusters: &[Cluster], before: &str) -> String {
    let bars = || clusters.iter().flat_map(|cluster| &cluster.bars);
    joined(&[
        (!before.is_empty(), before),
        (bars().any(|bar| bar.whisker.is_some()), "whiskers: 95\u{a0}% Student's t interval over seeds"),
        (bars().any(|bar| !bar.points.is_empty()), &format!("circles: single seeds, if fewer than {ENOUGH_SEEDS}")),
    ])
}

fn short(value: f64) -> String {
    match value {
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 10.0 => format!("{v:.1}"),
        v => format!("{v:.2}"),
    }
}

/// Draws every agent at the end of its runs, or at the last evaluation so far; `None` if nothing was evaluated.
pub(crate) fn agents(comparison: &Comparison, looks: &Looks) -> Result<Option<Svg>> {
    match comparison.map() {
        Some(map) => agents_in_rows(comparison, map),
        None => agents_by_name(comparison, looks),
    }
}

fn agents_in_rows(comparison: &Comparison, map: Map) -> Result<Option<Svg>> {
    let mut groups = Vec::new();
    for (group, end) in comparison.ends() {
        let panel = |label: String, agents: Vec<(f64, bool)>| Panel { label, rows: on_the_map(&agents, map) };
        let mut panels = Vec::new();
        if end.agents_of_runs.len() > 1 {
            let means = end.agent_means.iter().map(|&mean| (mean, false)).collect();
            panels.push(panel(format!("mean of {} seeds", end.agents_of_runs.len()), means));
        }
        for (seed, agents) in &end.agents_of_runs {
            let stuck = agents.iter().filter(|agent| agent.stuck > 0).count();
            let stuck = if stuck > 0 { format!(", {stuck} stuck") } else { String::new() };
            let cells = agents.iter().map(|Returns { mean, stuck, .. }| (*mean, *stuck > 0)).collect();
            panels.push(panel(format!("seed {seed}{stuck}"), cells));
        }
        groups.push((comparison.short_label(group), panels));
    }
    if groups.is_empty() {
        return Ok(None);
    }
    let map = HeatMap { title: format!("{}: every agent {}", comparison.heading(), comparison.when()), groups };
    map.draw().map(Some)
}

/// Largest number of agents in a picture by name. Of more, those with the lowest returns are drawn.
const MOST_NAMED: usize = 40;

fn agents_by_name(comparison: &Comparison, looks: &Looks) -> Result<Option<Svg>> {
    let ends = comparison.ends();
    let runs = ends.iter().flat_map(|(group, _)| &group.runs);
    let Some(run) = runs.max_by_key(|run| run.about.agents.len()) else { return Ok(None) };
    let all = comparison.scenario.agents;
    let mean_of = |agent: usize| ends.iter().map(|(_, end)| end.agent_means[agent]).sum::<f64>();
    let mut order: Vec<usize> = (0..all).collect();
    order.sort_by(|&one, &other| mean_of(one).total_cmp(&mean_of(other)));
    order.truncate(MOST_NAMED);
    let series = ends.iter().map(|(group, end)| {
        let stuck = |agent: usize| end.stuck.iter().any(|stuck| stuck.agent == agent);
        Series {
            label: label_with_runs(comparison, group),
            look: looks.of(&group.label()),
            values: order.iter().map(|&agent| (end.agent_means[agent], stuck(agent))).collect(),
        }
    });
    let series: Vec<Series> = series.collect();
    let fewer = if order.len() < all { format!("; the {} lowest of {all}", order.len()) } else { String::new() };
    let any_stuck = series.iter().flat_map(|series| &series.values).any(|(_, stuck)| *stuck);
    let cross = if any_stuck { "; black cross: stuck" } else { "" };
    let chart = NamedChart {
        title: format!("{}: every agent {}", comparison.heading(), comparison.when()),
        x: return_axis(comparison),
        names: order.iter().map(|&agent| run.about.agent_name(agent)).collect(),
        series,
        note: format!("means over seeds, the lowest at the top{cross}{fewer}"),
    };
    chart.draw().map(Some)
}

/// Arranges agents row by row, with the top row first.
fn on_the_map(agents: &[(f64, bool)], map: Map) -> Vec<Vec<(f64, bool)>> {
    let mut rows: Vec<Vec<(f64, bool)>> = agents.chunks(map.columns.max(1)).map(<[_]>::to_vec).collect();
    if map.first_row == FirstRow::Bottom {
        rows.reverse();
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_row_of_agent_0_is_where_the_map_has_it() {
        let agents: Vec<(f64, bool)> = (0..6).map(|agent| (f64::from(agent), false)).collect();
        let values = |first_row| -> Vec<Vec<f64>> {
            let rows = on_the_map(&agents, Map { rows: 2, columns: 3, first_row });
            rows.iter().map(|row| row.iter().map(|(value, _)| *value).collect()).collect()
        };
        assert_eq!(values(FirstRow::Bottom), [[3.0, 4.0, 5.0], [0.0, 1.0, 2.0]]);
        assert_eq!(values(FirstRow::Top), [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]);
    }
}
