//! `--tune`: searches the best fixed-time controller for a network, once, and caches it in a file.

use std::path::{Path, PathBuf};

use anyhow::{anyhow, ensure};

use super::domain;
use super::places;
use super::subject::Subject;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::outside::FileName;
use crate::records::atomic::write_atomically;
use crate::terminal::counting::EpisodeBar;
use crate::terminal::tell;
use crate::traffic::controllers::timing_file::{TimingFile, TunedOn};
use crate::traffic::tuning;

/// Folder of the cached timings.
const FOLDER: &str = "tuned";
/// Name of the controller that is tuned.
const FIXED_TIME: &str = "fixed-time";

/// Replaces every `fixed-time` without parameters by the best timings that the search finds.
pub fn tune_fixed_time(config: &Config, episodes: usize, subjects: &mut [Subject]) -> Result<()> {
    let is_fixed_time = |subject: &&mut Subject| **subject == Subject::Controller(FIXED_TIME.to_owned());
    let untuned: Vec<&mut Subject> = subjects.iter_mut().filter(is_fixed_time).collect();
    if untuned.is_empty() {
        let is_timed = |subject: &Subject| matches!(subject, Subject::Controller(name) if name.starts_with(FIXED_TIME));
        if let Some(timed) = subjects.iter().find(|subject| is_timed(subject)) {
            let name = timed.label();
            return Err(Error::Usage(anyhow!(
                "--tune: searches all timings of {FIXED_TIME}, but `{name}` already sets some of them"
            )));
        }
        return Err(Error::Usage(anyhow!("--tune: tunes {FIXED_TIME}, which is not a controller of this command")));
    }
    let file = tuned_file(config, episodes)?;
    let name = format!("{FIXED_TIME}:file={}", file.display());
    untuned.into_iter().for_each(|subject| *subject = Subject::Controller(name.clone()));
    Ok(())
}

/// Returns the file of the timings for this network, horizon, seed, search and SUMO. If there is none, makes it.
fn tuned_file(config: &Config, episodes: usize) -> Result<PathBuf> {
    let Some(traffic) = domain::traffic(config).map_err(Error::Usage)? else {
        return Err(Error::Usage(anyhow!("--tune: only traffic lights can be tuned")));
    };
    let wanted = TunedOn::of(&traffic, episodes, config.seed).map_err(Error::Usage)?;
    let key = crc32fast::hash(format!("{wanted:?}").as_bytes());
    let name = FileName::new(format!("{}-{key:08x}.toml", wanted.network)).map_err(Error::Usage)?;
    let path = Path::new(FOLDER).join(name);
    if path.exists() {
        check_kept(&path, &wanted).map_err(Error::Usage)?;
        tell(format_args!("{}: uses the timings of an earlier search", path.display()));
        return Ok(path);
    }
    places::check_writable(Path::new(FOLDER)).map_err(Error::Usage)?;
    tell(format_args!(
        "{FOLDER}: has no timings for this network, horizon, seed, search and SUMO version; searching for them"
    ));
    let bar = EpisodeBar::new(1);
    let found = tuning::tune(&traffic, episodes, config.seed, &mut |standing| {
        bar.set_length(standing.at_most);
        bar.set(standing.played);
        bar.tell(format_args!("(at most); best return so far {:.1}", standing.best));
    });
    bar.finish();
    let found = found.map_err(Error::Run)?;
    found.to_toml().and_then(|text| write_atomically(&path, text.as_bytes())).map_err(Error::Run)?;
    tell(format_args!("{}: tuned on {episodes} episodes, return {:.1}", path.display(), found.mean_return));
    Ok(path)
}

fn check_kept(path: &Path, wanted: &TunedOn) -> anyhow::Result<()> {
    let kept = TimingFile::read(path)?;
    ensure!(kept.tuned_on == *wanted, "{}: was tuned for another setting; move it away", path.display());
    Ok(())
}
