//! The report for a city, from what `evaluate` and `baseline` write with `--csv`: today's plan, the best rule and what was learned,
//! a map, each light before and after, and what was assumed. The runs' learning curves come behind it. [`live`] is the same in short,
//! for a run that trains.

mod assumed;
mod live;
mod map;
mod page;
mod plans;
mod read;
mod roles;
mod slide;
mod variants;

use std::path::PathBuf;

use anyhow::Result;

use crate::document::Block;

pub use live::DelayMap;
pub use variants::VARIANTS;

/// Name of the file that `evaluate` and `baseline` write with `--csv`.
pub const CITY: &str = "city.json";
/// Name of the picture for a presentation.
const SLIDE: &str = "slide.svg";

/// The sections about all cities in some folders.
pub(crate) struct Cities {
    pub(crate) title: String,
    pub(crate) blocks: Vec<Block>,
    /// Names of the slides among the files, one for each comparison.
    pub(crate) slides: Vec<String>,
    /// Folders that hold a city, or a table of variants.
    pub(crate) folders: Vec<PathBuf>,
    /// Names and texts of files that belong beside the page.
    pub(crate) files: Vec<(String, String)>,
    /// Sentences about what could not be put together.
    pub(crate) warnings: Vec<String>,
}

/// Reads the cities and the tables of variants in these folders. There is neither: `None`. `of_slides`: their title.
pub(crate) fn cities(folders: &[PathBuf], of_slides: Option<&str>) -> Result<Option<Cities>> {
    folders.iter().try_for_each(|folder| plans::check(folder))?;
    let found = read::find(folders)?;
    let all: Vec<PathBuf> = found.iter().map(|(folder, _)| folder.clone()).collect();
    let (mut found, warnings) = plans::beside_the_others(found);
    found.iter_mut().for_each(|(_, city)| city.leave_out_files());
    let plans = plans::files(&all)?;
    let tables: Vec<PathBuf> = folders.iter().filter(|folder| folder.join(VARIANTS).is_file()).cloned().collect();
    if found.is_empty() && tables.is_empty() {
        return Ok(None);
    }
    let title = match &found[..] {
        [] => "Other demand and closed roads".to_owned(),
        [(_, city)] => format!("Traffic lights of {}", city.title()),
        several => format!("Traffic lights of {} comparisons", several.len()),
    };
    // Nothing in a table of variants names its city: with several cities, each takes that of its own folder only.
    let mut blocks: Vec<Block> = Vec::new();
    for (number, (folder, city)) in found.iter().enumerate() {
        blocks.extend(match found.len() {
            1 => page::blocks(&tables, city, None)?,
            _ => page::blocks(std::slice::from_ref(folder), city, Some(number + 1))?,
        });
    }
    for folder in tables.iter().filter(|folder| found.len() != 1 && found.iter().all(|(city, _)| city != *folder)) {
        blocks.extend(variants::blocks(folder, format!("Robustness: {}", folder.display()))?);
    }
    blocks.extend(plans.blocks);
    let mut files = plans.files;
    let slides = found.iter().enumerate().map(|(number, (_, city))| {
        let name = if found.len() == 1 { SLIDE.to_owned() } else { SLIDE.replace('.', &format!("_{}.", number + 1)) };
        (name, slide::slide(city, of_slides).file())
    });
    let slides: Vec<(String, String)> = slides.collect();
    let names = slides.iter().map(|(name, _)| name.clone()).collect();
    files.extend(slides);
    let folders = all.into_iter().chain(tables.iter().cloned()).collect();
    Ok(Some(Cities { title, blocks, slides: names, folders, files, warnings }))
}
