//! How much CPU time a method needs until it is as good as a hand-coded controller.

use super::document::Table;
use super::group::{Comparison, Group};
use super::tables::NOTHING;
use dials_core::base::statistics::mean;
use dials_session::records::run_record::RunRecord;

/// Makes the table of CPU seconds to the level of each controller that was measured. `None` if there is none, or if no curve has
/// two points.
pub(crate) fn table(comparison: &Comparison) -> Option<Table> {
    let mut levels: Vec<(&str, f64)> =
        comparison.baselines.iter().map(|baseline| (baseline.controller.as_str(), baseline.mean_return)).collect();
    let has_curve = |group: &&Group| group.runs.iter().any(|run| curve(run).len() > 1);
    let groups: Vec<&Group> = comparison.groups.iter().filter(has_curve).collect();
    if levels.is_empty() || groups.is_empty() {
        return None;
    }
    levels.sort_by(|(_, one), (_, other)| one.total_cmp(other));
    let row = |group: &&Group| {
        let cells = levels.iter().map(|&(_, level)| {
            let reached: Vec<f64> = group.runs.iter().filter_map(|run| seconds_to(&curve(run), level)).collect();
            match (reached.len(), group.runs.len()) {
                (0, _) => NOTHING.to_owned(),
                (some, all) if some < all => format!("{:.0} ({some} of {all})", mean(&reached)),
                _ => format!("{:.0}", mean(&reached)),
            }
        });
        [group.label(), group.runs.len().to_string()].into_iter().chain(cells).collect()
    };
    let of_levels = levels.iter().map(|(controller, _)| (*controller).to_owned());
    Some(Table {
        caption: format!(
            "CPU seconds to the level of a controller, {}: all processes, without evaluations, mean over the seeds that reach it. \
             \"2 of 3\" says how many do.",
            comparison.title
        ),
        header: ["method", "n"].map(str::to_owned).into_iter().chain(of_levels).collect(),
        rows: groups.iter().map(row).collect(),
    })
}

/// Returns CPU time in seconds and mean return at each evaluation.
fn curve(run: &RunRecord) -> Vec<(f64, f64)> {
    run.evaluations.iter().filter_map(|point| Some((run.cpu_at(point.steps)?, point.all.mean))).collect()
}

/// Returns the CPU time at which a curve first reaches a level, interpolated.
fn seconds_to(curve: &[(f64, f64)], level: f64) -> Option<f64> {
    let first = curve.iter().position(|&(_, reached)| reached >= level)?;
    let (end_s, end) = curve[first];
    let Some(&(begin_s, begin)) = first.checked_sub(1).map(|before| &curve[before]) else { return Some(end_s) };
    Some(begin_s + (end_s - begin_s) * (level - begin) / (end - begin))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_is_reached_between_two_evaluations_at_the_first_one_or_never() {
        let curve = [(0.0, 10.0), (20.0, 10.0), (30.0, 30.0), (40.0, 20.0), (50.0, 40.0)];
        assert_eq!(
            [5.0, 25.0, 35.0, 41.0].map(|level| seconds_to(&curve, level)),
            [Some(0.0), Some(27.5), Some(47.5), None]
        );
    }
}
