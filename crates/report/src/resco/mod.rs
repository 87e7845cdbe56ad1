//! The board of RESCO's maps: what was measured here beside what others published.
//!
//! - [`published`]: the maps, the protocol's windows, and the published figures with their kind and source.
//! - [`results`]: what a benchmark measured. `board`: the page. `numbers`: the same as CSV and JSON.
//!
//! Delay is RESCO's: `(timeLoss + departDelay of all cars, unfinished ones included, + (end - depart) of those that never
//! departed) / cars`, in seconds.

mod board;
mod numbers;
pub mod published;
pub mod results;

use anyhow::Result;

use results::{About, MapResults};

/// Name of the page, of the same as Markdown, and of its numbers.
pub const PAGE: &str = "benchmark.html";
pub const MARKDOWN: &str = "benchmark.md";
const CSV: &str = "benchmark.csv";
const JSON: &str = "benchmark.json";

/// Returns the names and texts of all files of the board.
pub fn files(about: &About, maps: &[MapResults]) -> Result<Vec<(&'static str, String)>> {
    let document = board::document(about, maps);
    Ok(vec![
        (PAGE, document.to_html()),
        (MARKDOWN, document.to_markdown()),
        (CSV, numbers::csv(maps)?),
        (JSON, numbers::json(about, maps)),
    ])
}

/// Returns a short table for the terminal: a line per player, ours and published ones, and a column per map.
pub fn summary(maps: &[MapResults]) -> String {
    board::summary_text(maps)
}
