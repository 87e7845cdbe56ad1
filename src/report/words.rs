//! How numbers are written, and what has to be said of runs that are not what they should be.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::find::LeftOut;
use super::group::{Comparison, steps_text};
use super::run_dir::Status;
use super::statistics::Bounds;

/// A return: one decimal for traffic, two for the warehouse.
pub fn figure(value: f64) -> String {
    if value.abs() >= 50.0 { format!("{value:.1}") } else { format!("{value:.2}") }
}

/// With its sign, and as many decimals as `like` has as a return.
pub fn signed(value: f64, like: f64) -> String {
    format!("{}{}", if value < 0.0 { "-" } else { "+" }, figure_like(value.abs(), like))
}

/// As many decimals as `like` has as a return.
fn figure_like(value: f64, like: f64) -> String {
    if like.abs() >= 50.0 { format!("{value:.1}") } else { format!("{value:.2}") }
}

/// `217.4 ± 1.2`
pub fn with_error(mean: f64, std_error: Option<f64>) -> String {
    std_error.map_or(figure(mean), |error| format!("{} ± {}", figure(mean), figure_like(error, mean)))
}

/// `[215.1, 219.7]`, with as many decimals as `like` has as a return.
pub fn interval(interval: Option<Bounds>, like: f64) -> String {
    let ends = |Bounds { low, high }| format!("[{}, {}]", figure_like(low, like), figure_like(high, like));
    interval.map_or("-".to_owned(), ends)
}

/// Hours with two significant decimals where there are few of them.
pub fn hours(seconds: f64) -> String {
    let hours = seconds / 3600.0;
    if hours < 0.1 { format!("{hours:.4}") } else { format!("{hours:.2}") }
}

/// `42 s`, `3.4 min`, `2.1 h`
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// What a reader must know before believing a figure.
pub fn warnings(comparisons: &[Comparison], missing: &[PathBuf], left_out: &[LeftOut]) -> Vec<String> {
    let mut warnings = Vec::new();
    warnings.extend(missing.iter().map(|run| format!("{}: not begun yet", run.display())));
    warnings.extend(left_out.iter().map(LeftOut::to_string));
    for comparison in comparisons {
        let all_seeds: BTreeSet<u64> = comparison.groups.iter().flat_map(|group| group.seeds()).collect();
        for group in &comparison.groups {
            let furthest = group.finals().map_or(0, |(steps, _)| steps);
            for run in &group.runs {
                let (place, planned) = (run.dir.display(), steps_text(run.config.last_step()));
                match run.status() {
                    Status::Unfinished { steps } => {
                        warnings.push(format!("{place}: unfinished, at {} of {planned} steps", steps_text(steps)));
                    }
                    Status::Empty => warnings.push(format!("{place}: not evaluated yet")),
                    Status::Finished if run.return_at(furthest).is_none() => warnings.push(format!(
                        "{place}: ended at {planned} steps, before the others of its group: in the curves only"
                    )),
                    Status::Finished => {}
                }
            }
            let seeds: BTreeSet<u64> = group.seeds().into_iter().collect();
            let absent: Vec<String> = all_seeds.difference(&seeds).map(u64::to_string).collect();
            if !absent.is_empty() {
                let (scenario, label) = (&comparison.title, group.label());
                warnings.push(format!("{scenario}, {label}: no run with seed {}", absent.join(", ")));
            }
        }
    }
    warnings
}

/// The most reasons that an error lists.
const MOST_REASONS: usize = 3;

/// What to say of folders without one run that was evaluated and can be read; `warnings` are those of [`warnings`].
pub fn no_run(folders: &str, warnings: &[String]) -> String {
    let mut lines = vec![format!("{folders}: has no run that was evaluated and can be read:")];
    lines.extend(warnings.iter().take(MOST_REASONS).cloned());
    let more = warnings.len().saturating_sub(MOST_REASONS);
    lines.extend((more > 0).then(|| format!("and {more} more")));
    lines.join("\n  ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_about_many_runs_lists_the_first_few() {
        let reasons: Vec<String> = (1..=5).map(|run| format!("runs/{run}: not evaluated yet")).collect();
        let head = "runs: has no run that was evaluated and can be read:\n  runs/1: not evaluated yet";
        assert_eq!(no_run("runs", &reasons[..1]), head);
        let told = no_run("runs", &reasons);
        assert!(told.starts_with(head) && told.ends_with("\n  runs/3: not evaluated yet\n  and 2 more"), "{told}");
    }

    #[test]
    fn numbers_are_written_as_precisely_as_they_are_known() {
        assert_eq!(with_error(217.44, Some(1.16)), "217.4 ± 1.2");
        assert_eq!(with_error(13.086, Some(0.03)), "13.09 ± 0.03");
        assert_eq!(with_error(13.086, None), "13.09");
        assert_eq!((signed(-3.0, 200.0).as_str(), signed(0.456, 13.0).as_str()), ("-3.0", "+0.46"));
        assert_eq!((hours(3600.0).as_str(), hours(90.0).as_str()), ("1.00", "0.0250"));
        assert_eq!([42.0, 204.0, 7560.0].map(duration), ["42 s", "3.4 min", "2.1 h"]);
    }
}
