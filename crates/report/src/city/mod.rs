//! The report for a city, from what `evaluate` and `baseline` write with `--csv`: today's plan, the best rule and what was learned,
//! a map, each light before and after, and what was assumed. The runs' learning curves come behind it.

mod map;
mod page;
mod read;

use std::path::PathBuf;

use anyhow::Result;

use crate::document::Block;

/// Name of the file that `evaluate` and `baseline` write with `--csv`.
pub const CITY: &str = "city.json";

/// The sections about all cities in some folders.
pub(crate) struct Cities {
    pub(crate) title: String,
    pub(crate) blocks: Vec<Block>,
    /// Folders that hold a city.
    pub(crate) folders: Vec<PathBuf>,
}

/// Reads the cities in these folders. There is none: `None`.
pub(crate) fn cities(folders: &[PathBuf]) -> Result<Option<Cities>> {
    let found = read::find(folders)?;
    let Some((_, first)) = found.first() else { return Ok(None) };
    let title = match found.len() {
        1 => format!("Traffic lights of {}", first.title()),
        count => format!("Traffic lights of {count} comparisons"),
    };
    let blocks = found.iter().flat_map(|(folder, city)| page::blocks(folder, city, found.len() == 1)).collect();
    Ok(Some(Cities { title, blocks, folders: found.into_iter().map(|(folder, _)| folder).collect() }))
}
