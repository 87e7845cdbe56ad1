//! `watch`: a live view of runs, as a page for a browser on this machine.
//!
//! `delays`: the map of delays of runs on scenarios. `player`: the process that plays for it. `messages`: what the two say.

mod delays;
mod messages;
mod player;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result as Anyhow, anyhow, ensure};

pub(super) use player::play_for_the_map;

use crate::cli;
use delays::DelayMaps;
use dials_core::domain::road_trace::RoadMap;
use dials_core::outside::path_as_text;
use dials_report::drawing::Svg;
use dials_report::live::page::{DelayView, Maps, Page};
use dials_report::live::server::LiveServer;
use dials_report::plot::means_on_map;
use dials_session::domains;
use dials_session::error::{Error, Result};
use dials_session::parent::END_WITH;
use dials_session::records::run_record::RunRecord;
use dials_session::terminal::{answer, note};

pub(super) fn watch(args: &cli::WatchArgs) -> Result<()> {
    let folder = &args.folder;
    if !folder.is_dir() {
        let what = if folder.exists() { "is no folder" } else { "no such folder" };
        let cure = "name a run directory, or a folder with some in it, such as runs";
        return Err(Error::Usage(anyhow!("{}: {what}; {cure}", folder.display())));
    }
    let server = LiveServer::new(args.port).map_err(Error::Usage)?;
    answer(server.address()).map_err(Error::Run)?;
    let delays = (!args.no_map).then(DelayMaps::default);
    let mut page = Page::new(folder, Box::new(MapsOfRuns { places: BTreeMap::new(), delays }));
    server.serve(&mut page, &path_as_text(folder)).map_err(Error::Run)
}

type Place = (RoadMap, Vec<String>);

struct MapsOfRuns {
    /// Places of the agents of runs that were drawn before.
    places: BTreeMap<PathBuf, Option<Place>>,
    /// `None`: nothing is to be played.
    delays: Option<DelayMaps>,
}

impl Maps for MapsOfRuns {
    fn returns(&mut self, run: &RunRecord) -> Option<Svg> {
        map_of(run, &mut self.places)
    }

    fn delays(&mut self, run: &RunRecord) -> Option<DelayView> {
        self.delays.as_mut()?.of(run)
    }
}

/// Draws the agents on the map of their network; `None` for a single one, in rows, or if files cannot be read. `maps`:
/// those that were drawn before.
fn map_of(run: &RunRecord, maps: &mut BTreeMap<PathBuf, Option<Place>>) -> Option<Svg> {
    let place = maps.entry(run.dir.clone()).or_insert_with(|| place_of(run).ok().flatten());
    let ((map, names), last) = (place.as_ref()?, run.evaluations.last()?);
    let means: Vec<f64> = last.agents.iter().map(|agent| agent.mean).collect();
    let line = format!("last evaluation, step {}", last.steps);
    (means.len() == names.len() && means.len() > 1).then(|| means_on_map(map, names, &means, &line).ok()).flatten()
}

fn place_of(run: &RunRecord) -> Anyhow<Option<Place>> {
    let Some(traffic) = domains::traffic(&run.config)? else { return Ok(None) };
    let names = traffic.plans().iter().map(|plan| plan.light.clone()).collect();
    Ok(traffic.road_map()?.map(|map| (map, names)))
}

/// A live view in a process of its own. It ends when this is dropped, or when this process ends.
pub(super) struct Beside(Child);

impl Beside {
    /// Starts `watch` for a run directory, and says where its page is.
    pub(super) fn of(run: &Path) -> Anyhow<Beside> {
        // Not the path of the program: another build may be there by now.
        let mut command = Command::new("/proc/self/exe");
        command.args([END_WITH, &std::process::id().to_string(), "watch"]).arg(run);
        // Ctrl-C at the terminal goes to the training alone. The view ends with it.
        command.stdin(Stdio::null()).stdout(Stdio::piped()).process_group(0);
        let mut view = Beside(command.spawn().context("--dashboard: the live view cannot be started")?);
        let mut address = String::new();
        let output = view.0.stdout.take().expect("the output was asked for above");
        BufReader::new(output).read_line(&mut address).context("--dashboard: the live view says nothing")?;
        ensure!(!address.is_empty(), "--dashboard: the live view has ended at once");
        note(format_args!("watch it at {}", address.trim_end()));
        Ok(view)
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        // It may have ended before.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
