//! How often influence sources took their values, part by part of the episode: the constants that AIPs are compared with.
//!
//! Domains whose traffic changes within an episode have parts, which the first columns of their d-sets show. Without
//! parts there is one constant per source.

use std::ops::Range;

use super::marginals::cross_entropy_of_constants;
use super::{CrossEntropies, Dataset};
use dials_core::domain::SourceSpec;

/// Number of samples with which the frequency in the whole episode counts in each part. So a part of few samples is not
/// taken for more than it says.
const SAMPLES_OF_THE_WHOLE: f64 = 20.0;

/// Shares of the values of all sources in each part of the episode.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PartFrequencies {
    /// Number of samples of each part.
    samples: Vec<u64>,
    /// `[parts][sources][classes]`; zeros in a part without samples.
    shares: Vec<Vec<Vec<f64>>>,
}

/// Returns the part of the episode that a d-set shows; 0 without parts.
pub(super) fn part_of(sources: &SourceSpec, d_set: &[f32]) -> usize {
    d_set[..sources.parts].iter().position(|&bit| bit == 1.0).unwrap_or(0)
}

impl PartFrequencies {
    /// Counts in some of the samples.
    pub(super) fn of(sources: &SourceSpec, dataset: &Dataset, range: Range<usize>) -> PartFrequencies {
        let zeros: Vec<Vec<u64>> = sources.classes.iter().map(|&classes| vec![0; usize::from(classes)]).collect();
        let parts = sources.parts.max(1);
        let (mut samples, mut counts) = (vec![0; parts], vec![zeros; parts]);
        let mut d_set = vec![0.0; dataset.d_sets.width()];
        for sample in range {
            let part = if sources.parts > 0 {
                dataset.d_sets.read(sample, &mut d_set);
                part_of(sources, &d_set)
            } else {
                0
            };
            samples[part] += 1;
            let observed = dataset.sources.row(sample);
            counts[part].iter_mut().zip(observed).for_each(|(counts, &u)| counts[usize::from(u)] += 1);
        }
        let share = |count: u64, samples: u64| if samples == 0 { 0.0 } else { count as f64 / samples as f64 };
        let shares = counts.into_iter().zip(&samples).map(|(of_part, &samples)| {
            let of_source = |counts: Vec<u64>| counts.into_iter().map(|count| share(count, samples)).collect();
            of_part.into_iter().map(of_source).collect()
        });
        PartFrequencies { shares: shares.collect(), samples }
    }

    /// Returns the frequencies in the whole episode, `[sources][classes]`.
    pub(super) fn whole(&self) -> Vec<Vec<f64>> {
        if let [of_part] = &self.shares[..] {
            return of_part.clone();
        }
        let all = self.samples.iter().sum::<u64>() as f64;
        let mut whole: Vec<Vec<f64>> = self.shares[0].iter().map(|classes| vec![0.0; classes.len()]).collect();
        for (of_part, &samples) in self.shares.iter().zip(&self.samples) {
            for (sum, share) in whole.iter_mut().flatten().zip(of_part.iter().flatten()) {
                *sum += share * samples as f64 / all;
            }
        }
        whole
    }

    /// Returns the probabilities with which to predict the sources in each part, `[parts][sources][classes]`. With
    /// several parts, each is drawn a little to the whole.
    pub(super) fn probabilities(&self) -> Vec<Vec<Vec<f64>>> {
        if self.shares.len() == 1 {
            return self.shares.clone();
        }
        let whole = self.whole();
        let of_part = |(of_part, &samples): (&Vec<Vec<f64>>, &u64)| {
            let drawn = |(share, whole): (&f64, &f64)| {
                (share * samples as f64 + whole * SAMPLES_OF_THE_WHOLE) / (samples as f64 + SAMPLES_OF_THE_WHOLE)
            };
            let of_source = |(shares, whole): (&Vec<f64>, &Vec<f64>)| shares.iter().zip(whole).map(drawn).collect();
            of_part.iter().zip(&whole).map(of_source).collect()
        };
        self.shares.iter().zip(&self.samples).map(of_part).collect()
    }

    /// Returns the mean cross-entropy of every source if it is predicted with these probabilities,
    /// `[parts][sources][classes]`.
    pub(super) fn cross_entropies(&self, probabilities: &[Vec<Vec<f64>>]) -> CrossEntropies {
        let all = self.samples.iter().sum::<u64>() as f64;
        let mut sums = vec![0.0; self.shares[0].len()];
        for ((p, q), &samples) in probabilities.iter().zip(&self.shares).zip(&self.samples) {
            for (sum, (p, q)) in sums.iter_mut().zip(p.iter().zip(q)) {
                *sum += samples as f64 / all * cross_entropy_of_constants(p, q);
            }
        }
        sums
    }

    /// Returns the mean cross-entropy of every source under the best constants for these very samples.
    pub(super) fn entropies(&self) -> CrossEntropies {
        self.cross_entropies(&self.shares)
    }
}
