//! The chart of wall time by number of cores.

use anyhow::Result;

use super::{comparable, time_unit};
use crate::chart::{Axis, Line, LineChart, LinePoint, Look, Looks, Mark, Marker};
use crate::cores::{ByCores, by_cores};
use crate::drawing::{INK, Svg};
use crate::group::{Comparison, Group};
use crate::paper;
use dials_session::records::method::steps_text;

/// Draws the model of the wall time of every method, with the measured points and the paper's; `None` if no run
/// measured CPU time.
pub(crate) fn time_by_cores(comparison: &Comparison, looks: &Looks) -> Result<Option<Svg>> {
    let all = by_cores(comparison);
    let Some((_, first)) = all.first() else { return Ok(None) };
    let steps = first.steps;
    let (unit, unit_s) = time_unit(all.iter().map(|(_, model)| model.cpu.seconds(1)).fold(0.0, f64::max));
    // One doubling beyond the number of agents, to show that nothing changes there.
    let last = comparison.scenario.agents.next_power_of_two().ilog2() + 1;
    let lines = all.iter().map(|(group, model)| Line {
        label: format!("{}, model", comparison.short_label(group)),
        look: looks.of(&group.label()),
        points: (0..=last).map(|power| point(f64::from(power), model.cpu.seconds(1 << power) / unit_s)).collect(),
        companion: Vec::new(),
        seeds: Vec::new(),
    });
    let mut marks: Vec<Mark> =
        all.iter().map(|(group, model)| measured(comparison, group, model, unit_s, looks)).collect();
    marks.extend(all.iter().filter_map(|(group, model)| of_the_paper(comparison, group, model, unit_s, looks)));
    let chart = LineChart {
        title: format!("{}: wall time by number of cores, {} timesteps", comparison.heading(), steps_text(steps)),
        x: Axis { label: "cores".to_owned(), format: power_of_two },
        y: Axis { label: format!("{unit} without evaluations"), format: any_power },
        lines: lines.collect(),
        companions: None,
        levels: Vec::new(),
        marks,
        x_end: f64::from(last),
        note: "a model: measured CPU time, spread over the cores, at most one core per agent; the GS shares gradient \
               steps only"
            .to_owned(),
    };
    chart.draw().map(Some)
}

/// Returns a point of the chart. Both axes are logarithms to base 2.
fn point(power: f64, time: f64) -> LinePoint {
    LinePoint { x: power, y: time.log2(), band: None, whole: true }
}

fn measured(comparison: &Comparison, group: &Group, model: &ByCores, unit_s: f64, looks: &Looks) -> Mark {
    let points = model.measured.iter().map(|(&workers, seconds)| {
        let LinePoint { x, y, .. } = point((workers as f64).log2(), seconds / unit_s);
        (x, y, None)
    });
    Mark {
        label: format!("{}, measured", comparison.short_label(group)),
        look: looks.of(&group.label()),
        points: points.collect(),
    }
}

/// Returns the paper's hours. Its GS is one process, and DIALS has one process per agent.
fn of_the_paper(comparison: &Comparison, group: &Group, model: &ByCores, unit_s: f64, looks: &Looks) -> Option<Mark> {
    let (simulator, retraining) = (group.simulator(), group.method.retraining);
    if !group.overrides.is_empty() || !comparable(model.steps, paper::STEPS) {
        return None;
    }
    let time = paper::runtime(&comparison.scenario, simulator, retraining)?;
    let cores = if simulator == "gs" { 1 } else { comparison.scenario.agents };
    let LinePoint { x, y, .. } = point((cores as f64).log2(), time.total * 3600.0 / unit_s);
    Some(Mark {
        label: format!("{}, the paper", group.name()),
        look: Look { colour: INK, marker: Marker::Diamond, ..looks.of(&group.label()) },
        points: vec![(x, y, None)],
    })
}

/// Writes whole powers of two, and two digits of what lies between: a narrow axis has hardly any whole power.
fn any_power(power: f64) -> String {
    match power_of_two(power) {
        whole if !whole.is_empty() => whole,
        _ => {
            let value = power.exp2();
            let last = value.log10().floor() as i32 - 1;
            let digit = 10.0_f64.powi(last);
            format!("{:.*}", (-last).max(0) as usize, (value / digit).round() * digit)
        }
    }
}

/// Writes whole powers of two only: there is no half core.
fn power_of_two(power: f64) -> String {
    if (power - power.round()).abs() > 0.01 {
        return String::new();
    }
    let value = power.round().exp2();
    if value >= 1.0 { format!("{value:.0}") } else { format!("1/{:.0}", 1.0 / value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_between_two_powers_of_two_has_two_digits() {
        let texts = [-1.0, 0.5, 4.75, 5.0, 7.5].map(any_power);
        assert_eq!(texts, ["1/2", "1.4", "27", "32", "180"]);
        assert_eq!(power_of_two(4.75), "");
    }
}
