//! The paper's figures and tables from run directories alone: learning curves over seeds, bars, tables in the paper's
//! layout with its own numbers beside ours, and every agent on its grid.
//!
//! - [`find`], [`run_dir`], [`csv_table`]: what runs left behind; nothing here ever sees a live run, or knows a domain by
//!   name. [`before`]: what older runs simulated.
//! - [`method`], [`group`]: which runs are comparable, and which differ in nothing but their seed.
//! - [`curves`], [`finals`]: what several seeds say together; `played`: what they played, for differences.
//! - [`paper`]: the paper's numbers, each with its source.
//! - [`chart`], [`document`], [`csv_file`]: pictures, pages and files; `pictures`, `tables` and `sections` fill
//!   them.
//! - [`compare`]: two groups of runs against each other.

pub mod before;
pub mod chart;
pub mod compare;
pub mod csv_file;
pub mod csv_table;
pub mod curves;
pub mod document;
pub mod finals;
pub mod find;
pub mod group;
pub mod method;
pub mod paper;
mod pictures;
mod played;
pub mod run_dir;
mod sections;
mod tables;
pub mod words;

use std::path::PathBuf;

use anyhow::{Result, ensure};

use group::Sorted;

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
pub fn report(folders: &[PathBuf]) -> Result<Report> {
    let found = find::find(folders)?;
    let missing = found.missing.clone();
    let Sorted { comparisons, left_out } = group::sort(found)?;
    let warnings = words::warnings(&comparisons, &missing, &left_out);
    ensure!(!comparisons.is_empty(), words::no_run(&names(folders), &warnings));
    let document = sections::document(&comparisons, &warnings)?;
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
