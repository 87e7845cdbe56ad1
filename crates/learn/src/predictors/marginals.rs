//! Constant predictors: how often each influence source took each value on the GS, whatever the d-set shows.
//!
//! They are the predictors of marginal-DIALS, and the yardstick for the loss of the AIPs. In a domain whose episodes have
//! parts, they are constant within each part.

use std::ops::Range;

use anyhow::ensure;
use rand::Rng;

use super::parts::{PartFrequencies, part_of};
use super::sources::of_sources;
use super::{CrossEntropies, Dataset, InfluencePredictor, Lesson, PredictorKind, TrainablePredictor};
use crate::config::AipConfig;
use dials_core::base::{AgentId, Dice, Rows, Seed, Stopwatch, Work};
use dials_core::domain::sampling::invert;
use dials_core::domain::{RegionSpec, Result, SourceSpec};
use stacknets::Layout;

/// One constant distribution per agent and source, and per part of the episode.
pub struct Marginals {
    sources: SourceSpec,
    /// Probabilities, one row per agent, part after part: those of all classes of each source, source after source.
    probabilities: Rows<f32>,
    /// Number of rows of one agent that it samples for.
    copies: usize,
}

impl Marginals {
    /// Makes predictors for which all classes are equally probable, as nothing is measured yet.
    pub(crate) fn new(agents: usize, spec: &RegionSpec) -> Self {
        let sources = spec.sources.clone();
        let equal = |&classes: &u8| std::iter::repeat_n(1.0 / f32::from(classes), usize::from(classes));
        let of_agent: Vec<f32> = sources.classes.iter().flat_map(equal).collect();
        let parts = sources.parts.max(1);
        let probabilities = Rows::from_vec(of_agent.repeat(parts * agents), parts * sources.values());
        Marginals { sources, probabilities, copies: 0 }
    }
}

impl InfluencePredictor for Marginals {
    fn begin(&mut self, rows: usize) -> Result<()> {
        self.copies = rows / self.probabilities.len();
        Ok(())
    }

    fn forget(&mut self, _rows: &[usize]) -> Result<()> {
        Ok(())
    }

    fn watch(&mut self, _d_set: &Rows<f32>) -> Result<()> {
        Ok(())
    }

    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>) -> Result<()> {
        let count = self.sources.count();
        for (row, (sources, dice)) in sources.as_mut_slice().chunks_exact_mut(count).zip(dice).enumerate() {
            let width = self.sources.values();
            let begin = part_of(&self.sources, d_set.row(row)) * width;
            let of_part = &self.probabilities.row(row / self.copies)[begin..begin + width];
            for (source, probabilities) in sources.iter_mut().zip(of_sources(&self.sources, of_part, usize::from)) {
                let last = || probabilities.iter().rposition(|&p| p > 0.0);
                let drawn = invert(probabilities.iter().copied(), dice.random()).or_else(last);
                *source = drawn.expect("some class was seen") as u8;
            }
        }
        Ok(())
    }
}

impl TrainablePredictor for Marginals {
    fn sources(&self) -> &SourceSpec {
        &self.sources
    }

    fn values(&self) -> Rows<f32> {
        self.probabilities.clone()
    }

    fn load(&mut self, values: &Rows<f32>) {
        self.probabilities.copy_from(values);
    }

    fn learn(&mut self, lesson: Lesson<'_>, _dice: &mut [Dice], work: Work<'_, f64>) {
        for (agent, dataset) in lesson.datasets.iter().enumerate() {
            let measured = PartFrequencies::of(&self.sources, dataset, 0..lesson.samples).probabilities();
            let measured = measured.into_iter().flatten().flatten();
            self.probabilities.row_mut(agent).iter_mut().zip(measured).for_each(|(p, measured)| *p = measured as f32);
        }
        (work.progress)(1.0);
    }

    fn losses(&self, datasets: &[Dataset], samples: Range<usize>, _: &mut Stopwatch) -> Vec<CrossEntropies> {
        let per_agent = datasets.iter().zip(self.probabilities.iter()).map(|(dataset, probabilities)| {
            let as_numbers = |classes: &[f32]| classes.iter().map(|&p| f64::from(p)).collect::<Vec<f64>>();
            let of_part = |of_part| of_sources(&self.sources, of_part, usize::from).map(as_numbers).collect();
            let constants: Vec<_> = probabilities.chunks_exact(self.sources.values()).map(of_part).collect();
            PartFrequencies::of(&self.sources, dataset, samples.clone()).cross_entropies(&constants)
        });
        per_agent.collect()
    }
}

/// Counts how often each source took each of its values, `[sources][classes]`, in some of the samples.
pub fn frequencies(sources: &SourceSpec, dataset: &Dataset, samples: Range<usize>) -> Vec<Vec<f64>> {
    PartFrequencies::of(&SourceSpec { parts: 0, ..sources.clone() }, dataset, samples).whole()
}

/// Returns the cross-entropy of predicting the frequencies `p` if the true ones are `q`.
///
/// A class that was never seen in training is predicted as half an event in 1e6. So one surprise in the held-out
/// episodes does not make the mean infinite.
pub(super) fn cross_entropy_of_constants(p: &[f64], q: &[f64]) -> f64 {
    p.iter().zip(q).map(|(p, q)| q * -p.max(5e-7).ln()).sum()
}

/// The kind of [`Marginals`].
pub(super) struct Constants;

impl PredictorKind for Constants {
    fn learns(&self) -> bool {
        true
    }

    fn reads(&self, key: &str) -> bool {
        ["dataset_steps", "first_dataset_share", "held_out", "retrain", "retrain_every_steps", "drift_threshold"]
            .contains(&key)
    }

    fn make(&self, agents: &[AgentId], spec: &RegionSpec, _: &AipConfig, _: Seed) -> Box<dyn TrainablePredictor> {
        Box::new(Marginals::new(agents.len(), spec))
    }

    /// The probabilities are a table `[sources, classes]` if all sources have the same number of classes, else one
    /// source after another. With parts there is one of these for each part.
    fn layout(&self, spec: &RegionSpec, _config: &AipConfig) -> Layout {
        let SourceSpec { classes, parts } = &spec.sources;
        let of_part = match classes[..] {
            [first, ..] if classes.iter().all(|&other| other == first) => vec![classes.len(), usize::from(first)],
            _ => vec![spec.sources.values()],
        };
        let shape = if *parts > 0 { [vec![*parts], of_part].concat() } else { of_part };
        Layout::new(vec![("probabilities".to_owned(), shape)])
    }

    fn check_values(&self, spec: &RegionSpec, _config: &AipConfig, values: &[f32]) -> Result<()> {
        let parts = values.chunks_exact(spec.sources.values());
        for (source, classes) in parts.flat_map(|part| of_sources(&spec.sources, part, usize::from).enumerate()) {
            let sum: f32 = classes.iter().sum();
            ensure!(
                classes.iter().all(|&p| p >= 0.0) && (sum - 1.0).abs() < 1e-3,
                "the probabilities of influence source {source} are {classes:?}, which are no distribution"
            );
        }
        Ok(())
    }

    fn sampling_flops(&self, _spec: &RegionSpec, _config: &AipConfig) -> f64 {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{dice, region, trained};
    use crate::predictors::AipLoss;

    fn spec(sources: SourceSpec) -> RegionSpec {
        region(1, 1, sources, 10)
    }

    /// Makes ten episodes of ten samples whose sources are `u(sample)`.
    fn dataset(spec: &RegionSpec, u: impl Fn(usize) -> Vec<u8>) -> Dataset {
        let mut dataset = Dataset::new(spec);
        (0..100).for_each(|sample| dataset.push(&[0.0], &u(sample)));
        dataset
    }

    fn measured(spec: &RegionSpec, datasets: &[Dataset]) -> (Marginals, Vec<AipLoss>) {
        let mut marginals = Marginals::new(datasets.len(), spec);
        let losses = trained(&mut marginals, datasets, &AipConfig::default());
        (marginals, losses)
    }

    /// Draws the sources of every row once.
    fn drawn(marginals: &mut Marginals, d_set: &Rows<f32>) -> Rows<u8> {
        let mut drawn = Rows::new(d_set.len(), marginals.sources.count());
        marginals.begin(d_set.len()).unwrap();
        marginals.sample(d_set, &mut dice(d_set.len()), &mut drawn).unwrap();
        drawn
    }

    #[test]
    fn they_are_the_frequencies_of_the_training_episodes_and_their_loss_is_worked_out_by_hand() {
        let spec = spec(SourceSpec::bits(1));
        // Agent 0: every third of the 90 training samples, and all ten that are held out. Agent 1: never.
        let datasets = [dataset(&spec, |t| vec![u8::from(t % 3 == 0 || t >= 90)]), dataset(&spec, |_| vec![0])];
        let (mut marginals, losses) = measured(&spec, &datasets);
        assert_eq!(marginals.values().as_slice(), [2.0 / 3.0, 1.0 / 3.0, 1.0, 0.0]);
        // Every copy draws from the frequencies of its agent.
        let drawn = drawn(&mut marginals, &Rows::new(2000, 1));
        let ones = |rows: std::ops::Range<usize>| rows.filter(|&row| drawn.row(row) == [1]).count();
        assert!(ones(0..1000).abs_diff(333) < 60 && ones(1000..2000) == 0, "standard deviation 15");
        // Before: ln 2 everywhere. H(1/3) = 0.636514; held out -ln(1/3) = 1.098612, and 0 if nothing ever happens.
        for (loss, [training, held_out]) in losses.iter().zip([[0.636_514, 1.098_612], [0.0, 0.0]]) {
            assert!((loss.training[0][0] - 2_f64.ln()).abs() < 1e-7 && (loss.held_out[0][0] - 2_f64.ln()).abs() < 1e-7);
            assert!((loss.training[1][0] - training).abs() < 1e-6, "{loss:?}");
            assert!((loss.held_out[1][0] - held_out).abs() < 1e-6, "{loss:?}");
            assert!((loss.marginals[0] - held_out).abs() < 1e-6, "these are the constants that AIPs are compared with");
        }
    }

    #[test]
    fn sources_of_different_numbers_of_classes_keep_their_own_frequencies() {
        let spec = spec(SourceSpec { classes: vec![3, 2], parts: 0 });
        assert_eq!(
            Constants.layout(&spec, &AipConfig::default()).blocks(4).next().unwrap().1,
            [4, 5],
            "four agents, five classes in all"
        );
        let third = 1.0 / 3.0;
        assert_eq!(Marginals::new(1, &spec).values().as_slice(), [third, third, third, 0.5, 0.5]);
        // Among 90 samples every class of the choice comes 30 times, and the bit in every tenth.
        let (mut marginals, _) = measured(&spec, &[dataset(&spec, |t| vec![(t % 3) as u8, u8::from(t % 10 == 0)])]);
        assert_eq!(marginals.values().as_slice(), [third, third, third, 0.9, 0.1]);
        let drawn = drawn(&mut marginals, &Rows::new(10_000, 1));
        // Standard errors: sqrt(2/9 / 10000) = 0.0047 and 0.003.
        let share = |source: usize, class| drawn.iter().filter(|row| row[source] == class).count() as f64 / 1e4;
        assert!((share(0, 2) - 1.0 / 3.0).abs() < 0.019 && (share(1, 1) - 0.1).abs() < 0.012);
    }

    #[test]
    fn in_each_part_of_the_episode_they_have_frequencies_of_their_own() {
        let spec = RegionSpec { d_set_dim: 2, ..spec(SourceSpec { parts: 2, ..SourceSpec::bits(1) }) };
        // The first half of each episode of ten is part 0: the source happens there, and never in part 1.
        let mut dataset = Dataset::new(&spec);
        for sample in 0..1000 {
            let early = sample % 10 < 5;
            dataset.push(&[f32::from(u8::from(early)), f32::from(u8::from(!early))], &[u8::from(early)]);
        }
        let (mut marginals, losses) = measured(&spec, &[dataset]);
        // 450 samples of each part, and 20 of the whole, half of which happen: 460 / 470 and 10 / 470.
        let expected = [10.0 / 470.0, 460.0 / 470.0, 460.0 / 470.0, 10.0 / 470.0];
        assert!(marginals.values().as_slice().iter().zip(expected).all(|(p, expected)| (p - expected).abs() < 1e-6));
        assert_eq!(Constants.layout(&spec, &AipConfig::default()).blocks(1).next().unwrap().1, [1, 2, 1, 2]);
        // -ln(460 / 470) in both parts.
        assert!((losses[0].held_out[1][0] - 0.021_506).abs() < 1e-6 && losses[0].marginals[0] > 0.0);
        let check = |values: &[f32]| Constants.check_values(&spec, &AipConfig::default(), values);
        check(marginals.values().row(0)).unwrap();
        assert!(check(&[0.5, 0.5, 0.5, 0.6]).is_err(), "the second part");
        let d_set: Vec<f32> = (0..2000).flat_map(|row| if row % 2 == 0 { [1.0, 0.0] } else { [0.0, 1.0] }).collect();
        let drawn = drawn(&mut marginals, &Rows::from_vec(d_set, 2));
        let count = |parity: usize| drawn.iter().skip(parity).step_by(2).filter(|row| row[0] == 1).count();
        // 979 and 21 of 1000, standard deviation 4.6.
        assert!(count(0) > 955 && count(1) < 45, "{} {}", count(0), count(1));
    }
}
