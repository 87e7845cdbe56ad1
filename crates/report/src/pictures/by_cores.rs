//! The chart of wall time by number of cores.

use anyhow::Result;

use super::{comparable, time_unit};
use crate::chart::{Axis, Line, LineChart, LinePoint, Look, Looks, Mark, Marker};
use crate::cores::by_cores;
use crate::drawing::{INK, Svg};
use crate::group::Comparison;
use crate::paper;
use dials_session::records::method::steps_text;

/// Draws models, measured points and the paper's; `None` if no run measured CPU time.
pub(crate) fn time_by_cores(comparison: &Comparison, looks: &Looks) -> Result<Option<Svg>> {
    let all = by_cores(comparison);
    let Some((_, first)) = all.first() else { return Ok(None) };
    let steps = first.steps;
    let (unit, unit_s) = time_unit(all.iter().map(|(_, model)| model.cpu.seconds(1)).fold(0.0, f64::max));
    // One doubling beyond the number of agents, to show that nothing changes there.
    let last = comparison.scenario.agents.next_power_of_two().ilog2() + 1;
    // Both axes are logarithms to base 2.
    let place = |cores: f64, seconds: f64| (cores.log2(), (seconds / unit_s).log2());
    let lines = all.iter().map(|(group, model)| Line {
        label: format!("{}, model", comparison.short_label(group)),
        look: looks.of(&group.label()),
        points: (0..=last)
            .map(|power| {
                let (x, y) = place(f64::from(1 << power), model.cpu.seconds(1 << power));
                LinePoint { x, y, band: None, whole: true }
            })
            .collect(),
        companion: Vec::new(),
        seeds: Vec::new(),
    });
    let measured = all.iter().map(|(group, model)| Mark {
        label: format!("{}, measured", comparison.short_label(group)),
        look: looks.of(&group.label()),
        points: model
            .measured
            .iter()
            .map(|(&workers, &seconds)| place(workers as f64, seconds))
            .map(|(x, y)| (x, y, None))
            .collect(),
    });
    // The paper's GS is one process, and its DIALS has one process per agent.
    let of_paper = all.iter().filter_map(|(group, model)| {
        let simulator = group.simulator();
        let time = paper::runtime(&comparison.scenario, simulator, group.method.retraining)
            .filter(|_| group.overrides.is_empty() && comparable(model.steps, paper::STEPS))?;
        let cores = if simulator == "gs" { 1 } else { comparison.scenario.agents };
        let (x, y) = place(cores as f64, time.total * 3600.0);
        Some(Mark {
            label: format!("{}, the paper", group.name()),
            look: Look { colour: INK, marker: Marker::Diamond, ..looks.of(&group.label()) },
            points: vec![(x, y, None)],
        })
    });
    let marks = measured.chain(of_paper).collect();
    let chart = LineChart {
        title: format!("{}: wall time by number of cores, {} timesteps", comparison.heading(), steps_text(steps)),
        x: Axis { label: "cores".to_owned(), format: power_of_two },
        y: Axis { label: format!("{unit} without evaluations"), format: any_power },
        lines: lines.collect(),
        companions: None,
        levels: Vec::new(),
        marks,
        x_end: f64::from(last),
        note:
            "a model: measured CPU time, spread over the cores, at most one core per agent or copy of the GS; a single \
               GS shares gradient steps only"
                .to_owned(),
    };
    chart.draw().map(Some)
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
