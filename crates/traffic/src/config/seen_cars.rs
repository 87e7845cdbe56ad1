//! The share of the cars that agents see.

use anyhow::{Result, ensure};
use rand::seq::IndexedRandom;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use dials_core::base::{AgentId, Seed};

/// Share of the cars with which a light sees no car, but what its detectors count.
pub(crate) const DETECTORS_ONLY: f64 = 0.0;
/// What a share must be.
pub(crate) const SHARES: &str = "from 0.01 to 1, or 0 for detectors only";

/// Returns whether a share is one that [`SHARES`] names.
pub(crate) fn may_be_seen(share: f64) -> bool {
    share == DETECTORS_ONLY || (0.01..=1.0).contains(&share)
}

/// A share of the cars that agents see, or several of which every light draws one in every episode. 0: they see what detectors count,
/// and no cars.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SeenCars {
    Share(f64),
    OneOf(Vec<f64>),
}

impl Default for SeenCars {
    fn default() -> SeenCars {
        SeenCars::Share(1.0)
    }
}

impl SeenCars {
    fn shares(&self) -> &[f64] {
        match self {
            SeenCars::Share(share) => std::slice::from_ref(share),
            SeenCars::OneOf(shares) => shares,
        }
    }

    /// Returns whether agents always see all cars.
    pub fn are_all(&self) -> bool {
        self.shares().iter().all(|&share| share == 1.0)
    }

    /// Returns whether an agent may see detectors only.
    pub(crate) fn may_be_none(&self) -> bool {
        self.shares().contains(&DETECTORS_ONLY)
    }

    pub(crate) fn check(&self) -> Result<()> {
        let shares = self.shares();
        ensure!(!shares.is_empty(), "traffic.seen_cars = []: name at least one share; 1 means all cars");
        for &share in shares {
            ensure!(may_be_seen(share), "traffic.seen_cars = {share}: must be {SHARES}");
        }
        Ok(())
    }

    /// Returns the share of the cars that an agent sees in an episode.
    pub(crate) fn of(&self, episode: Seed, agent: AgentId) -> f64 {
        match self {
            SeenCars::Share(share) => *share,
            SeenCars::OneOf(shares) => {
                let mut dice = episode.fork_named("seen cars").for_agent(agent).dice();
                *shares.choose(&mut dice).expect("the check refuses an empty list")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_light_draws_its_share_anew_in_every_episode() {
        let several = SeenCars::OneOf(vec![1.0, 0.5, 0.1]);
        let drawn = |seed: u64| -> Vec<f64> {
            AgentId::all(300).into_iter().map(|agent| several.of(Seed::new(seed), agent)).collect()
        };
        for share in [1.0, 0.5, 0.1] {
            // A third of 300, standard deviation 8.2.
            let count = drawn(1).iter().filter(|&&drawn| drawn == share).count();
            assert!((70..130).contains(&count), "{count} lights with {share}");
        }
        assert_eq!(drawn(1), drawn(1));
        assert_ne!(drawn(1), drawn(2));
        assert_eq!(SeenCars::Share(0.3).of(Seed::new(1), AgentId(7)), 0.3);
    }

    #[test]
    fn a_list_may_not_be_empty_and_every_share_must_be_one() {
        let error = |shares: &[f64]| SeenCars::OneOf(shares.to_vec()).check().unwrap_err().to_string();
        assert_eq!(error(&[1.0, 1.5]), "traffic.seen_cars = 1.5: must be from 0.01 to 1, or 0 for detectors only");
        assert!(error(&[]).contains("name at least one share"));
        assert!(SeenCars::OneOf(vec![1.0, 0.01, 0.0]).check().is_ok());
        assert!(SeenCars::OneOf(vec![1.0, 0.0]).may_be_none() && !SeenCars::OneOf(vec![1.0, 0.01]).may_be_none());
        assert!(SeenCars::OneOf(vec![1.0, 1.0]).are_all() && !SeenCars::OneOf(vec![1.0, 0.9]).are_all());
    }
}
