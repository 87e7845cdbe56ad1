//! Formats of numbers, and warnings about runs that are missing, unfinished or not comparable.

use std::collections::{BTreeMap, BTreeSet};

use super::group::{Comparison, Sorted};
use dials_core::base::statistics::difference::{Difference, Pairing};
use dials_core::base::statistics::{Bounds, ENOUGH_SEEDS, Spread};
use dials_core::base::{counted, decimals};
use dials_core::outside::Printable;
use dials_session::records::find::{BaselineRecord, LeftOut};
use dials_session::records::method::steps_text;
use dials_session::records::run_record::Status;

/// Writes a return, with more decimals the smaller it is.
pub(crate) fn figure(value: f64) -> String {
    figure_like(value, value)
}

/// Writes a number with its sign and with the decimals of the return `like`.
pub(crate) fn signed(value: f64, like: f64) -> String {
    let size = figure_like(value.abs(), like);
    // A rounded zero has no minus sign.
    let negative = value < 0.0 && size.bytes().any(|digit| (b'1'..=b'9').contains(&digit));
    format!("{}{size}", if negative { "-" } else { "+" })
}

/// Writes a number with the decimals of the return `like`.
pub(crate) fn figure_like(value: f64, like: f64) -> String {
    let digits = decimals(like, None);
    format!("{value:.digits$}")
}

/// Writes a mean and its standard error, if there is one: `217.4 ± 1.2`.
pub(crate) fn with_error(mean: f64, std_error: Option<f64>) -> String {
    let Some(error) = std_error else { return figure(mean) };
    let digits = decimals(mean, std_error).min(decimals(mean, None));
    format!("{mean:.digits$} ± {error:.digits$}")
}

/// Writes an interval with the decimals of the return `like`: `[215.1, 219.7]`.
pub(crate) fn interval(interval: Option<Bounds>, like: f64) -> String {
    let ends = |Bounds { low, high }| format!("[{}, {}]", figure_like(low, like), figure_like(high, like));
    interval.map_or("-".to_owned(), ends)
}

/// Writes the interval of a difference: `[+1.2, +3.4]`.
pub(crate) fn signed_interval(Bounds { low, high }: Bounds, like: f64) -> String {
    format!("[{}, {}]", signed(low, like), signed(high, like))
}

/// Writes how certain a mean over seeds is: `95 % [215.1, 219.7]`, or with few seeds their values.
pub(crate) fn certainty(spread: &Spread) -> String {
    let values = spread.values.iter().map(|value| figure_like(*value, spread.mean));
    match spread.interval {
        Some(_) => format!("95 % {}", interval(spread.interval, spread.mean)),
        None if spread.runs() == 1 => "one seed".to_owned(),
        None => format!("seeds: {}", values.collect::<Vec<_>>().join(", ")),
    }
}

/// Writes a difference with its 95 % interval, `+4.1 [+1.2, +7.0]`, or with few seeds, `+4.1 (n = 3: +3.0, +5.0,
/// +4.3)`. `like`: a return, for the decimals.
pub(crate) fn difference(of: &Difference, like: f64) -> String {
    let mean = signed(of.mean, like);
    let seeds = of.seeds[0].min(of.seeds[1]);
    let own: Vec<String> = of.of_seeds.iter().map(|(_, value)| signed(*value, like)).collect();
    let other = if of.pairing.by_episode() { "" } else { ", other episodes" };
    match of.interval {
        Some(ends) => format!("{mean} {}{other}", signed_interval(ends, like)),
        None if of.seeds[0] != of.seeds[1] => format!("{mean} (n = {} and {}{other})", of.seeds[0], of.seeds[1]),
        None if own.is_empty() || seeds == 1 || seeds >= ENOUGH_SEEDS => format!("{mean} (n = {seeds}{other})"),
        None => format!("{mean} (n = {seeds}: {}{other})", own.join(", ")),
    }
}

/// Says how two sides were paired before they were subtracted.
pub(crate) fn pairing(pairing: Pairing) -> &'static str {
    match pairing {
        Pairing::EpisodeAndSeed => "paired by episode and by seed",
        Pairing::Episode => "paired by episode",
        Pairing::Seed => "paired by seed, not by episode",
        Pairing::Nothing => "not paired",
    }
}

/// Writes seconds as hours, with two decimals, or with four below 0.1 hours.
pub(crate) fn hours(seconds: f64) -> String {
    let hours = seconds / 3600.0;
    if hours < 0.1 { format!("{hours:.4}") } else { format!("{hours:.2}") }
}

/// Writes seconds in a readable unit: `42 s`, `3.4 min`, `2.1 h`.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// Lists everything that a reader must know before trusting a figure.
pub(crate) fn warnings(Sorted { comparisons, missing, left_out }: &Sorted) -> Vec<String> {
    let mut warnings = Vec::new();
    warnings.extend(missing.iter().map(|run| format!("{}: not begun yet", Printable(run.display()))));
    warnings.extend(left_out.iter().map(LeftOut::to_string));
    for comparison in comparisons {
        let all_seeds: BTreeSet<u64> = comparison.groups.iter().flat_map(|group| group.seeds()).collect();
        for group in &comparison.groups {
            let furthest = group.finals().map_or(0, |(steps, _)| steps);
            for run in &group.runs {
                let (place, planned) = (Printable(run.dir.display()), steps_text(run.config.learning.last_step()));
                match run.status() {
                    Status::Unfinished { steps } => {
                        let trained = run.trained_to();
                        // It may have gone on since its last evaluation.
                        let since = match trained > steps {
                            true => format!(", last evaluated at {}", steps_text(steps)),
                            false => String::new(),
                        };
                        let at = steps_text(trained);
                        warnings.push(format!("{place}: unfinished, at {at} of {planned} steps{since}"));
                    }
                    Status::Empty => warnings.push(format!("{place}: not evaluated yet")),
                    Status::Finished if run.return_at(furthest).is_none() => warnings.push(format!(
                        "{place}: ended at {planned} steps, earlier than the others of its group: shown in curves only"
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
        warnings.extend(of_episodes(comparison));
        let of_runs = comparison.runs().flat_map(|run| run.about.sumo());
        let versions = of_runs.chain(comparison.baselines.iter().filter_map(BaselineRecord::sumo));
        warnings.extend(of_versions(versions).map(|warning| format!("{}: {warning}", comparison.title)));
    }
    warnings
}

/// Returns a warning if there are several versions of SUMO among these: those of each run and of each controller.
pub(crate) fn of_versions<'a>(versions: impl Iterator<Item = &'a str>) -> Option<String> {
    let mut counts = BTreeMap::new();
    versions.for_each(|version| *counts.entry(version).or_insert(0) += 1);
    let list: Vec<String> = counts.iter().map(|(version, count)| format!("{count} with {version}")).collect();
    (list.len() > 1).then(|| {
        let list = list.join(", ");
        format!(
            "computed with several versions of SUMO ({list}); the same lights may have other returns on each of them"
        )
    })
}

/// Lists groups whose runs played different episodes, or other episodes than their opponents.
fn of_episodes(comparison: &Comparison) -> Vec<String> {
    let ends: Vec<_> = comparison.ends().into_iter().map(|(group, end)| (group, group.label(), end)).collect();
    let title = &comparison.title;
    let different = ends.iter().filter(|(_, _, end)| end.episodes().is_none());
    let mut warnings: Vec<String> = different
        .map(|(_, label, _)| format!("{title}, {label}: its runs were evaluated on different episodes"))
        .collect();
    for opponent in comparison.opponents() {
        let whom = opponent.name();
        let (mut unpaired, mut cut) = (Vec::new(), Vec::new());
        for (group, label, end) in &ends {
            let Some(found) = opponent.difference(group, end) else { continue };
            match found.episodes {
                None => unpaired.push(label.as_str()),
                Some(shared) if end.episodes() != Some(shared) || opponent.episodes() != Some(shared) => {
                    cut.push(format!("{label} (the first {})", counted(shared.count, "episode")));
                }
                Some(_) => {}
            }
        }
        if !unpaired.is_empty() {
            warnings.push(format!(
                "{title}: not evaluated on the episodes of {whom}, so the difference is over seeds only and includes the \
                 randomness of the traffic (another evaluation.seed): {}",
                unpaired.join("; ")
            ));
        }
        if !cut.is_empty() {
            warnings.push(format!(
                "{title}: evaluated on more or fewer episodes than {whom}, so the difference is over those that both have: {}",
                cut.join("; ")
            ));
        }
    }
    warnings
}

const MOST_REASONS: usize = 3;

/// Writes the error for folders without a run that was evaluated and can be read. `warnings`: those of [`warnings`].
pub(crate) fn no_run(folders: &str, warnings: &[String]) -> String {
    let mut lines = vec![format!("{folders}: no run in it was evaluated and can be read:")];
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
        let reasons: Vec<String> = (1..=5).map(|run| format!("{run}: not evaluated yet")).collect();
        let error = no_run("runs", &reasons);
        assert!(error.ends_with("\n  3: not evaluated yet\n  and 2 more"), "{error}");
    }

    #[test]
    fn several_versions_of_sumo_are_one_warning_with_their_counts() {
        assert_eq!(of_versions(["SUMO 1.15.0"; 3].into_iter()), None);
        let warning = of_versions(["SUMO 1.28.0", "SUMO 1.15.0", "SUMO 1.28.0"].into_iter()).unwrap();
        assert!(warning.contains("(1 with SUMO 1.15.0, 2 with SUMO 1.28.0)"), "{warning}");
    }

    #[test]
    fn numbers_are_written_as_precisely_as_they_are_known() {
        assert_eq!(with_error(217.44, Some(1.16)), "217.4 ± 1.2");
        assert_eq!(with_error(13.086, Some(0.03)), "13.09 ± 0.03");
        assert_eq!(with_error(13.086, None), "13.09");
        assert_eq!([signed(-3.0, 200.0), signed(0.456, 13.0), signed(-0.04, 200.0)], ["-3.0", "+0.46", "+0.0"]);
        assert_eq!(with_error(-1.043, Some(0.012)), "-1.043 ± 0.012");
        assert_eq!([42.0, 204.0, 7560.0].map(duration), ["42 s", "3.4 min", "2.1 h"]);
        let steps = [4_000_128, 1_500_000, 150_016, 12_500, 128, 0];
        assert_eq!(steps.map(steps_text), ["4M", "1.5M", "150K", "12.5K", "128", "0"]);
    }

    #[test]
    fn the_differences_of_many_seeds_without_an_interval_are_not_listed() {
        let (pairing, of_seeds) = (Pairing::Nothing, (1..=6).map(|seed| (seed, 2.0)).collect());
        let found = Difference { mean: 2.0, pairing, episodes: None, seeds: [6; 2], of_seeds, interval: None };
        assert_eq!(difference(&found, 200.0), "+2.0 (n = 6, other episodes)");
    }
}
