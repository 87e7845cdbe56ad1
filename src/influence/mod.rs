//! Influence predictors: `I(u_t | l_t)`, what the rest of the system does to a local region.
//!
//! An [`InfluencePredictor`] samples the influence sources that drive a local simulator. [`AipStack`] is the paper's
//! approximate influence predictor (AIP), one network per agent; never trained, it is the predictor of untrained-DIALS.
//! [`Marginals`] are constants, the predictors of marginal-DIALS. [`train`] fits either to a [`Dataset`] that was
//! collected from the GS, and [`measure`] tells their loss on one they have not seen.

mod aip;
mod dataset;
mod descent;
mod marginals;
mod measure;
mod sources;
mod train;

use std::ops::Range;

use crate::base::{AgentId, Dice, Rows, Seed, Stopwatch, Work};
use crate::config::{AipConfig, Predictor};
use crate::domain::{RegionSpec, SourceSpec};
use crate::nn::Layout;

pub use aip::AipStack;
pub use dataset::Dataset;
pub use marginals::{Marginals, frequencies};
pub use measure::{FreshLoss, measure};
pub use train::{AipLoss, train};

/// Mean cross-entropy of every influence source, in nats.
pub type CrossEntropies = Vec<f64>;

/// Samples the influence sources of many regions, one row per (agent, copy).
pub trait InfluencePredictor {
    /// So many rows come from now on, and an episode begins in each.
    fn begin(&mut self, rows: usize);

    /// Episodes begin in these rows: forget what was seen of the old ones.
    fn forget(&mut self, rows: &[usize]);

    /// Sees the d-sets of a decision whose sources are known already, and draws nothing.
    fn watch(&mut self, d_set: &Rows<f32>);

    /// Draws `u_t` for every row, each from the dice of its row.
    ///
    /// `d_set`: `[rows, d_set_dim]` at this decision; `sources`: `[rows, sources]`, written.
    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>);
}

/// A predictor for each of some agents that learns from datasets: what a run trains, keeps, and goes on from.
pub trait TrainablePredictor: InfluencePredictor {
    fn sources(&self) -> &SourceSpec;

    /// What it has learnt, one row per agent, as [`layout`] lays it out.
    fn values(&self) -> Rows<f32>;

    /// Takes over what another one has learnt.
    fn load(&mut self, values: &Rows<f32>);

    /// Learns from the first `samples` of every agent's dataset, whole episodes. `dice`: one per agent.
    /// `work`: progress is the share that is done.
    fn learn(
        &mut self,
        datasets: &[Dataset],
        samples: usize,
        config: &AipConfig,
        dice: &mut [Dice],
        work: Work<'_, f64>,
    );

    /// The mean cross-entropies of every agent over some samples of its dataset, whole episodes.
    fn cross_entropies(
        &self,
        datasets: &[Dataset],
        samples: Range<usize>,
        watch: &mut Stopwatch,
    ) -> Vec<CrossEntropies>;
}

/// The predictor of `agents` as a run with this choice begins, each agent's from its own stream.
pub fn initial_predictor(
    choice: Predictor,
    agents: &[AgentId],
    spec: &RegionSpec,
    config: &AipConfig,
    seed: Seed,
) -> Box<dyn TrainablePredictor> {
    match choice {
        Predictor::Marginals => Box::new(Marginals::new(agents.len(), spec)),
        Predictor::Network | Predictor::Untrained => Box::new(AipStack::new(agents, spec, config, seed)),
    }
}

/// How the predictor of such a run lays out what it has learnt.
pub fn layout(choice: Predictor, spec: &RegionSpec, config: &AipConfig) -> Layout {
    match choice {
        Predictor::Marginals => Marginals::layout(spec),
        Predictor::Network | Predictor::Untrained => AipStack::shape(spec, config).layout(),
    }
}

/// Floating-point operations in matrix products with which such a predictor samples the sources of one decision.
pub fn sampling_flops(choice: Predictor, spec: &RegionSpec, config: &AipConfig) -> f64 {
    match choice {
        Predictor::Marginals => 0.0,
        Predictor::Network | Predictor::Untrained => AipStack::shape(spec, config).forward_flops(),
    }
}
