//! Charts of training as it proceeds: returns and cross-entropy.

use anyhow::Result;

use super::{ends, joined, label_with_runs, plain, return_axis, shows_seeds, time_unit};
use crate::chart::{Axis, Level, Line, LineChart, LinePoint, Looks, MOST_BANDS, Mark};
use crate::curves::{CurvePoint, LossData, LossPoint, learning_curve, loss_curve, measured, single_trainings};
use crate::drawing::Svg;
use crate::group::{Comparison, Group};
use crate::paper;
use crate::words::figure;
use dials_core::base::statistics::{ENOUGH_SEEDS, Spread};
use dials_session::records::method::steps_text;
use dials_session::records::run_record::RunRecord;

#[derive(Clone, Copy)]
pub(crate) enum Against {
    Timesteps,
    CpuTime,
}

fn steps_axis() -> Axis {
    Axis { label: "timesteps per agent".to_owned(), format: |steps| steps_text(steps.round() as u64) }
}

/// Draws the learning curves of a scenario; `None` if no run has the figures.
pub(crate) fn learning(comparison: &Comparison, looks: &Looks, against: Against) -> Result<Option<Svg>> {
    let curves: Vec<(&Group, Vec<CurvePoint>)> =
        comparison.groups.iter().map(|group| (group, learning_curve(group))).collect();
    let longest = curves.iter().flat_map(|(_, points)| points.iter().filter_map(|point| point.cpu_s));
    let (unit, seconds) = time_unit(longest.fold(0.0, f64::max));
    let place_of = |steps: u64, cpu_s: Option<f64>| match against {
        Against::Timesteps => Some(steps as f64),
        Against::CpuTime => cpu_s.map(|cpu_s| cpu_s / seconds),
    };
    let place = |point: &CurvePoint| place_of(point.steps, point.cpu_s);
    let of_run = |run: &RunRecord| {
        let evaluations = run.evaluations.iter();
        let place = |steps| place_of(steps, run.cpu_at(steps));
        evaluations.filter_map(|point| Some((place(point.steps)?, point.all.mean))).collect()
    };
    let lines: Vec<Line> = curves
        .iter()
        .map(|(group, points)| Line {
            label: label_with_runs(comparison, group),
            look: looks.of(&group.label()),
            points: points.iter().filter_map(|point| Some(point_of(place(point)?, &point.returns, group))).collect(),
            companion: points.iter().filter_map(|point| Some((place(point)?, point.median_agent))).collect(),
            seeds: seeds(group, &of_run),
        })
        .filter(|line| !line.points.is_empty())
        .collect();
    if lines.is_empty() {
        return Ok(None);
    }
    let (x, marks, what) = match against {
        Against::Timesteps => (steps_axis(), paper_marks(comparison, &curves, looks), "timesteps"),
        Against::CpuTime => {
            let label = format!("CPU time of all processes, without evaluations, {unit}");
            (Axis { label, format: plain }, Vec::new(), "CPU time")
        }
    };
    let chart = LineChart {
        title: format!("{}: return by {what}", comparison.heading()),
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

/// Returns the curves of the single runs, if they are several, but too few for an interval.
fn seeds(group: &Group, curve: &dyn Fn(&RunRecord) -> Vec<(f64, f64)>) -> Vec<Vec<(f64, f64)>> {
    if shows_seeds(group.runs.len()) { group.runs.iter().map(curve).collect() } else { Vec::new() }
}

/// Draws a chart, explained in its note. Many lines get panels beside the reference, or else lose bands and seeds.
fn draw(mut chart: LineChart, comparison: &Comparison, looks: &Looks) -> Result<Svg> {
    let note = (!chart.note.is_empty(), chart.note.as_str());
    let without_bands = joined(&[(true, "intervals and seeds: in the CSV files"), note]);
    let bands = chart.lines.iter().flat_map(|line| &line.points).any(|point| point.band.is_some());
    let seeds = chart.lines.iter().any(|line| !line.seeds.is_empty());
    chart.note = joined(&[
        (bands, "band: 95\u{a0}% Student's t interval over seeds"),
        (seeds, &format!("pale lines: single seeds, if fewer than {ENOUGH_SEEDS}")),
        note,
    ]);
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
    LineChart { companions: None, note: without_bands, ..chart }.draw()
}

fn point_of(x: f64, spread: &Spread, group: &Group) -> LinePoint {
    LinePoint { x, y: spread.mean, band: spread.interval.map(ends), whole: spread.runs() == group.runs.len() }
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
        name: "hand-coded".to_owned(),
        y,
        measured: false,
    });
    measured.chain(paper).collect()
}

/// Returns the paper's points within the steps that are drawn, for each of its methods that has a curve here.
fn paper_marks(comparison: &Comparison, curves: &[(&Group, Vec<CurvePoint>)], looks: &Looks) -> Vec<Mark> {
    let last = curves.iter().filter_map(|(_, points)| points.last()).map(|point| point.steps).max().unwrap_or(0);
    let (mut methods, mut marks) = (Vec::new(), Vec::new());
    for (group, _) in curves {
        let method = (group.simulator(), group.method.retraining);
        let mut points = paper::curve(&comparison.scenario, group.simulator(), group.method.retraining);
        points.retain(|point| point.steps as f64 <= 1.02 * last as f64);
        if points.iter().any(|point| point.steps > 0) && !methods.contains(&method) {
            methods.push(method);
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

/// Draws the cross-entropy of the AIPs of a scenario; `None` if no AIP was trained.
pub(crate) fn cross_entropy(comparison: &Comparison, looks: &Looks) -> Result<Option<Svg>> {
    let trained = comparison.groups.iter().filter(|group| group.simulator() != "untrained-dials");
    let curve = |group| {
        let (data, mut points) = loss_curve(group);
        points.retain(|point| is_trained(point.steps, point.after_training));
        (!points.is_empty()).then_some((group, data, points))
    };
    let curves: Vec<(&Group, LossData, Vec<LossPoint>)> = trained.filter_map(curve).collect();
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
        seeds: seeds(group, &|run| losses_of_run(run, *data)),
    });
    let evaluated = comparison.runs().filter_map(|run| Some(run.evaluations.last()?.steps));
    let fresh = "on fresh GS episodes at evaluations";
    let held_out = "on held-out episodes, before and after each training";
    let of = |data| curves.iter().any(|(_, of, _)| *of == data);
    let note = match (of(LossData::Fresh), of(LossData::HeldOut)) {
        (true, false) => fresh.to_owned(),
        (false, _) => held_out.to_owned(),
        (true, true) => format!("{fresh}; if that was not measured: {held_out}"),
    };
    let chart = LineChart {
        title: format!("{}: loss of the AIPs", comparison.heading()),
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

fn losses_of_run(run: &RunRecord, data: LossData) -> Vec<(f64, f64)> {
    let losses = measured(run, data).into_iter();
    let trained = losses.filter(|((steps, after_training), _)| is_trained(*steps, *after_training));
    trained.map(|((steps, _), [loss, _])| (steps as f64, loss)).collect()
}
