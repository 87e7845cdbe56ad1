//! How controllers fare with another demand or with closed roads: the table that `evaluate` and `baseline` write with `--demand` and
//! `--closed`.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use super::page::{NOTHING, with_error};
use super::read::Figure;
use super::roles::TODAY;
use crate::document::{Block, Table};
use dials_core::base::counted;
use dials_core::domain::light_figures::TODAYS_PLAN;

/// Name of that file.
pub const VARIANTS: &str = "variants.csv";

/// A line of it: a controller on one variant.
#[derive(Debug, Deserialize)]
struct Line {
    controller: String,
    demand: String,
    closed: String,
    /// Names of the streets of the closed edges. Older files have none.
    #[serde(default)]
    streets: String,
    delay_s: f64,
    half_width_95: Option<f64>,
    // Older files have neither of these.
    #[serde(default)]
    throughput_per_h: Option<f64>,
    #[serde(default)]
    episodes: Option<usize>,
}

/// Returns the section about the variants in a folder. There is no such file: none.
pub(super) fn blocks(folder: &Path, title: String) -> Result<Vec<Block>> {
    if !folder.join(VARIANTS).is_file() {
        return Ok(Vec::new());
    }
    let lines = read(folder)?;
    let played = lines.first().and_then(|line| line.episodes);
    let of = played.map_or(String::new(), |played| format!(", means over {}", counted(played, "episode")));
    let delay = |line: &Line| Some(with_error(Figure { mean: line.delay_s, half_width_95: line.half_width_95 }));
    let delays =
        table(format!("Delay in seconds per car with another demand, or with roads closed{of}."), &lines, delay);
    let arrived = |line: &Line| line.throughput_per_h.map(|cars| format!("{cars:.0}"));
    let arrivals = lines.iter().any(|line| line.throughput_per_h.is_some());
    let arrivals = arrivals.then(|| table(format!("Cars that arrive per hour{of}."), &lines, arrived));
    Ok([Block::Heading(title), Block::Table(delays)].into_iter().chain(arrivals.map(Block::Table)).collect())
}

fn read(folder: &Path) -> Result<Vec<Line>> {
    let path = folder.join(VARIANTS);
    let lines = csv::Reader::from_path(&path).and_then(|reader| reader.into_deserialize().collect());
    let lines: Vec<Line> = lines.with_context(|| format!("{}: make it again with --csv", path.display()))?;
    ensure!(!lines.is_empty(), "{}: has no line; make it again with --csv", path.display());
    Ok(lines)
}

/// Makes a table with a line per controller and a column per variant.
fn table(caption: String, lines: &[Line], cell: impl Fn(&Line) -> Option<String>) -> Table {
    let mut header = vec![String::new()];
    let mut rows: Vec<Vec<String>> = Vec::new();
    for line in lines {
        let closed = match (name_in_csv(&line.closed), name_in_csv(&line.streets)) {
            ("", _) => String::new(),
            (edges, "") => format!(", closed {edges}"),
            (edges, streets) => format!(", closed {streets} ({edges})"),
        };
        let variant = format!("demand {}{closed}", line.demand);
        let column = header.iter().position(|name| *name == variant).unwrap_or_else(|| {
            header.push(variant);
            header.len() - 1
        });
        let controller = player(name_in_csv(&line.controller));
        let row = rows.iter().position(|row| row[0] == controller).unwrap_or_else(|| {
            rows.push(vec![controller]);
            rows.len() - 1
        });
        let row = &mut rows[row];
        row.resize(header.len(), NOTHING.to_owned());
        row[column] = cell(line).unwrap_or(NOTHING.to_owned());
    }
    rows.iter_mut().for_each(|row| row.resize(header.len(), NOTHING.to_owned()));
    Table { caption, header, rows }
}

/// Returns how the page calls a controller.
fn player(controller: &str) -> String {
    match controller.strip_prefix("plan:file=") {
        Some(folder) => format!("plan in {folder}"),
        None if controller == TODAY => TODAYS_PLAN.to_owned(),
        None => controller.to_owned(),
    }
}

/// Returns a name as it was before it became the field of a CSV file: see `csv_name`.
fn name_in_csv(field: &str) -> &str {
    field.strip_prefix('\'').filter(|name| name.starts_with(['=', '+', '-', '@'])).unwrap_or(field)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_from_a_csv_file_are_those_of_the_net() {
        let written = ["-10109", "main", "'main"].map(dials_core::outside::csv_name);
        assert_eq!(written.each_ref().map(|field| name_in_csv(field)), ["-10109", "main", "'main"]);
    }

    #[test]
    fn a_file_of_an_older_version_has_delays_only() {
        let folder = tempfile::tempdir().unwrap();
        let old = "controller,demand,closed,delay_s,half_width_95\nprogram,1,,30.5,\nprogram,1,'-7,44,2.5\n";
        std::fs::write(folder.path().join(VARIANTS), old).unwrap();
        let [_, Block::Table(table)] = &blocks(folder.path(), String::new()).unwrap()[..] else { panic!("one table") };
        assert_eq!(table.header, ["", "demand 1", "demand 1, closed -7"]);
        assert_eq!(table.rows, [["today's plan", "30.5", "44.0\u{a0}\u{b1}\u{a0}2.5"]]);
    }

    #[test]
    fn a_closed_edge_is_named_by_its_street() {
        let folder = tempfile::tempdir().unwrap();
        let text = "controller,demand,closed,streets,delay_s,half_width_95\nplan:file=a/b,1,'-7,High Street,44,\n";
        std::fs::write(folder.path().join(VARIANTS), text).unwrap();
        let [_, Block::Table(table)] = &blocks(folder.path(), String::new()).unwrap()[..] else { panic!("one table") };
        assert_eq!(table.header[1], "demand 1, closed High Street (-7)");
        assert_eq!(table.rows[0][0], "plan in a/b");
    }

    #[test]
    fn a_damaged_or_empty_file_is_an_error_that_names_it() {
        let folder = tempfile::tempdir().unwrap();
        for text in [
            "",
            "controller,demand,closed,delay_s,half_width_95\n",
            "controller,demand,closed,delay_s,half_width_95\na,1,,x,\n",
        ] {
            std::fs::write(folder.path().join(VARIANTS), text).unwrap();
            let error = format!("{:#}", blocks(folder.path(), String::new()).err().unwrap());
            assert!(error.contains("variants.csv: ") && error.contains("make it again with --csv"), "{error}");
        }
    }
}
