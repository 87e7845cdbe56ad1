//! The paper's figures and tables, made from run directories alone: learning curves over seeds, bars, and every agent
//! on its grid. Tables have the paper's layout, with its numbers beside ours.
//!
//! AIP: approximate influence predictor. GS: global simulator. LS: local simulator. F: steps between two trainings of the
//! AIPs.
//!
//! - `group`: which runs are comparable, and which differ only in their seed.
//! - `opponent`: what the groups of a scenario are compared with. `family`: scenarios that may share an axis.
//! - `curves`, `finals`: results over several seeds. `cores`: wall time by number of cores, a model.
//! - `paper`: the paper's numbers, each with its source.
//! - `chart`, `document`, `csv_file`: pictures, pages and files. `pictures`, `tables`, `cost_tables` and `sections` fill
//!   them.
//! - [`words`]: formats of numbers, and warnings.
//! - [`lights`]: figures of each light of a road network, before and after.
//! - [`signal_plan`]: a plan of lights, as a page and a table.
//! - [`compare`]: a comparison of two groups of runs. [`live`]: a page about runs that train. [`plot`]: an episode.
//! - [`resco`]: the board of RESCO's maps.

mod chart;
pub mod city;
pub mod compare;
mod cores;
mod cost_tables;
mod cpu_to_level;
mod csv_file;
mod curves;
mod document;
pub mod drawing;
mod family;
mod finals;
#[cfg(test)]
mod fixtures;
mod group;
pub mod lights;
pub mod live;
mod opponent;
mod paper;
mod pictures;
pub mod plot;
pub mod resco;
mod sections;
pub mod signal_plan;
mod tables;
pub mod words;

use std::path::PathBuf;

use anyhow::{Result, ensure};

use dials_session::records::find::Found;
use document::Figure;
use group::Comparison;

pub const PAGE: &str = "report.html";
/// Name of the same report as Markdown, with its pictures as files beside it.
pub const MARKDOWN: &str = "report.md";

pub struct Report {
    pub files: Vec<(String, String)>,
    pub runs: usize,
    pub groups: usize,
    /// Names of the slides among the files, one for each comparison of a city's lights.
    pub slides: Vec<String>,
    /// Sentences about runs that are missing, unfinished or cannot be used.
    pub warnings: Vec<String>,
}

/// Makes a report of all runs and comparisons of lights under these folders, the same files for the same input.
///
/// `title`: that of the page and of the slides. There is none: the scenario's name makes it.
///
/// There is no comparison, and no run was evaluated and can be read: an error, which lists the first reasons.
pub fn report(folders: &[PathBuf], title: Option<&str>) -> Result<Report> {
    let cities = city::cities(folders, title)?;
    // A folder with a comparison need not have a run.
    let is_city =
        |folder: &PathBuf| cities.iter().any(|cities| cities.folders.iter().any(|city| city.starts_with(folder)));
    let with_runs = |folder: &&PathBuf| !is_city(folder) || dials_session::records::find::has_runs(folder);
    let of_runs: Vec<PathBuf> = folders.iter().filter(with_runs).cloned().collect();
    let (comparisons, mut warnings) = compared(dials_session::records::find::find(&of_runs)?)?;
    let groups = || comparisons.iter().flat_map(|comparison| &comparison.groups);
    let names: Vec<String> = of_runs.iter().map(|folder| folder.display().to_string()).collect();
    let has_finals = groups().any(|group| group.finals().is_some());
    ensure!(has_finals || (cities.is_some() && of_runs.is_empty()), words::no_run(&names.join(", "), &warnings));
    let (mut beside, mut slides) = (Vec::new(), Vec::new());
    let mut document = match cities {
        None => sections::document(&comparisons, &warnings)?,
        Some(city::Cities { title, mut blocks, files, slides: shown, warnings: of_cities, .. }) => {
            (beside, slides) = (files, shown);
            if has_finals {
                blocks.extend(sections::document(&comparisons, &warnings)?.blocks);
            }
            warnings.splice(0..0, of_cities);
            document::Document { title, blocks }
        }
    };
    if let Some(title) = title {
        document.title = title.to_owned();
    }
    let mut files = vec![(PAGE.to_owned(), document.to_html()), (MARKDOWN.to_owned(), document.to_markdown())];
    files.extend(beside);
    files.extend(document.figures().map(|figure| (format!("{}.svg", figure.name), figure.svg.file())));
    if has_finals {
        files.extend(csv_file::files(&comparisons)?);
    }
    let runs = groups().map(|group| group.runs.len()).sum();
    Ok(Report { files, runs, groups: groups().count(), slides, warnings })
}

/// Makes the figures of a report about these runs, and only them. None was evaluated yet: no figures.
pub(crate) fn compared_figures(found: Found) -> Result<Vec<Figure>> {
    let (comparisons, warnings) = compared(found)?;
    Ok(sections::document(&comparisons, &warnings)?.figures().cloned().collect())
}

/// Compares the runs that were found. Also returns sentences about those that are missing or unfinished.
fn compared(found: Found) -> Result<(Vec<Comparison>, Vec<String>)> {
    let sorted = group::sort(found)?;
    let warnings = words::warnings(&sorted);
    Ok((sorted.comparisons, warnings))
}
