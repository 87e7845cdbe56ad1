//! `--tune`: searches the best timings of the lights that go by the clock, once per network, and caches them in a file.

use std::path::{Path, PathBuf};

use anyhow::anyhow;

use super::subject::Subject;
use dials_core::base::counted;
use dials_core::outside::{FileName, write_together};
use dials_session::config::RunConfig;
use dials_session::domains;
use dials_session::error::{Error, Result};
use dials_session::outputs;
use dials_session::terminal::counting::EpisodeBar;
use dials_session::terminal::note;
use dials_traffic::controllers::timing_file::{TimingFile, TunedOn};
use dials_traffic::controllers::{COORDINATED, FIXED_TIME};
use dials_traffic::tuning;

/// Folder of the cached timings.
const FOLDER: &str = "tuned";
/// Controllers that are tuned.
const TUNED: [&str; 2] = [FIXED_TIME, COORDINATED];

/// Replaces every `fixed-time` and `coordinated` without parameters by the best timings that the search finds.
pub(super) fn tune(config: &RunConfig, episodes: usize, subjects: &mut [Subject]) -> Result<()> {
    let is = |subject: &Subject, name: &str| *subject == Subject::Controller(name.to_owned());
    let untuned = TUNED.into_iter().filter(|name| subjects.iter().any(|subject| is(subject, name)));
    let untuned: Vec<&str> = untuned.collect();
    if untuned.is_empty() {
        let timed = subjects.iter().find_map(|subject| match subject {
            Subject::Controller(name) => Some((name, TUNED.into_iter().find(|tuned| name.starts_with(tuned))?)),
            Subject::Run { .. } => None,
        });
        return Err(Error::Usage(match timed {
            Some((name, tuned)) => {
                anyhow!("--tune: searches all timings of {tuned}, but `{name}` already sets some of them")
            }
            None => anyhow!("--tune: tunes {}, which are no controllers of this command", TUNED.join(" and ")),
        }));
    }
    for controller in untuned {
        let file = tuned_file(config, controller, episodes)?;
        let tuned = Subject::Controller(format!("{controller}:file={}", file.display()));
        subjects.iter_mut().filter(|subject| is(subject, controller)).for_each(|subject| *subject = tuned.clone());
    }
    Ok(())
}

/// Returns the file of a controller's timings for this network, horizon, seed, search and SUMO. If there is none, makes
/// it.
fn tuned_file(config: &RunConfig, controller: &str, episodes: usize) -> Result<PathBuf> {
    let Some(traffic) = domains::traffic(config).map_err(Error::Usage)? else {
        return Err(Error::Usage(anyhow!("--tune: only traffic lights can be tuned")));
    };
    let wanted = TunedOn::of(&traffic, controller, episodes, config.learning.seed).map_err(Error::Usage)?;
    let key = crc32fast::hash(&serde_json::to_vec(&wanted).expect("names and numbers are JSON"));
    // A comma in a path would end the parameter of the controller that reads the file.
    let name = format!("{}-{controller}-{key:08x}.toml", wanted.network.replace(',', "_"));
    let path = Path::new(FOLDER).join(FileName::new(name).map_err(Error::Usage)?);
    if path.exists() {
        let kept = TimingFile::read(&path).map_err(Error::Usage)?;
        if kept.tuned_on != wanted {
            return Err(Error::Usage(anyhow!("{}: was tuned for another setting; move it away", path.display())));
        }
        note(format_args!("{}: uses the timings of an earlier search", path.display()));
        return Ok(path);
    }
    outputs::check_writable(Path::new(FOLDER)).map_err(Error::Usage)?;
    note(format_args!(
        "{FOLDER}: has no timings of {controller} for this network, horizon, seed, search and SUMO version; searching for \
         them"
    ));
    let bar = EpisodeBar::new(1);
    let found = tuning::tune(&traffic, wanted, config.learning.seed, &mut |progress| {
        bar.set_length(progress.at_most);
        bar.set(progress.played);
        bar.set_message(format_args!("(at most); best {} so far", progress.best));
    });
    bar.finish();
    let found = found.map_err(Error::Run)?;
    found
        .to_toml()
        .and_then(|text| write_together(Path::new(FOLDER), &[(path.clone(), text.into_bytes())]))
        .map_err(Error::Run)?;
    note(format_args!("{}: tuned on {}, {}", path.display(), counted(episodes, "episode"), found.score()));
    Ok(path)
}
