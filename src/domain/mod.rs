//! What a domain is: the traits between simulators and learning.
//!
//! A [`Domain`] makes simulators. The [`GlobalSimulator`] (GS) moves the whole system; a [`LocalSimulator`] (LS) moves
//! many local regions in lockstep, each driven by the influence sources it is handed. Simulators never see a tensor and
//! never hear of learning: they speak [`Rows`]. Learning never sees a car or a robot: it knows the [`RegionSpec`].
//!
//! Agents of equal shape form a [`Kind`]; a domain lists its [`Kinds`]. A local simulator has rows of one kind. The GS has
//! one row per agent, of whatever width its kind has.
//!
//! Pictures of episodes are drawn from a [`Scene`] or a [`road_trace`].
//!
//! A new domain implements the three traits and passes [`conformance`]; [`toy`] has the smallest ones.
//!
//! - `spec`: the shape of a region; `kinds`: the agents that have it; `percept`: what simulators show.
//! - `scenario`: what is simulated, as a run writes it down; `rough_costs`: a guess of how long it takes.
//! - `scene`: a picture of the state; [`road_trace`]: an episode of traffic, for pictures.
//! - [`conformance`]: what every domain must hold; [`toy`]: domains for tests.

pub mod conformance;
mod kinds;
mod percept;
pub mod road_trace;
mod rough_costs;
mod scenario;
mod scene;
mod spec;
pub mod toy;

use std::path::{Path, PathBuf};

use anyhow::bail;
use serde::{Deserialize, Serialize};

use crate::base::{AgentId, Ragged, Rows, Seed, Stopwatch};

pub use kinds::{Kind, Kinds, Place};
pub use percept::{JointPercept, JointTransition, Percept, Transition};
pub use rough_costs::RoughCosts;
pub use scenario::{Episode, FirstRow, Map, Scenario, ScenarioId};
pub use scene::{Colour, Scene};
pub use spec::{Action, RegionSpec, SourceSpec, logits_of};

/// Simulators fail for reasons of their own (SUMO, files); no room above chooses by the kind of failure.
pub type Result<T> = anyhow::Result<T>;

/// One sample `(l_t, u_t)` of every agent's dataset `D_i`: the d-set at a decision and the influence sources that acted
/// during the step after it.
#[derive(Clone, Copy, Debug)]
pub struct InfluenceSample<'a> {
    /// One row per agent: `[d_set_dim]` of its kind.
    pub d_set: &'a Ragged<f32>,
    /// One row per agent: `[sources]` of its kind.
    pub sources: &'a Ragged<u8>,
}

/// The global simulator: `s' ~ T(. | s, a)` for all agents at once, one row per agent.
///
/// It knows no horizon: whoever drives it ends the episode by `reset`. An episode follows from its seed and the joint
/// actions alone.
pub trait GlobalSimulator {
    /// Those of the domain.
    fn kinds(&self) -> &Kinds;

    fn agents(&self) -> usize {
        self.kinds().agents()
    }

    /// Begins an episode; everything random in it follows from `episode`.
    fn reset(&mut self, episode: Seed) -> Result<&JointPercept>;

    /// One step under the joint action, `[agents]`.
    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition>;

    /// The sample of the last step. The GS owns the alignment of the pair: an LS in the same local state that is fed
    /// these sources makes the same transition.
    fn influence_sample(&self) -> InfluenceSample<'_>;

    /// What else there is to tell of the episode so far.
    fn measures(&mut self) -> Result<Measures> {
        Ok(Measures::default())
    }

    /// From the next reset on [`GlobalSimulator::measures`] tell all that the domain knows, at whatever cost, and end
    /// the episode: then only a reset may follow.
    fn measure_in_full(&mut self) -> Result<()> {
        Ok(())
    }

    /// A picture of the state, where the domain draws one.
    fn scene(&self) -> Option<Scene> {
        None
    }

    /// How long its steps took since the last call, where it tells insertion, its own step and reading apart. What it
    /// does not tell counts as its own step.
    fn take_watch(&mut self) -> Stopwatch {
        Stopwatch::default()
    }
}

/// An episode that begins in a row of a local simulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Beginning {
    pub row: usize,
    /// Number of the episode in this row, from 0.
    pub episode: u64,
}

impl Beginning {
    /// The first episodes of these rows.
    pub fn first(rows: impl IntoIterator<Item = usize>) -> Vec<Beginning> {
        rows.into_iter().map(|row| Beginning { row, episode: 0 }).collect()
    }
}

/// The local simulators of many regions of one kind in lockstep: `x' ~ T_i(. | x, u, a)`, one row per (agent, copy).
///
/// It knows no horizon: whoever drives it ends the episode of a row by `reset`.
///
/// What a row does follows from its region and copy, the seed of the simulator, the number of the episode, and the
/// actions and sources since the episode began; other rows and earlier episodes have no part in it. So training can be
/// interrupted anywhere and goes on in a new simulator that is driven to the same place. [`conformance`] checks it.
pub trait LocalSimulator {
    /// That of its kind.
    fn spec(&self) -> &RegionSpec;
    fn rows(&self) -> usize;

    /// Begins these episodes, each in its row, and leaves the other rows as they are.
    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept>;

    /// One step of every row. `actions`: `[rows]`; `sources`: `[rows, sources]`.
    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition>;

    /// Totals since the simulator was made, such as influences that could not be carried out.
    fn counters(&self) -> Vec<(&'static str, u64)> {
        Vec::new()
    }

    /// As [`GlobalSimulator::take_watch`].
    fn take_watch(&mut self) -> Stopwatch {
        Stopwatch::default()
    }
}

/// Named figures of an episode beside the return.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measures {
    /// One value per agent.
    pub per_agent: Vec<(String, Vec<f64>)>,
    /// One value for the whole system.
    pub system: Vec<(String, f64)>,
}

/// Decides for all agents of a GS: a joint policy or a hand-coded baseline.
pub trait Controller {
    /// An episode begins; everything random in the decisions follows from `episode`.
    fn begin(&mut self, episode: Seed);

    /// Decides, one action per agent.
    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()>;
}

/// A hand-coded controller with the GS it runs on.
pub struct Baseline {
    pub simulator: Box<dyn GlobalSimulator>,
    pub controller: Box<dyn Controller>,
}

/// Leaves everything to hand-coded control inside the simulator.
pub struct Bystander;

impl Controller for Bystander {
    fn begin(&mut self, _episode: Seed) {}

    fn act(&mut self, _percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        actions.fill(0);
        Ok(())
    }
}

/// A networked system of agents with local regions.
pub trait Domain: Send + Sync {
    fn kinds(&self) -> &Kinds;

    fn agents(&self) -> usize {
        self.kinds().agents()
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>>;

    /// Local simulators of `regions`, `copies` of each: rows ordered by region, then copy. All regions are of one kind.
    fn local_simulator(&self, regions: &[AgentId], copies: usize, seed: Seed) -> Result<Box<dyn LocalSimulator>>;

    /// The names that [`Domain::baseline`] takes, for help and error messages.
    fn baselines(&self) -> &'static [&'static str] {
        &[]
    }

    /// A hand-coded controller by name; an unknown name is an error that lists the known ones.
    fn baseline(&self, name: &str) -> Result<Baseline> {
        anyhow::bail!("controller `{name}`: this domain has none")
    }

    /// An error if [`Domain::baseline`] would not know the name.
    fn check_baseline(&self, name: &str) -> Result<()> {
        self.baseline(name).map(drop)
    }

    /// A GS in which a hand-coded controller decides for these agents, whatever their actions say.
    fn with_background(&self, name: &str, _agents: &[AgentId]) -> Result<Box<dyn GlobalSimulator>> {
        bail!("controller `{name}`: this domain has no hand-coded control for some of its agents")
    }

    /// What to add to the output biases of a fresh policy of this kind, per action: a prior on behaviour.
    fn initial_action_bias(&self, kind: &Kind) -> Vec<f32> {
        vec![0.0; kind.spec.n_actions]
    }

    /// The agents that sit in a degenerate behaviour, judged by the mean measures of an evaluation: one value per agent.
    fn stuck(&self, _measures: &Measures) -> Vec<bool> {
        vec![false; self.agents()]
    }

    /// Describes what is simulated, for `run.json` and for whoever reads it.
    fn scenario(&self) -> Result<Scenario>;

    /// The hand-coded controller to measure a run against, one of [`Domain::baselines`].
    fn rival(&self) -> Option<&'static str> {
        None
    }

    /// Tries out what only a simulator can say of the domain's files, so that it is said before a run begins.
    fn try_out(&self) -> Result<()> {
        Ok(())
    }

    /// Returns an error if the domain's files could not be loaded from `folder`, which need not exist yet.
    fn check_place(&self, _folder: &Path) -> Result<()> {
        Ok(())
    }

    /// Makes `folder` and copies the domain's files into it. Returns their places in it, in the order of the config's keys
    /// that name them; a domain without files makes nothing.
    fn keep_files(&self, _folder: &Path) -> Result<Vec<PathBuf>> {
        Ok(Vec::new())
    }

    /// The program of others that makes the steps of this domain's simulators, if one does. Its time cannot be avoided.
    fn foreign_simulator(&self) -> Option<&'static str> {
        None
    }

    /// What a run costs where none was measured.
    fn rough_costs(&self) -> RoughCosts {
        RoughCosts::default()
    }
}
