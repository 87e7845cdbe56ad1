//! How plain SUMO plays a plan: which files it loads, and from when to when.

use std::path::PathBuf;

use anyhow::Result;

use crate::Traffic;
use crate::config::sumocfg::Sumocfg;
use crate::network::files::for_sumo;
use crate::road_network::Files;
use dials_core::base::Seed;
use dials_core::outside::read_text;

/// What the command line of plain SUMO needs, besides the file of the programs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlainRun {
    pub config: PathBuf,
    /// Additional files of the configuration. An option on the command line replaces them, so it must name them, too.
    pub additional: Vec<PathBuf>,
    /// Route file of the first episode, if each plays one of several. An option on the command line names it.
    pub routes: Option<PathBuf>,
    /// Seconds of begin and end that the configuration does not say.
    pub begin_s: Option<u64>,
    pub end_s: Option<u64>,
    /// Whether the configuration does not say whether SUMO checks files against schemas. SUMO then checks, and refuses some files that
    /// it can play.
    pub validates: bool,
}

/// Option of a configuration that says whether SUMO checks files.
const VALIDATION: &str = "xml-validation";
const MOST_BYTES: u64 = 1 << 20;

/// `first`: seed of the first episode, which the command plays.
///
/// Errors: SUMO cannot take the path of the episode's route file.
pub fn plain_run(traffic: &Traffic, first: Seed) -> Result<PlainRun> {
    let (begin_s, _) = traffic.window_s();
    // Decisions that do not fit into the window are not played.
    let end_s = begin_s + traffic.seconds() as u64;
    let (config, additional, theirs) = match &traffic.network.files {
        Files::Grid(files) => (files.network.files.config.clone(), Vec::new(), (0, None)),
        Files::Scenario(files) => {
            let path = files.files.path().to_owned();
            let sumocfg = Sumocfg::read(&path)?;
            (path, sumocfg.additional, (sumocfg.begin_s, sumocfg.end_s))
        }
    };
    let routes = traffic.route_file_of(first);
    routes.iter().try_for_each(|file| for_sumo(file).map(drop))?;
    let validates = !read_text(&config, MOST_BYTES)?.contains(VALIDATION);
    Ok(PlainRun {
        validates,
        config,
        additional,
        routes,
        begin_s: (begin_s != theirs.0).then_some(begin_s),
        end_s: (Some(end_s) != theirs.1).then_some(end_s),
    })
}
