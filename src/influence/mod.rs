//! Influence predictors: `I(u_t | l_t)`, what the rest of the system does to a local region.
//!
//! An [`InfluencePredictor`] samples the influence sources that drive a local simulator. [`AipStack`] is the paper's
//! approximate influence predictor (AIP), one network per agent, trained by [`train`] on a [`Dataset`] that was
//! collected from the GS. Never trained, it is the predictor of untrained-DIALS.

mod aip;
mod dataset;
mod sources;
mod train;

use crate::base::{Dice, Rows};

pub use aip::AipStack;
pub use dataset::Dataset;
pub use train::{AipLoss, CrossEntropies, train};

/// Samples the influence sources of many regions, one row per (agent, copy).
pub trait InfluencePredictor {
    /// So many rows come from now on, and an episode begins in each.
    fn begin(&mut self, rows: usize);

    /// Episodes begin in these rows: forget what was seen of the old ones.
    fn forget(&mut self, rows: &[usize]);

    /// Draws `u_t` for every row, each from the dice of its row.
    ///
    /// `d_set`: `[rows, d_set_dim]` at this decision; `sources`: `[rows, sources]`, written.
    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>);
}
