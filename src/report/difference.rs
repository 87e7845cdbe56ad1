//! Differences of final returns: paired by episode and by seed where both sides played the same episodes.
//!
//! The difference of a seed is the mean over the episodes of the difference in each. So what the traffic of these episodes
//! adds to both sides drops out, and only the seeds are left to spread. What is said of a difference is said of these
//! episodes.

use crate::base::statistics::mean;

use super::find::Baseline;
use super::statistics::{Bounds, Estimate, interval_of, welch};
use crate::records::run_record::RunRecord;

/// The episodes of an evaluation. Evaluations with the same ones saw the same traffic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Episodes {
    /// `evaluation.seed`
    pub seed: u64,
    pub count: usize,
}

/// What a run, or a controller, came to on its episodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Played {
    /// Mean return of all agents.
    pub mean: f64,
    /// Number of episodes, if it is known.
    pub count: Option<usize>,
    /// The episodes with the mean return of all agents in each; `None` for files of versions that did not write them down.
    pub on: Option<(Episodes, Vec<f64>)>,
}

impl Played {
    /// A run at a step; between two evaluations it has no episodes.
    pub fn of_run(run: &RunRecord, steps: u64) -> Option<Played> {
        let here = run.evaluations.iter().find(|evaluation| evaluation.steps == steps);
        let returns = here.map(|evaluation| evaluation.episode_returns.clone()).unwrap_or_default();
        Some(Played {
            mean: run.return_at(steps)?,
            count: here.and_then(|evaluation| evaluation.episodes),
            on: on(Some(run.config.evaluation.seed), returns),
        })
    }

    pub fn of_controller(controller: &Baseline) -> Played {
        Played {
            mean: controller.mean_return,
            count: Some(controller.episodes),
            on: on(controller.seed, controller.episode_returns.clone()),
        }
    }

    pub fn episodes(&self) -> Option<Episodes> {
        self.on.as_ref().map(|(episodes, _)| *episodes)
    }
}

fn on(seed: Option<u64>, returns: Vec<f64>) -> Option<(Episodes, Vec<f64>)> {
    let episodes = Episodes { seed: seed?, count: returns.len() };
    (!returns.is_empty()).then_some((episodes, returns))
}

/// The episodes that all of them have in common.
pub fn common_episodes<'a>(mut all: impl Iterator<Item = &'a Played>) -> Option<Episodes> {
    let first = all.next()?.episodes()?;
    all.all(|played| played.episodes() == Some(first)).then_some(first)
}

/// What is subtracted from what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pairing {
    /// The same seed on the same episode.
    EpisodeAndSeed,
    /// The same episode; the seeds are not the same, or the other side is a controller and has none.
    Episode,
    /// The same seed; the episodes are not known to be the same.
    Seed,
    /// Only means.
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

    /// Whether both sides played the same episodes.
    pub fn by_episode(self) -> bool {
        matches!(self, Pairing::EpisodeAndSeed | Pairing::Episode)
    }
}

/// How much higher the final return of one side is.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    pub mean: f64,
    pub pairing: Pairing,
    /// Seeds of either side; a controller has the other side's.
    pub seeds: [usize; 2],
    /// Differences seed by seed; empty if the seeds of two groups are not the same.
    pub of_seeds: Vec<(u64, f64)>,
    /// Student's t interval of 95 % over seeds. `None` with too few of them, and where the episodes differ between the sides
    /// but not between the seeds of a side: then the chance of the traffic is in the difference and not in its spread.
    pub interval: Option<Bounds>,
}

/// A side: the runs of a group by seed.
pub type Side = Vec<(u64, Played)>;

/// `b - a`, of two groups.
///
/// Panics if a side is empty.
pub fn between(a: &Side, b: &Side) -> Difference {
    let all = || a.iter().chain(b).map(|(_, played)| played);
    let same_episodes = common_episodes(all()).is_some();
    // Versions that did not write episodes down gave every seed its own: then its spread holds the traffic's, too.
    let own_episodes = all().all(|played| played.on.is_none());
    let same_seeds = a.len() == b.len() && a.iter().zip(b).all(|((left, _), (right, _))| left == right);
    let [of_a, of_b] = [a, b].map(means);
    let of_seeds: Vec<(u64, f64)> = match same_seeds {
        true => a.iter().zip(b).map(|((seed, a), (_, b))| (*seed, of_pair(a, b))).collect(),
        false => Vec::new(),
    };
    let interval = match same_seeds {
        true => interval_of(&values(&of_seeds)),
        false => Estimate::of(&of_a).zip(Estimate::of(&of_b)).map(|(a, b)| welch(a, b)),
    };
    Difference {
        mean: mean(&of_b) - mean(&of_a),
        pairing: match (same_episodes, same_seeds) {
            (true, true) => Pairing::EpisodeAndSeed,
            (true, false) => Pairing::Episode,
            (false, true) => Pairing::Seed,
            (false, false) => Pairing::Nothing,
        },
        seeds: [a.len(), b.len()],
        of_seeds,
        interval: interval.filter(|_| same_episodes || own_episodes),
    }
}

/// A group minus a controller.
///
/// Panics if the group is empty.
pub fn to_controller(group: &Side, controller: &Baseline) -> Difference {
    let rival = Played::of_controller(controller);
    let all = group.iter().map(|(_, played)| played).chain([&rival]);
    let same_episodes = common_episodes(all).is_some();
    let of_seeds: Vec<(u64, f64)> = group.iter().map(|(seed, own)| (*seed, of_pair(&rival, own))).collect();
    let own_episodes = group.iter().all(|(_, played)| played.on.is_none());
    let of_controller = (controller.episodes > 1).then(|| Estimate {
        mean: controller.mean_return,
        variance: controller.std_error.powi(2),
        freedom: (controller.episodes - 1) as f64,
    });
    let interval = match (same_episodes, own_episodes) {
        (true, _) => interval_of(&values(&of_seeds)),
        (false, true) => of_controller.zip(Estimate::of(&means(group))).map(|(a, b)| welch(a, b)),
        (false, false) => None,
    };
    Difference {
        mean: mean(&values(&of_seeds)),
        pairing: if same_episodes { Pairing::Episode } else { Pairing::Nothing },
        seeds: [group.len(); 2],
        of_seeds,
        interval,
    }
}

/// `b - a`: the mean over the episodes of the difference in each, or the difference of the means if the episodes differ.
fn of_pair(a: &Played, b: &Played) -> f64 {
    match (&a.on, &b.on) {
        (Some((of_a, a)), Some((of_b, b))) if of_a == of_b => {
            mean(&a.iter().zip(b).map(|(a, b)| b - a).collect::<Vec<_>>())
        }
        _ => b.mean - a.mean,
    }
}

fn means(side: &Side) -> Vec<f64> {
    side.iter().map(|(_, played)| played.mean).collect()
}

fn values(of_seeds: &[(u64, f64)]) -> Vec<f64> {
    of_seeds.iter().map(|(_, difference)| *difference).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::statistics::student_t;

    fn assert_near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
    }

    fn played(seed: u64, returns: &[f64]) -> Played {
        Played { mean: mean(returns), count: Some(returns.len()), on: on(Some(seed), returns.to_vec()) }
    }

    /// A run of a version that did not write its episodes down.
    fn old(mean: f64) -> Played {
        Played { mean, count: Some(20), on: None }
    }

    /// Seeds 1, 2, ... with these runs.
    fn side(runs: impl IntoIterator<Item = Played>) -> Side {
        (1..).zip(runs).collect()
    }

    fn controller(seed: Option<u64>, episode_returns: &[f64]) -> Baseline {
        Baseline {
            scenario: "traffic-4-300".to_owned(),
            controller: "gap-out".to_owned(),
            mean_return: 12.0,
            std_error: 1.0,
            episodes: 40,
            seed,
            episode_returns: episode_returns.to_vec(),
        }
    }

    #[test]
    fn the_same_seeds_on_the_same_episodes_are_paired_by_both() {
        // Episodes of 10 and 50; b is above a by s + 1 in the first and by s - 1 in the second, so by s.
        let a = side((1..=5).map(|_| played(0, &[10.0, 50.0])));
        let b = side((1..=5).map(|seed| played(0, &[11.0 + f64::from(seed), 49.0 + f64::from(seed)])));
        let found = between(&a, &b);
        assert_eq!((found.pairing, found.seeds), (Pairing::EpisodeAndSeed, [5, 5]));
        assert_eq!(found.of_seeds, [(1, 1.0), (2, 2.0), (3, 3.0), (4, 4.0), (5, 5.0)]);
        // Mean 3, variance 2.5, error sqrt(0.5).
        assert_near(found.mean, 3.0);
        assert_near(found.interval.unwrap().high, 3.0 + student_t(4.0) * 0.5_f64.sqrt());
    }

    #[test]
    fn with_three_seeds_there_are_their_differences_and_no_interval() {
        let a = side([10.0, 20.0, 30.0].map(|value| played(0, &[value, value])));
        let b = side([11.0, 22.0, 33.0].map(|value| played(0, &[value, value])));
        let found = between(&a, &b);
        assert_eq!((found.mean, found.interval), (2.0, None));
        assert_eq!(found.of_seeds, [(1, 1.0), (2, 2.0), (3, 3.0)]);
    }

    #[test]
    fn other_seeds_on_the_same_episodes_are_compared_as_welch_does() {
        let values = [1.0, 2.0, 3.0, 4.0, 5.0];
        let a = side(values.map(|value| played(0, &[value])));
        let b: Side = (11..).zip(values.map(|value| played(0, &[value + 7.0]))).collect();
        let found = between(&a, &b);
        assert_eq!((found.mean, found.pairing), (7.0, Pairing::Episode));
        assert!(found.of_seeds.is_empty());
        // Both variances 0.5: error 1, freedom 1 / (2 x 0.25 / 4) = 8.
        assert_near(found.interval.unwrap().low, 7.0 - student_t(8.0));
    }

    #[test]
    fn episodes_that_differ_between_the_sides_alone_leave_no_interval() {
        let values = [1.0, 2.0, 3.0, 4.0, 5.0];
        let on = |seed, episodes: usize| side(values.map(|value| played(seed, &vec![value; episodes])));
        for (a, b) in [(on(0, 2), on(1, 2)), (on(0, 2), on(0, 3)), (on(0, 2), side(values.map(old)))] {
            let found = between(&a, &b);
            assert_eq!((found.mean, found.pairing, found.interval), (0.0, Pairing::Seed, None));
            assert_eq!(found.of_seeds.len(), 5, "the seeds are told all the same");
        }
        let found = between(&side(values.map(old)), &side(values.map(old)));
        assert_eq!(found.pairing, Pairing::Seed);
        assert!(found.interval.is_some(), "each seed had its own episodes");
    }

    #[test]
    fn a_controller_is_subtracted_episode_by_episode_from_every_seed() {
        let group = side([1.0, 2.0, 3.0, 4.0, 5.0].map(|above| played(0, &[10.0 + above, 14.0 + above])));
        let found = to_controller(&group, &controller(Some(0), &[10.0, 14.0]));
        assert_eq!((found.mean, found.pairing), (3.0, Pairing::Episode));
        assert_near(found.interval.unwrap().low, 3.0 - student_t(4.0) * 0.5_f64.sqrt());
    }

    #[test]
    fn a_controller_on_other_episodes_brings_its_own_error_or_there_is_no_interval() {
        let values = [11.0, 12.0, 13.0, 14.0, 15.0];
        let of_old = to_controller(&side(values.map(old)), &controller(None, &[]));
        assert_eq!((of_old.mean, of_old.pairing), (1.0, Pairing::Nothing));
        // Variances 0.5 and 1: freedom 1.5^2 / (0.25 / 4 + 1 / 39) = 25.527273.
        let half = student_t(2.25 / (0.0625 + 1.0 / 39.0)) * 1.5_f64.sqrt();
        assert_near(of_old.interval.unwrap().high, 1.0 + half);
        let of_new = to_controller(&side(values.map(|value| played(0, &[value]))), &controller(Some(1), &[12.0]));
        assert_eq!((of_new.mean, of_new.pairing, of_new.interval), (1.0, Pairing::Nothing, None));
    }
}
