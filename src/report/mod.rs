//! The paper's figures and tables from run directories alone: learning curves over seeds, bars, tables in the paper's
//! layout with its own numbers beside ours, and every agent on its grid.
//!
//! - [`find`]: which runs, baselines and plans lie under the folders of a report. Nothing here ever sees a live run.
//! - [`scenario`], [`group`]: which runs are comparable, and which differ in nothing but their seed.
//! - [`statistics`], [`difference`], [`curves`], [`finals`]: what several seeds say together.
//! - [`paper`]: the paper's numbers, each with its source.
//! - [`chart`], [`document`], [`csv_file`]: pictures, pages and files; `pictures`, `tables` and `sections` fill
//!   them.
//! - [`compare`]: two groups of runs against each other.

pub mod chart;
pub mod compare;
pub mod csv_file;
pub mod curves;
pub mod difference;
pub mod document;
pub mod finals;
pub mod find;
pub mod group;
pub mod paper;
mod pictures;
pub mod scenario;
mod sections;
pub mod statistics;
mod tables;
pub mod words;

use std::path::PathBuf;

use anyhow::{Result, ensure};

use crate::records::run_record::RunRecord;
use group::Sorted;

/// Rows and columns of a run's agents, where somebody knows them: agents are numbered row by row.
pub type GridShape<'a> = &'a dyn Fn(&RunRecord) -> Option<(usize, usize)>;

/// The page of a report.
pub const PAGE: &str = "report.html";
/// The same as Markdown, with its pictures as files beside it.
pub const MARKDOWN: &str = "report.md";

/// The files of a report.
pub struct Report {
    /// Names and contents.
    pub files: Vec<(String, String)>,
    pub runs: usize,
    pub groups: usize,
    /// Runs that are missing, unfinished or cannot be used, in words.
    pub warnings: Vec<String>,
}

/// Makes a report of all runs under these folders. The same runs always make the same files. Folders without one run that was
/// evaluated and can be read are an error that lists the first reasons.
pub fn report(folders: &[PathBuf], shape: GridShape) -> Result<Report> {
    let found = find::find(folders)?;
    let missing = found.missing.clone();
    let Sorted { comparisons, left_out } = group::sort(found)?;
    let warnings = words::warnings(&comparisons, &missing, &left_out);
    ensure!(!comparisons.is_empty(), words::no_run(&names(folders), &warnings));
    let document = sections::document(&comparisons, &warnings, shape)?;
    let mut files = vec![(PAGE.to_owned(), document.to_html()), (MARKDOWN.to_owned(), document.to_markdown())];
    files.extend(document.figures().map(|figure| (format!("{}.svg", figure.name), figure.svg.file())));
    files.extend(csv_file::files(&comparisons)?.into_iter().map(|file| (file.name.to_owned(), file.text)));
    let groups = comparisons.iter().flat_map(|comparison| &comparison.groups);
    let runs = groups.clone().map(|group| group.runs.len()).sum();
    Ok(Report { files, runs, groups: groups.count(), warnings })
}

fn names(folders: &[PathBuf]) -> String {
    folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(", ")
}
