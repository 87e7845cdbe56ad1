//! Influence predictors: `I(u_t | l_t)`, the influence of the rest of the system on a local region.
//!
//! An [`InfluencePredictor`] samples the influence sources `u_t` that drive a local simulator, given the d-set `l_t`,
//! the inputs that d-separate the region from the rest. [`AipStack`] is the paper's approximate influence predictor
//! (AIP), one network per agent; without training it is the predictor of untrained-DIALS. [`Marginals`] are constants,
//! the predictors of marginal-DIALS.
//!
//! - `aip`, `marginals`: the two predictors. [`outside`]: one in a Python process.
//! - `train`: fits a predictor to a [`Dataset`], and measures its loss; `descent`: how AIPs learn.
//! - `parts`: how often sources took their values in each part of an episode.
//! - `sources`: the distribution that logits stand for: sampling, cross-entropy and its gradient.

mod aip;
mod descent;
mod marginals;
pub mod outside;
mod parts;
mod sources;
mod train;

use std::ops::Range;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::AipConfig;
use dials_core::base::statistics::mean;
use dials_core::base::{AgentId, CompactRows, Dice, Rows, Seed, Stopwatch, Work};
use dials_core::domain::{Kinds, RegionSpec, Result, SourceSpec};
use stacknets::Layout;
use stacknets::Threads;

pub use aip::AipStack;
pub use marginals::{Marginals, frequencies};
pub use train::{AipLoss, FreshLoss, measure, train};

/// Mean cross-entropy of every influence source, in nats.
pub(crate) type CrossEntropies = Vec<f64>;

/// Returns the mean over the sources of an agent. Without sources it is 0: there is nothing to predict.
pub fn mean_loss(of_sources: &[f64]) -> f64 {
    if of_sources.is_empty() { 0.0 } else { mean(of_sources) }
}

/// Pairs `(l_t, u_t)` of one agent in the order in which the GS made them: whole episodes, one after another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dataset {
    /// `[samples, d_set_dim]`
    pub d_sets: CompactRows,
    /// `[samples, sources]`
    pub sources: Rows<u8>,
    /// Number of samples per episode.
    pub horizon: usize,
    /// Number of sources that the agent has itself. The others only fill up the shape of its kind and are always 0.
    pub own_sources: usize,
}

impl Dataset {
    pub fn new(spec: &RegionSpec) -> Self {
        Dataset {
            d_sets: CompactRows::new(spec.d_set_dim),
            sources: Rows::new(0, spec.sources.count()),
            horizon: spec.horizon,
            own_sources: spec.sources.count(),
        }
    }

    /// Makes empty datasets, one per agent.
    pub fn of_all(kinds: &Kinds) -> Vec<Dataset> {
        let of_agent = |(agent, spec)| Dataset { own_sources: kinds.sources(agent), ..Dataset::new(spec) };
        AgentId::all(kinds.agents()).into_iter().zip(kinds.specs()).map(of_agent).collect()
    }

    /// Leaves out the values of sources that the agent does not have. `of_sources`: one value per source of its kind.
    pub(crate) fn only_own<T>(&self, mut of_sources: Vec<T>) -> Vec<T> {
        of_sources.truncate(self.own_sources);
        of_sources
    }

    pub fn len(&self) -> usize {
        self.d_sets.len()
    }

    pub fn is_empty(&self) -> bool {
        self.d_sets.is_empty()
    }

    pub fn episodes(&self) -> usize {
        self.len() / self.horizon
    }

    pub fn extend(&mut self, other: &Dataset) {
        self.d_sets.extend(&other.d_sets);
        self.sources.extend(&other.sources);
    }

    pub fn push(&mut self, d_set: &[f32], sources: &[u8]) {
        self.d_sets.push(d_set);
        self.sources.push(sources);
    }
}

/// A sampler of the influence sources of many regions, one row per (agent, copy). Only one [`outside`] of this program can fail.
pub trait InfluencePredictor: Send {
    /// Sets the number of rows from now on. An episode begins in each.
    fn begin(&mut self, rows: usize) -> Result<()>;

    /// Forgets the history of these rows, because episodes begin in them.
    fn forget(&mut self, rows: &[usize]) -> Result<()>;

    /// Reads the d-sets of a decision whose sources are already known, and draws nothing.
    fn watch(&mut self, d_set: &Rows<f32>) -> Result<()>;

    /// Draws `u_t` for every row, each from the dice of its row.
    ///
    /// `d_set`: `[rows, d_set_dim]` at this decision; `sources`: `[rows, sources]`, written.
    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>) -> Result<()>;
}

/// What the predictors of some agents learn from.
#[derive(Clone, Copy)]
pub struct Lesson<'a> {
    /// One per agent, all of the same length.
    pub(crate) datasets: &'a [Dataset],
    /// Number of samples to learn from, whole episodes. The others are held out.
    pub(crate) samples: usize,
    pub(crate) config: &'a AipConfig,
    /// Threads that share the agents.
    pub(crate) threads: &'a Threads,
}

/// A predictor for each of some agents that learns from datasets. A run trains it, saves it, and continues from it.
pub trait TrainablePredictor: InfluencePredictor {
    fn sources(&self) -> &SourceSpec;

    /// Returns what it has learnt, one row per agent, as [`PredictorKind::layout`] describes it.
    fn values(&self) -> Rows<f32>;

    /// Copies what another one has learnt.
    fn load(&mut self, values: &Rows<f32>);

    /// Learns. `dice`: one per agent. `progress` is called with the share that is done.
    fn learn(&mut self, lesson: Lesson<'_>, dice: &mut [Dice], work: Work<'_, f64>);

    /// Returns the mean cross-entropies of every agent over some samples of its dataset, whole episodes.
    fn losses(&self, datasets: &[Dataset], samples: Range<usize>, watch: &mut Stopwatch) -> Vec<CrossEntropies>;

    /// Returns whether each source of an agent keeps its constants, because the last training found them better. Empty
    /// for predictors that do not choose.
    fn on_marginals(&self, _agent: usize) -> Vec<bool> {
        Vec::new()
    }
}

/// A kind of predictor, as a config chooses it.
pub trait PredictorKind {
    /// Returns whether it is fitted to datasets from the GS.
    fn learns(&self) -> bool;

    /// Returns whether a key of `[aip]` changes anything.
    fn reads(&self, key: &str) -> bool;

    /// Makes the first predictor of `agents`, each agent's from its own stream.
    fn make(&self, agents: &[AgentId], spec: &RegionSpec, aip: &AipConfig, seed: Seed) -> Box<dyn TrainablePredictor>;

    /// Returns the layout of what it has learnt.
    fn layout(&self, spec: &RegionSpec, config: &AipConfig) -> Layout;

    /// Returns an error that says why an agent's row of values cannot be what it has learnt. Its width is that of the
    /// layout, and all values are finite.
    fn check_values(&self, _spec: &RegionSpec, _config: &AipConfig, _values: &[f32]) -> Result<()> {
        Ok(())
    }

    /// Returns the floating-point operations in matrix products with which it samples the sources of one decision.
    fn sampling_flops(&self, spec: &RegionSpec, config: &AipConfig) -> f64;
}

/// Makes the list of predictors: the name in configs, the short form of training with it and its help, and its kind.
macro_rules! predictors {
    ($($(#[$about:meta])* $Name:ident = $name:literal, $form:literal, $help:literal, $kind:expr;)*) => {
        /// Predictor of the influence on a local region.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
        pub enum Predictor {
            $($(#[$about])* #[serde(rename = $name)] $Name,)*
        }

        impl Predictor {
            /// All predictors, with the short form of training with each, and its help.
            pub(crate) const ALL: &[(Predictor, &str, &str)] = &[$((Predictor::$Name, $form, $help),)*];

            pub fn kind(self) -> &'static dyn PredictorKind {
                match self {
                    $(Predictor::$Name => &$kind,)*
                }
            }
        }
    };
}

// A new predictor is a file, and a line here.
predictors! {
    /// Approximate influence predictors (AIPs) that are trained every F steps.
    #[default]
    Network = "aip", "dials", "local simulators with trained influence predictors (AIPs)", aip::Aips::Trained;
    /// Random AIPs that are never trained.
    Untrained = "untrained", "untrained-dials", "local simulators with random predictors that are never trained",
        aip::Aips::Untrained;
    /// Constant probabilities instead of AIPs, measured on the global simulator (GS) when DIALS would train its AIPs.
    Marginals = "marginals", "marginal-dials",
        "local simulators with constant arrival probabilities, measured on the global simulator", marginals::Constants;
    /// A predictor in Python: `predictor=` of `dials_traffic.train` and `dials_traffic.dials`.
    Outside = "outside", "outside-dials", "local simulators with a predictor that is written in Python", outside::InPython;
}
