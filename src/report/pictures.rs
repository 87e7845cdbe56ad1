//! The charts of a report: which numbers each one shows.

use anyhow::Result;

use super::chart::{
    Axis, Bar, BarChart, Cell, Cluster, HeatMap, Level, Line, LineChart, LinePoint, Looks, MOST_BANDS, Mark, Panel,
    Row, RowChart, Scale,
};
use super::curves::{
    CurvePoint, LossData, LossPoint, learning_curve, loss_curve, loss_curves_of_seeds, single_trainings,
};
use super::finals::{Final, Runtime};
use super::group::{Comparison, Group, steps_text};
use super::paper;
use super::words::{difference, figure, signed};
use crate::base::statistics::difference::Difference;
use crate::base::statistics::{Bounds, ENOUGH_SEEDS, Spread};
use crate::domain::{FirstRow, Map};
use crate::drawing::Svg;
use crate::records::run_record::Returns;

/// Horizontal axis of a learning curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Against {
    Timesteps,
    Runtime,
}

fn steps_axis() -> Axis {
    Axis { label: "timesteps per agent".to_owned(), format: |steps| steps_text(steps.round() as u64) }
}

fn return_axis(comparison: &Comparison) -> Axis {
    let episode = &comparison.scenario.episode;
    let label = format!("mean return of an agent, {} {}", episode.length, episode.unit);
    Axis { label, format: |value| if value.abs() >= 50.0 { format!("{value:.0}") } else { format!("{value:.1}") } }
}

/// Draws the learning curves of a scenario; `None` if no run has the figures.
pub fn learning(comparison: &Comparison, looks: &Looks, against: Against) -> Result<Option<Svg>> {
    let curves: Vec<(&Group, Vec<CurvePoint>)> =
        comparison.groups.iter().map(|group| (group, learning_curve(group))).collect();
    let longest = curves.iter().flat_map(|(_, points)| points.iter().filter_map(|point| point.runtime_s));
    let (unit, seconds) = time_unit(longest.fold(0.0, f64::max));
    let place = |point: &CurvePoint| match against {
        Against::Timesteps => Some(point.steps as f64),
        Against::Runtime => point.runtime_s.map(|runtime| runtime / seconds),
    };
    let lines: Vec<Line> = curves
        .iter()
        .map(|(group, points)| Line {
            label: label_with_runs(comparison, group),
            look: looks.of(&group.label()),
            points: points.iter().filter_map(|point| Some(point_of(place(point)?, &point.returns, group))).collect(),
            companion: points.iter().filter_map(|point| Some((place(point)?, point.median_agent))).collect(),
            seeds: learning_of_seeds(group, against, seconds),
        })
        .filter(|line| !line.points.is_empty())
        .collect();
    if lines.is_empty() {
        return Ok(None);
    }
    let marks = match against {
        Against::Timesteps => paper_marks(comparison, &curves, looks),
        Against::Runtime => Vec::new(),
    };
    let x = match against {
        Against::Timesteps => steps_axis(),
        Against::Runtime => Axis { label: format!("wall time without evaluations, {unit}"), format: plain },
    };
    let chart = LineChart {
        title: comparison.heading(),
        x,
        y: return_axis(comparison),
        lines,
        companions: Some("the median agent".to_owned()),
        levels: levels(comparison),
        marks,
        x_end: 0.0,
        note: String::new(),
    };
    draw(chart, comparison, looks).map(Some)
}

/// Returns the curves of the single runs if the group has too few for an interval. A single run has none: it is the
/// mean.
fn learning_of_seeds(group: &Group, against: Against, seconds: f64) -> Vec<Vec<(f64, f64)>> {
    if !shows_seeds(group.runs.len()) {
        return Vec::new();
    }
    let curves = group.runs.iter().map(|run| {
        let points = run.evaluations.iter().filter_map(|point| {
            let place = match against {
                Against::Timesteps => point.steps as f64,
                Against::Runtime => run.runtime_at(point.steps)? / seconds,
            };
            Some((place, point.all.mean))
        });
        points.collect()
    });
    curves.collect()
}

fn shows_seeds(runs: usize) -> bool {
    (2..ENOUGH_SEEDS).contains(&runs)
}

/// Explains bands and pale lines.
fn note_on_seeds(lines: &[Line]) -> Option<String> {
    let bands = lines.iter().any(|line| line.points.iter().any(|point| point.band.is_some()));
    let bands = bands.then(|| "band: 95\u{a0}% Student's t interval over seeds".to_owned());
    let seeds = lines.iter().any(|line| !line.seeds.is_empty());
    let seeds = seeds.then(|| format!("pale lines: single seeds, if fewer than {ENOUGH_SEEDS}"));
    let notes: Vec<String> = bands.into_iter().chain(seeds).collect();
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// Draws a chart. With many lines, each one gets a panel with the reference. If there is no reference, all share one
/// chart without bands, seeds and companions.
fn draw(mut chart: LineChart, comparison: &Comparison, looks: &Looks) -> Result<Svg> {
    let told = chart.note.clone();
    let with = |note: Option<String>| {
        let notes: Vec<String> = note.into_iter().chain(Some(told.clone()).filter(|told| !told.is_empty())).collect();
        notes.join("; ")
    };
    chart.note = with(note_on_seeds(&chart.lines));
    if chart.lines.len() <= MOST_BANDS {
        return chart.draw();
    }
    let reference = comparison.reference.map(|reference| looks.of(&comparison.groups[reference].label()));
    if let Some(reference) = chart.lines.iter().position(|line| Some(line.look) == reference) {
        return chart.draw_against(reference);
    }
    for line in &mut chart.lines {
        line.companion.clear();
        line.seeds.clear();
        line.points.iter_mut().for_each(|point| point.band = None);
    }
    chart.note = with(Some("intervals and seeds: in the CSV files".to_owned()));
    LineChart { companions: None, ..chart }.draw()
}

/// Draws the final returns of an ablation, a row per group; `None` if there is no reference, or if it was not
/// evaluated.
pub fn ablation(comparison: &Comparison) -> Option<Result<Svg>> {
    let (opponent, reference) = (comparison.reference()?, &comparison.groups[comparison.reference?]);
    let of_reference = Final::of(reference)?;
    let others = comparison.groups.iter().filter(|group| !std::ptr::eq(*group, reference));
    let mut ends_of_others: Vec<(&Group, Final)> =
        others.filter_map(|group| Some((group, Final::of(group)?))).collect();
    ends_of_others.sort_by(|(_, a), (_, b)| b.returns.mean.total_cmp(&a.returns.mean));
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
    rows.extend(ends_of_others.iter().map(|(group, end)| row(group, end, to_reference(group, end))));
    let enough = rows.iter().any(|row| row.interval.is_some());
    let few = std::iter::once(&of_reference).chain(ends_of_others.iter().map(|(_, end)| end));
    let few = few.clone().any(|end| end.returns.interval.is_none());
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

fn point_of(x: f64, spread: &Spread, group: &Group) -> LinePoint {
    LinePoint { x, y: spread.mean, band: spread.interval.map(ends), whole: spread.runs() == group.runs.len() }
}

fn ends(Bounds { low, high }: Bounds) -> (f64, f64) {
    (low, high)
}

fn label_with_runs(comparison: &Comparison, group: &Group) -> String {
    let runs = group.runs.len();
    format!("{} ({runs} {})", comparison.short_label(group), if runs == 1 { "run" } else { "runs" })
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

/// Returns the levels of the hand-coded controllers: those measured here, and the paper's.
fn levels(comparison: &Comparison) -> Vec<Level> {
    let measured = comparison.baselines.iter().map(|baseline| Level {
        label: format!("{}, measured: {}", baseline.controller, figure(baseline.mean_return)),
        name: baseline.controller.split(':').next().unwrap_or_default().to_owned(),
        y: baseline.mean_return,
        measured: true,
    });
    let paper = paper::hand_coded(&comparison.scenario).map(|y| Level {
        label: format!("hand-coded, the paper: {}", figure(y)),
        name: "the paper".to_owned(),
        y,
        measured: false,
    });
    measured.chain(paper).collect()
}

/// Returns the paper's points within the steps that are drawn, for each of its methods that has a curve here.
fn paper_marks(comparison: &Comparison, curves: &[(&Group, Vec<CurvePoint>)], looks: &Looks) -> Vec<Mark> {
    let last = curves.iter().filter_map(|(_, points)| points.last()).map(|point| point.steps).max().unwrap_or(0);
    let mut told = Vec::new();
    let mut marks = Vec::new();
    for (group, _) in curves {
        let method = (group.simulator(), group.method.retraining);
        let mut points = paper::curve(&comparison.scenario, group.simulator(), group.method.retraining);
        points.retain(|point| point.steps as f64 <= 1.02 * last as f64);
        if points.iter().any(|point| point.steps > 0) && !told.contains(&method) {
            told.push(method);
            let drawn = points.iter().any(|point| point.std_error.is_some());
            marks.push(Mark {
                label: format!("{}, the paper{}", group.name(), if drawn { ", ± its standard error" } else { "" }),
                look: looks.of(&group.label()),
                points: points.iter().map(|point| (point.steps as f64, point.mean, point.std_error)).collect(),
            });
        }
    }
    marks
}

/// Draws the cross-entropy of the AIPs (approximate influence predictors) of a scenario; `None` if no AIP was trained.
pub fn cross_entropy(comparison: &Comparison, looks: &Looks) -> Result<Option<Svg>> {
    let trained = comparison.groups.iter().filter(|group| group.simulator() != "untrained-dials");
    let curves: Vec<(&Group, LossData, Vec<LossPoint>)> = trained
        .map(|group| {
            let (data, mut points) = loss_curve(group);
            points.retain(|point| is_trained(point.steps, point.after_training));
            (group, data, points)
        })
        .filter(|(_, _, points)| !points.is_empty())
        .collect();
    if curves.is_empty() {
        return Ok(None);
    }
    let marks = curves.iter().filter_map(|(group, _, _)| {
        let points: Vec<_> =
            single_trainings(group).into_iter().map(|(steps, loss)| (steps as f64, loss, None)).collect();
        let label = format!("{}: AIPs trained for some seeds only", comparison.short_label(group));
        (!points.is_empty()).then(|| Mark { label, look: looks.of(&group.label()), points })
    });
    let lines = curves.iter().map(|(group, data, points)| Line {
        label: label_with_runs(comparison, group),
        look: looks.of(&group.label()),
        points: points.iter().map(|point| point_of(point.steps as f64, &point.loss, group)).collect(),
        companion: points.iter().map(|point| (point.steps as f64, point.marginals)).collect(),
        seeds: losses_of_seeds(group, *data),
    });
    let runs = comparison.groups.iter().flat_map(|group| &group.runs);
    let evaluated = runs.filter_map(|run| Some(run.evaluations.last()?.steps));
    let (fresh, held_out) =
        ("on fresh GS episodes at evaluations", "on held-out episodes, before and after each training");
    let of = |data| curves.iter().any(|(_, of, _)| *of == data);
    let note = match (of(LossData::Fresh), of(LossData::HeldOut)) {
        (true, false) => fresh.to_owned(),
        (false, _) => held_out.to_owned(),
        (true, true) => format!("{fresh}; if that was not measured: {held_out}"),
    };
    let chart = LineChart {
        title: comparison.heading(),
        x: steps_axis(),
        y: Axis { label: "cross-entropy per source, nats".to_owned(), format: |value| format!("{value:.3}") },
        lines: lines.collect(),
        companions: Some("constant marginals of the same data".to_owned()),
        levels: Vec::new(),
        marks: marks.collect(),
        x_end: evaluated.max().unwrap_or(0) as f64,
        note,
    };
    draw(chart, comparison, looks).map(Some)
}

/// Whether a loss belongs in the chart. Those of untrained AIPs are so large that nothing else could be seen.
fn is_trained(steps: u64, after_training: bool) -> bool {
    steps > 0 || after_training
}

/// Returns the loss curves of the single runs, on the same condition as [`learning_of_seeds`].
fn losses_of_seeds(group: &Group, data: LossData) -> Vec<Vec<(f64, f64)>> {
    if !shows_seeds(group.runs.len()) {
        return Vec::new();
    }
    let curve = |points: Vec<(u64, bool, f64)>| {
        let points = points.into_iter().filter(|(steps, after_training, _)| is_trained(*steps, *after_training));
        points.map(|(steps, _, loss)| (steps as f64, loss)).collect()
    };
    loss_curves_of_seeds(group, data).into_iter().map(curve).collect()
}

/// Draws the final returns of a domain, a cluster per size.
pub fn final_bars(domain: &str, comparisons: &[&Comparison], looks: &Looks) -> Result<Svg> {
    let clusters = clusters(comparisons, |comparison, group| {
        let end = Final::of(group)?;
        let paper = paper::final_return(&comparison.scenario, group.simulator(), group.method.retraining);
        Some(Bar {
            label: bar_label(comparisons, comparison, group, end.finished),
            look: looks.of(&group.label()),
            value: Some(end.returns.mean),
            whisker: end.returns.interval.map(ends),
            points: single(&end.returns, 1.0),
            paper: paper.filter(|paper| comparable(end.steps, paper.steps)).map(|paper| paper.mean),
        })
    });
    let chart = BarChart {
        title: format!("Final return, {}", domain),
        x_label: "agents".to_owned(),
        y: return_axis(comparisons[0]),
        format: figure,
        scale: Scale::Linear,
        note: note_on_bars(&clusters).unwrap_or_default(),
        clusters,
    };
    chart.draw()
}

/// Draws the runtimes of a domain, a cluster per size.
pub fn runtime_bars(domain: &str, comparisons: &[&Comparison], looks: &Looks) -> Result<Svg> {
    let groups = comparisons.iter().flat_map(|comparison| &comparison.groups);
    let longest = groups.filter_map(|group| Some(Runtime::of(group)?.total.mean)).fold(0.0, f64::max);
    let (unit, seconds) = time_unit(longest);
    let clusters = clusters(comparisons, |comparison, group| {
        let time = Runtime::of(group)?;
        let paper = paper::runtime(&comparison.scenario, group.simulator(), group.method.retraining);
        let total = &time.total;
        Some(Bar {
            label: bar_label(comparisons, comparison, group, time.finished),
            look: looks.of(&group.label()),
            value: Some(total.mean / seconds),
            whisker: total.interval.map(|Bounds { low, high }| (low / seconds, high / seconds)),
            points: single(total, seconds),
            paper: paper.filter(|_| comparable(time.steps, paper::STEPS)).map(|paper| paper.total * 3600.0 / seconds),
        })
    });
    let chart = BarChart {
        title: format!("Runtime, {}", domain),
        x_label: "agents".to_owned(),
        y: Axis { label: format!("{unit}, powers of 2"), format: plain },
        format: short,
        scale: Scale::Log2,
        note: std::iter::once("wall time of a run without its evaluations".to_owned())
            .chain(note_on_bars(&clusters))
            .collect::<Vec<_>>()
            .join("; "),
        clusters,
    };
    chart.draw()
}

/// Writes a difference like [`difference`], but shorter, to fit a picture. With few seeds: `+4.1 (+3.0, +5.0, +4.3)`,
/// without their number.
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

/// Returns the values of the seeds in this unit, if they are too few for an interval.
fn single(spread: &Spread, unit: f64) -> Vec<f64> {
    let values = spread.values.iter().map(|value| value / unit);
    if shows_seeds(spread.runs()) { values.collect() } else { Vec::new() }
}

/// Explains whiskers and circles.
fn note_on_bars(clusters: &[Cluster]) -> Option<String> {
    let bars = || clusters.iter().flat_map(|cluster| &cluster.bars);
    let whiskers = bars().any(|bar| bar.whisker.is_some());
    let whiskers = whiskers.then(|| "whiskers: 95\u{a0}% Student's t interval over seeds".to_owned());
    let circles = bars().any(|bar| !bar.points.is_empty());
    let circles = circles.then(|| format!("circles: single seeds, if fewer than {ENOUGH_SEEDS}"));
    let notes: Vec<String> = whiskers.into_iter().chain(circles).collect();
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// Returns the label of a bar. It is the full one if there are several scenarios, because a short one may differ
/// between them.
fn bar_label(comparisons: &[&Comparison], comparison: &Comparison, group: &Group, finished: bool) -> String {
    let label = if comparisons.len() == 1 { comparison.short_label(group) } else { group.label() };
    format!("{label}{}", if finished { "" } else { ", unfinished" })
}

/// Writes a number with three digits.
fn short(value: f64) -> String {
    match value {
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 10.0 => format!("{v:.1}"),
        v => format!("{v:.2}"),
    }
}

/// Whether a run of `steps` steps is long enough to compare with a figure of the paper: at least nine tenths of its
/// steps.
pub fn comparable(steps: u64, paper_steps: u64) -> bool {
    10 * steps >= 9 * paper_steps
}

fn clusters(comparisons: &[&Comparison], bar: impl Fn(&Comparison, &Group) -> Option<Bar>) -> Vec<Cluster> {
    let clusters = comparisons.iter().map(|comparison| Cluster {
        label: comparison.size(),
        bars: comparison.groups.iter().filter_map(|group| bar(comparison, group)).collect(),
    });
    clusters.collect()
}

/// Draws every agent of a scenario at the end of its runs; `None` if nothing was evaluated.
pub fn agents(comparison: &Comparison) -> Result<Option<Svg>> {
    let mut groups = Vec::new();
    for group in &comparison.groups {
        let (Some(end), Some(run)) = (Final::of(group), group.runs.first()) else { continue };
        let map = run.scenario.as_ref().and_then(|scenario| scenario.map);
        let map = map.unwrap_or_else(|| square(comparison.scenario.agents));
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
    let map = HeatMap {
        title: format!("{}: every agent at the end", comparison.heading()),
        key: "mean return; cross: stuck".to_owned(),
        format: figure,
        groups,
    };
    map.draw().map(Some)
}

/// Returns rows and columns for agents whose grid is not known: a square if their number is one, else a single row.
fn square(agents: usize) -> Map {
    let side = agents.isqrt();
    let (rows, columns) = if side * side == agents { (side, side) } else { (1, agents) };
    Map { rows, columns, first_row: FirstRow::Top }
}

/// Arranges agents row by row. `upwards`: agent 0 is in the bottom row.
fn on_the_map(agents: &[(f64, bool)], map: Map) -> Vec<Vec<Cell>> {
    let cell = |&(value, stuck): &(f64, bool)| Cell { value, stuck };
    let mut rows: Vec<Vec<Cell>> =
        agents.chunks(map.columns.max(1)).map(|row| row.iter().map(cell).collect()).collect();
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
            rows.iter().map(|row| row.iter().map(|cell| cell.value).collect()).collect()
        };
        assert_eq!(values(FirstRow::Bottom), [[3.0, 4.0, 5.0], [0.0, 1.0, 2.0]]);
        assert_eq!(values(FirstRow::Top), [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]);
        assert_eq!([square(25), square(6)].map(|map| (map.rows, map.columns)), [(5, 5), (1, 6)]);
    }
}
