//! Several players in one table, as text.

use super::{Finding, figures};
use crate::policy::Selection;
use dials_core::base::statistics::Interval;
use dials_core::base::{TERMINAL_COLUMNS, decimals, wrapped};

/// Values of all episodes, by name of the figure.
type Figures = Vec<(String, Vec<f64>)>;

/// Returns a table of several players, one line each, and a table of their differences from the first player.
pub fn comparison(findings: &[Finding]) -> String {
    let figures: Vec<Figures> = findings.iter().map(|finding| figures(&finding.episodes)).collect();
    let names: Vec<&str> = figures[0].iter().map(|(name, _)| name.as_str()).collect();
    let labels: Vec<String> = findings.iter().map(|finding| finding.player.label.clone()).collect();
    let means: Vec<Vec<String>> =
        figures.iter().map(|figures| figures.iter().map(|(_, values)| cell(Interval::of(values))).collect()).collect();
    let title = wide_title(findings);
    let mut text = format!("{title}\n{}", blocks(&names, &labels, &means));
    if let [reference, others @ ..] = &figures[..]
        && !others.is_empty()
    {
        // Skip figures that are the same for all.
        let differs = |column: &usize| others.iter().any(|figures| figures[*column] != reference[*column]);
        let columns: Vec<usize> = (0..names.len()).filter(differs).collect();
        let names: Vec<&str> = columns.iter().map(|&column| names[column]).collect();
        let of_player = |figures: &Figures| -> Vec<String> {
            columns.iter().map(|&column| difference(&figures[column].1, &reference[column].1)).collect()
        };
        let differences: Vec<Vec<String>> = others.iter().map(of_player).collect();
        let table = match columns.is_empty() {
            true => "no figure differs in any episode".to_owned(),
            false => blocks(&names, &labels[1..], &differences),
        };
        text += &format!("\n\ndifference from {} (paired by episode)\n{table}", labels[0]);
    }
    text
}

/// Returns what the numbers of these players are.
pub(super) fn wide_title(findings: &[Finding]) -> String {
    let policies = match findings.iter().find_map(|finding| finding.player.policies) {
        Some(Selection::Greedy) => ", greedy policies",
        Some(Selection::Sampled) => ", sampled policies",
        None => "",
    };
    let title = match findings[0].episodes.len() {
        1 => format!("one episode, the same traffic for all{policies}"),
        played => {
            format!("mean +- half of its 95 % interval over {played} episodes, the same traffic for all{policies}")
        }
    };
    wrapped(&title, TERMINAL_COLUMNS).join("\n")
}

/// Returns the mean difference, episode by episode, with its sign.
pub(super) fn difference(values: &[f64], reference: &[f64]) -> String {
    signed(Interval::of_differences(values, reference))
}

/// Returns a difference as [`cell`] does, with its sign.
pub fn signed(difference: Interval) -> String {
    let cell = cell(difference);
    if cell.starts_with('-') { cell } else { format!("+{cell}") }
}

/// Returns a mean with the half-width of its interval, such as `215.7 +- 2.3`.
pub fn cell(Interval { mean, half_width }: Interval) -> String {
    let digits = decimals(mean, half_width);
    match half_width {
        // All values are the same, or there is only one.
        None | Some(0.0) => format!("{mean:.digits$}"),
        Some(half_width) => format!("{mean:.digits$} +- {half_width:.digits$}"),
    }
}

/// Letters of a label that stands in the line of its cells. A longer one, such as the name of a light of a real map,
/// has a line of its own.
const LABEL_COLUMNS: usize = 40;

/// Returns a table with one line per label. If it is wider than [`TERMINAL_COLUMNS`], its columns are split into
/// several tables.
pub(super) fn blocks(names: &[&str], labels: &[String], cells: &[Vec<String>]) -> String {
    let label_widths = labels.iter().map(|label| label.chars().count());
    let label_width = label_widths.filter(|&width| width <= LABEL_COLUMNS).max().unwrap_or(0);
    let widths: Vec<usize> = (0..names.len())
        .map(|column| cells.iter().map(|line| line[column].len()).chain([names[column].len()]).max().unwrap_or(0))
        .collect();
    let mut blocks = Vec::new();
    let mut begin = 0;
    while begin < names.len() {
        let mut end = begin;
        let mut width = label_width;
        while end < names.len() && (end == begin || width + 2 + widths[end] <= TERMINAL_COLUMNS) {
            width += 2 + widths[end];
            end += 1;
        }
        let line = |label: &str, cells: &[&str]| {
            let (own_line, label) =
                if label.chars().count() > label_width { (format!("{label}\n"), "") } else { (String::new(), label) };
            let cells = cells.iter().zip(&widths[begin..end]).map(|(cell, width)| format!("  {cell:>width$}"));
            format!("{own_line}{label:<label_width$}{}", cells.collect::<String>())
        };
        let mut lines = vec![line("", &names[begin..end])];
        for (label, cells) in labels.iter().zip(cells) {
            lines.push(line(label, &cells[begin..end].iter().map(String::as_str).collect::<Vec<_>>()));
        }
        blocks.push(lines.join("\n"));
        begin = end;
    }
    blocks.join("\n\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_label_has_a_line_of_its_own() {
        let long = "cluster_".repeat(8);
        let table = blocks(
            &["return", "delay"],
            &[long.clone(), "J".to_owned()],
            &[1, 2].map(|line| vec![format!("{line}.5"), format!("{line}7.0")]),
        );
        assert_eq!(table, format!("   return  delay\n{long}\n      1.5   17.0\nJ     2.5   27.0"));
    }
}
