//! Where the cars drive, and everything in which one place differs from another.
//!
//! - [`on_grid`]: a grid of the paper, with local simulators. [`on_scenario`]: a scenario of the user.

pub(crate) mod on_grid;
pub(crate) mod on_scenario;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::network::loadable::Loadable;
use crate::network::roads::Roads;
use crate::paper_grid::grid::Grid;
use crate::sim::local::LocalTraffic;
use crate::sim::local_forest::LocalParts;
use crate::sim::recorded_roads::RecordedRoads;
use crate::sim::recording::Tape;
use crate::sim::trace::route::Route;
use dials_core::domain::{Result, RoughCosts, Scenario};

/// What is known of a place as soon as it was read.
pub(crate) struct About {
    /// The grid, if it is one.
    pub(crate) grid: Option<Grid>,
    /// Number of decisions in an episode.
    pub(crate) horizon: usize,
    /// Why SUMO cannot load the actuated programs of the lights, if it cannot. SUMO's own error would come after it has
    /// taken all memory.
    pub(crate) refuses_actuated: Option<String>,
    /// Message about files that SUMO cannot simulate, with the way out.
    pub(crate) cannot_be_simulated: String,
    /// See [`dials_core::domain::Domain::rough_costs`].
    pub(crate) rough_costs: RoughCosts,
    /// Name of the reward, if it is another one than the usual.
    pub(crate) unusual_reward: Option<String>,
    /// See [`dials_core::domain::Domain::strange_files`].
    pub(crate) strange_files: Vec<PathBuf>,
    /// See [`dials_core::domain::Domain::left_out`].
    pub(crate) left_out: Vec<String>,
    /// Number to add to the output bias of action 1 of a new policy.
    pub(crate) switch_bias: f32,
    /// Whether cars dawdle at random. The speed factors of cars do not count.
    pub(crate) is_random: bool,
    /// Returns whether an agent is stuck that ends this share of its green steps.
    pub(crate) is_stuck: fn(f64) -> bool,
    /// Controller to compare a run with.
    pub(crate) rival: &'static str,
}

/// A road network with its cars.
pub(crate) trait Ground: Send + Sync {
    fn about(&self) -> &About;

    /// Puts everything that the GS (global simulator) loads into memory.
    fn source(&self) -> Result<Loadable>;

    /// Returns all roads, for pictures.
    fn roads(&self) -> Result<Roads>;

    /// Returns the roads as recordings of the GS keep them.
    fn recorded(&self) -> Result<RecordedRoads>;

    /// Reads the way along which cars are drawn: names of edges, separated by commas.
    fn route(&self, edges: &str) -> Result<Route>;

    /// Loads local simulators of `rows` rows that are all alike. It is an error if they differ.
    fn local(&self, rows: usize, tape: Option<&Tape>) -> Result<LocalTraffic>;

    /// Returns what local simulators are made of that differ from region to region. `None`: all are alike, and
    /// [`Ground::local`] loads them.
    fn local_parts(&self) -> Result<Option<Arc<LocalParts>>>;

    /// Loads the local simulator, if there is one, and plays a step. An error names the file.
    fn try_local(&self) -> Result<()>;

    /// Describes what is simulated.
    fn scenario(&self, agents: usize) -> Result<Scenario>;

    /// Returns the name and the CRC-32 that timings of lights are tuned for.
    fn identity(&self) -> (String, u32);

    /// See [`dials_core::domain::Domain::check_place`].
    fn check_place(&self, folder: &Path) -> Result<()>;

    /// See [`dials_core::domain::Domain::keep_files`].
    fn keep_files(&self, folder: &Path) -> Result<Vec<PathBuf>>;
}
