//! Differences of final returns, paired by episode and by seed if both sides played the same episodes.
//!
//! The difference of a seed is the mean over the episodes of the difference in each. So the effect of the traffic,
//! which is the same on both sides, cancels out, and only the spread between seeds remains. The result holds for these
//! episodes. If one side played more of the same ones, the first ones count, which both have.

use super::{Bounds, ENOUGH_SEEDS, mean, student_t, variance};

/// Episodes of an evaluation. Two evaluations with the same episodes saw the same traffic, and with the same seed alone
/// the shorter one saw the first episodes of the longer one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Episodes {
    pub seed: u64,
    pub count: usize,
}

/// Result of a run, or of a controller, on its episodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Played {
    pub mean: f64,
    pub episodes: Episodes,
    /// Mean return of all agents in each episode.
    returns: Vec<f64>,
}

impl Played {
    /// Makes a result. `seed`: `evaluation.seed`; `returns`: the mean return of all agents in each episode.
    pub fn new(mean: f64, seed: u64, returns: Vec<f64>) -> Played {
        Played { mean, episodes: Episodes { seed, count: returns.len() }, returns }
    }

    /// Returns the result on the first episodes alone.
    fn on_first(&self, count: usize) -> Played {
        if count >= self.returns.len() {
            return self.clone();
        }
        let returns = self.returns[..count].to_vec();
        Played::new(mean(&returns), self.episodes.seed, returns)
    }
}

/// Returns the episodes of all of them, if all have the same.
pub fn common_episodes<'a>(mut all: impl Iterator<Item = &'a Played>) -> Option<Episodes> {
    let first = all.next()?.episodes;
    all.all(|played| played.episodes == first).then_some(first)
}

/// Returns the first episodes, which all of them played; `None` if their seeds differ.
pub fn shared_episodes<'a>(mut all: impl Iterator<Item = &'a Played>) -> Option<Episodes> {
    let first = all.next()?.episodes;
    all.try_fold(first, |Episodes { seed, count }, Played { episodes: own, .. }| {
        (own.seed == seed).then_some(Episodes { seed, count: count.min(own.count) })
    })
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pairing {
    /// The same seed on the same episode.
    EpisodeAndSeed,
    /// The same episode. The seeds are different, or the other side is a controller, which has no seed.
    Episode,
    /// The same seed. The episodes may be different.
    Seed,
    /// Nothing is paired, only means are compared.
    Nothing,
}

impl Pairing {
    pub fn name(self) -> &'static str {
        match self {
            Pairing::EpisodeAndSeed => "episode and seed",
            Pairing::Episode => "episode",
            Pairing::Seed => "seed",
            Pairing::Nothing => "nothing",
        }
    }

    /// Returns whether both sides played the same episodes.
    pub fn by_episode(self) -> bool {
        matches!(self, Pairing::EpisodeAndSeed | Pairing::Episode)
    }
}

/// How much higher the final return of one side is.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    pub mean: f64,
    pub pairing: Pairing,
    /// The episodes that both sides played; `None` if these are not the same.
    pub episodes: Option<Episodes>,
    /// Number of seeds of each side; a controller has that of the other side.
    pub seeds: [usize; 2],
    /// Differences seed by seed; empty if the seeds of two groups are not the same.
    pub of_seeds: Vec<(u64, f64)>,
    /// Student's t interval of 95 % over seeds. `None` with too few seeds. Also `None` if the episodes differ between
    /// the sides but not between the seeds of a side: then the difference contains the chance of the traffic, but its
    /// spread does not.
    pub interval: Option<Bounds>,
}

/// One side: the runs of a group by seed.
pub type BySeed = Vec<(u64, Played)>;

/// Computes `b - a` for two groups.
///
/// Panics if a side is empty.
pub fn between(a: &BySeed, b: &BySeed) -> Difference {
    let episodes = shared_episodes(a.iter().chain(b).map(|(_, played)| played));
    let same_episodes = episodes.is_some();
    let same_seeds = a.len() == b.len() && a.iter().zip(b).all(|((left, _), (right, _))| left == right);
    let [a, b] = [a, b].map(|side| on_shared(side, episodes));
    let [of_a, of_b] = [&a, &b].map(|side| side.iter().map(|(_, played)| played.mean).collect::<Vec<_>>());
    let of_seeds: Vec<(u64, f64)> = match same_seeds {
        true => a.iter().zip(&b).map(|((seed, a), (_, b))| (*seed, of_pair(a, b))).collect(),
        false => Vec::new(),
    };
    let interval = match same_seeds {
        true => Bounds::of_seeds(&values(&of_seeds)),
        false => welch(&of_a, &of_b),
    };
    Difference {
        mean: mean(&of_b) - mean(&of_a),
        pairing: match (same_episodes, same_seeds) {
            (true, true) => Pairing::EpisodeAndSeed,
            (true, false) => Pairing::Episode,
            (false, true) => Pairing::Seed,
            (false, false) => Pairing::Nothing,
        },
        episodes,
        seeds: [a.len(), b.len()],
        of_seeds,
        interval: interval.filter(|_| same_episodes),
    }
}

/// Computes a group minus a controller.
///
/// Panics if the group is empty.
pub fn to_controller(group: &BySeed, controller: &Played) -> Difference {
    // As if the controller had played once for each seed.
    let same = group.iter().map(|(seed, _)| (*seed, controller.clone())).collect();
    let found = between(&same, group);
    Difference {
        mean: mean(&values(&found.of_seeds)),
        pairing: if found.episodes.is_some() { Pairing::Episode } else { Pairing::Nothing },
        ..found
    }
}

/// Computes the interval of the mean of `b` minus that of `a`, two groups of unequal variance with one value per seed.
/// `None` if one has fewer than [`ENOUGH_SEEDS`].
///
/// Source: Welch 1947.
fn welch(a: &[f64], b: &[f64]) -> Option<Bounds> {
    if a.len().min(b.len()) < ENOUGH_SEEDS {
        return None;
    }
    let of_mean = |values: &[f64]| variance(values) / values.len() as f64;
    let freedom = |values: &[f64]| values.len() as f64 - 1.0;
    let variance = of_mean(a) + of_mean(b);
    let below = of_mean(a).powi(2) / freedom(a) + of_mean(b).powi(2) / freedom(b);
    // Without any variance, every number of degrees of freedom gives the same interval, of width 0.
    let freedom = if below > 0.0 { variance.powi(2) / below } else { 1.0 };
    Some(Bounds::around(mean(b) - mean(a), student_t(freedom) * variance.sqrt()))
}

/// Computes `b - a`: the mean over the episodes of the difference in each. If the episodes differ: the difference of
/// the means.
fn of_pair(a: &Played, b: &Played) -> f64 {
    if a.episodes != b.episodes {
        return b.mean - a.mean;
    }
    mean(&a.returns.iter().zip(&b.returns).map(|(a, b)| b - a).collect::<Vec<_>>())
}

/// Returns a side on the shared episodes; as it is if there are none.
pub fn on_shared(side: &BySeed, shared: Option<Episodes>) -> BySeed {
    let count = shared.map_or(usize::MAX, |episodes| episodes.count);
    side.iter().map(|(seed, played)| (*seed, played.on_first(count))).collect()
}

fn values(of_seeds: &[(u64, f64)]) -> Vec<f64> {
    of_seeds.iter().map(|(_, difference)| *difference).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIVE: [f64; 5] = [1.0, 2.0, 3.0, 4.0, 5.0];

    fn assert_near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
    }

    fn played(seed: u64, returns: &[f64]) -> Played {
        Played::new(mean(returns), seed, returns.to_vec())
    }

    /// Makes a side of these runs, with seeds 1, 2, ...
    fn side(runs: impl IntoIterator<Item = Played>) -> BySeed {
        (1..).zip(runs).collect()
    }

    #[test]
    fn other_seeds_on_the_same_episodes_are_compared_as_welch_does() {
        let a = side(FIVE.map(|value| played(0, &[value])));
        let others = |value: fn(f64) -> f64| (11..).zip(FIVE.map(|own| played(0, &[value(own)]))).collect();
        let found = between(&a, &others(|value| 10.0 * value));
        assert_eq!((found.mean, found.pairing), (27.0, Pairing::Episode));
        assert!(found.of_seeds.is_empty());
        // Variances of the means 2.5 / 5 and 250 / 5: error sqrt(50.5), freedom 50.5^2 / ((0.5^2 + 50^2) / 4).
        let freedom = 50.5 * 50.5 / (2500.25 / 4.0);
        assert_near(found.interval.unwrap().low, 27.0 - student_t(freedom) * 50.5_f64.sqrt());
        let sure = side(FIVE.map(|_| played(0, &[1.0])));
        assert_eq!(between(&sure, &others(|_| 3.0)).interval, Some(Bounds { low: 2.0, high: 2.0 }));
    }

    #[test]
    fn a_controller_is_compared_on_the_first_of_the_same_episodes_and_on_others_without_an_interval() {
        // The further episodes are far better, which must not count.
        let long = side(FIVE.map(|above| played(0, &[10.0 + above, 14.0 + above, 99.0])));
        let group = side(FIVE.map(|above| played(0, &[10.0 + above, 14.0 + above])));
        for (group, controller) in [(&group, &[10.0, 14.0][..]), (&group, &[10.0, 14.0, 99.0]), (&long, &[10.0, 14.0])]
        {
            let found = to_controller(group, &played(0, controller));
            assert_eq!((found.mean, found.pairing), (3.0, Pairing::Episode));
            assert_near(found.interval.unwrap().low, 3.0 - student_t(4.0) * 0.5_f64.sqrt());
        }
        assert_eq!(to_controller(&group, &played(1, &[10.0, 14.0])).interval, None);
    }
}
