//! AIPs (approximate influence predictors) that correct constants: the outputs of a network are added to the logits of
//! the constants of the part of the episode. Where that does not pay, a source keeps its constants.
//!
//! Where cars are rare, a network alone is worse than constants, because it learns what only its training episodes show.
//! A correction begins at the constants, and the held-out episodes decide source by source whether it stays.

use std::ops::Range;

use super::aip::AipStack;
use super::descent::{self, Constants, ConstantsOfAgent};
use super::parts::{PartFrequencies, part_of};
use super::{CrossEntropies, Dataset, InfluencePredictor, TrainablePredictor, sources};
use crate::config::AipConfig;
use anyhow::ensure;
use dials_core::base::{AgentId, Dice, Rows, Seed, Stopwatch, Work};
use dials_core::domain::{RegionSpec, Result, SourceSpec};
use stacknets::Layout;

/// Least probability of a class, half an event in 1e6, so that logits are finite.
const LEAST: f64 = 5e-7;

/// One AIP per agent with its constants.
pub struct CorrectingAips {
    aips: AipStack,
    /// Logits of the constants, one row per agent: `[parts, logits]`.
    constants: Rows<f32>,
    /// 1 for each source that listens to the network, 0 for one that keeps its constants, one row per agent.
    listens: Rows<f32>,
    /// Number of rows of one agent that it samples for.
    copies: usize,
}

impl CorrectingAips {
    /// Returns the layout of a row of values: the network, the logits of the constants, and which sources listen.
    pub(crate) fn layout(spec: &RegionSpec, config: &AipConfig) -> Layout {
        let network = AipStack::shape(spec, config).layout();
        let blocks = network.blocks(1).map(|(name, shape, _)| (name.to_owned(), shape[1..].to_vec()));
        let more = [
            ("constants".to_owned(), vec![spec.sources.parts.max(1), spec.sources.logits()]),
            ("listens".to_owned(), vec![spec.sources.count()]),
        ];
        Layout::new(blocks.chain(more).collect())
    }

    /// Makes AIPs whose corrections are zero. Before the first training all values of a source are equally probable.
    pub(crate) fn new(agents: &[AgentId], spec: &RegionSpec, config: &AipConfig, seed: Seed) -> CorrectingAips {
        let mut aips = AipStack::new(agents, spec, config, seed);
        aips.silence();
        let mut listens = Rows::new(agents.len(), spec.sources.count());
        listens.fill(1.0);
        let constants = Rows::new(agents.len(), spec.sources.parts.max(1) * spec.sources.logits());
        CorrectingAips { aips, constants, listens, copies: 0 }
    }

    /// Returns an error if it is neither 0 nor 1 whether a source listens. `values`: a row as [`CorrectingAips::layout`]
    /// describes it.
    pub(super) fn check(sources: &SourceSpec, values: &[f32]) -> Result<()> {
        let listens = &values[values.len() - sources.count()..];
        let wrong = listens.iter().position(|&listens| listens != 0.0 && listens != 1.0);
        ensure!(
            wrong.is_none(),
            "influence source {} listens to its AIP by {}, which is neither 0 nor 1",
            wrong.unwrap_or(0),
            listens[wrong.unwrap_or(0)]
        );
        Ok(())
    }

    fn all(&self) -> Constants<'_> {
        Constants { logits: &self.constants, listens: &self.listens }
    }

    /// Sets the constants of an agent. `probabilities`: `[parts][sources][classes]`.
    fn set_constants(&mut self, agent: usize, probabilities: &[Vec<Vec<f64>>]) {
        let logits = probabilities.iter().flatten().flat_map(|classes| logits(classes));
        self.constants.row_mut(agent).iter_mut().zip(logits).for_each(|(place, logit)| *place = logit as f32);
    }
}

/// Returns the logits of a distribution: one for a bit, else one per class.
fn logits(classes: &[f64]) -> Vec<f64> {
    let bounded = |p: f64| p.clamp(LEAST, 1.0 - LEAST);
    match classes {
        &[_, p] => vec![(bounded(p) / (1.0 - bounded(p))).ln()],
        classes => classes.iter().map(|&p| p.max(LEAST).ln()).collect(),
    }
}

impl InfluencePredictor for CorrectingAips {
    fn begin(&mut self, rows: usize) {
        self.aips.begin(rows);
        self.copies = rows / self.constants.len();
    }

    fn forget(&mut self, rows: &[usize]) {
        self.aips.forget(rows);
    }

    fn watch(&mut self, d_set: &Rows<f32>) {
        self.aips.watch(d_set);
    }

    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>) {
        let mut outputs = self.aips.outputs(d_set);
        let spec = self.aips.sources();
        let (width, count) = (spec.logits(), spec.count());
        let rows = sources.as_mut_slice().chunks_exact_mut(count).zip(dice);
        let outputs = outputs.as_mut_slice().chunks_exact_mut(width);
        for (row, ((sources, dice), logits)) in rows.zip(outputs).enumerate() {
            let agent = row / self.copies;
            let constants = ConstantsOfAgent::new(self.constants.row(agent), self.listens.row(agent));
            constants.correct(spec, part_of(spec, d_set.row(row)), logits);
            sources::sample(spec, logits, dice, sources);
        }
    }
}

impl TrainablePredictor for CorrectingAips {
    fn sources(&self) -> &SourceSpec {
        self.aips.sources()
    }

    fn values(&self) -> Rows<f32> {
        let networks = self.aips.values();
        let width = networks.width() + self.constants.width() + self.listens.width();
        let rows = networks.iter().zip(self.constants.iter()).zip(self.listens.iter());
        let values = rows.flat_map(|((network, constants), listens)| [network, constants, listens].concat());
        Rows::from_vec(values.collect(), width)
    }

    fn load(&mut self, values: &Rows<f32>) {
        let mut networks = self.aips.values();
        for (agent, row) in values.iter().enumerate() {
            let (network, others) = row.split_at(networks.width());
            let (constants, listens) = others.split_at(self.constants.width());
            networks.row_mut(agent).copy_from_slice(network);
            self.constants.row_mut(agent).copy_from_slice(constants);
            self.listens.row_mut(agent).copy_from_slice(listens);
        }
        self.aips.load(&networks);
    }

    fn learn(
        &mut self,
        datasets: &[Dataset],
        samples: usize,
        config: &AipConfig,
        dice: &mut [Dice],
        work: Work<'_, f64>,
    ) {
        let Work { watch, progress } = work;
        let spec = self.aips.sources().clone();
        let frequencies: Vec<PartFrequencies> =
            datasets.iter().map(|dataset| PartFrequencies::of(&spec, dataset, 0..samples)).collect();
        for (agent, frequencies) in frequencies.iter().enumerate() {
            self.set_constants(agent, &frequencies.probabilities());
        }
        self.listens.fill(1.0);
        let constants = Constants { logits: &self.constants, listens: &self.listens };
        let work = Work { watch: &mut *watch, progress };
        descent::learn(&mut self.aips, Some(constants), datasets, samples, config, dice, work);
        let held_out = samples..datasets[0].len();
        let corrected = descent::cross_entropies(&self.aips, Some(self.all()), datasets, held_out.clone(), watch);
        for (agent, (dataset, corrected)) in datasets.iter().zip(corrected).enumerate() {
            let seen = PartFrequencies::of(&spec, dataset, held_out.clone());
            let constant = seen.cross_entropies(&frequencies[agent].probabilities());
            let losses = corrected.iter().zip(constant).zip(frequencies[agent].whole());
            for (listens, ((corrected, constant), whole)) in self.listens.row_mut(agent).iter_mut().zip(losses) {
                // A source that never happened gave the network nothing to learn.
                let happened = whole[0] < 1.0;
                *listens = f32::from(u8::from(happened && *corrected < constant));
            }
        }
    }

    fn cross_entropies(
        &self,
        datasets: &[Dataset],
        samples: Range<usize>,
        watch: &mut Stopwatch,
    ) -> Vec<CrossEntropies> {
        descent::cross_entropies(&self.aips, Some(self.all()), datasets, samples, watch)
    }

    fn on_marginals(&self, agent: usize) -> Vec<bool> {
        self.listens.row(agent).iter().map(|&listens| listens == 0.0).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predictors::{AipLoss, train};
    use rand::Rng;

    fn spec(parts: usize, sources: usize) -> RegionSpec {
        let sources = SourceSpec { parts, ..SourceSpec::bits(sources) };
        RegionSpec { obs_dim: 1, d_set_dim: 4, n_actions: 2, masks: false, sources, horizon: 100, local_horizon: 100 }
    }

    /// Makes 200 episodes of two parts. Source 0 happens with probability 0.9 if the third column is 1, else with 0.2.
    /// Source 1 is a coin that falls on 1 with probability 0.1 in the first half and 0.6 in the second. Source 2 never
    /// happens.
    fn dataset() -> Dataset {
        let mut dataset = Dataset::new(&spec(2, 3));
        let mut dice = Seed::new(21).dice();
        for sample in 0..20_000 {
            let late = sample % 100 >= 50;
            let x: [bool; 2] = dice.random();
            let u =
                [dice.random_bool(if x[0] { 0.9 } else { 0.2 }), dice.random_bool(if late { 0.6 } else { 0.1 }), false];
            dataset.push(&[!late, late, x[0], x[1]].map(|bit| f32::from(u8::from(bit))), &u.map(u8::from));
        }
        dataset
    }

    fn config() -> AipConfig {
        AipConfig {
            hidden: vec![16],
            learning_rate: 1e-3,
            epochs: 12,
            patience: Some(3),
            correct_marginals: true,
            ..AipConfig::default()
        }
    }

    fn trained() -> (CorrectingAips, AipLoss) {
        let agents = [AgentId(0)];
        let mut aips = CorrectingAips::new(&agents, &spec(2, 3), &config(), Seed::new(1));
        let work = Work { watch: &mut Stopwatch::default(), progress: &mut |_| () };
        let loss = train(&mut aips, &agents, &[dataset()], &config(), Seed::new(2), work).remove(0);
        (aips, loss)
    }

    #[test]
    fn it_learns_what_the_d_set_tells_and_is_never_worse_than_marginals_on_held_out_episodes() {
        let (_, loss) = trained();
        // H(0.9) = 0.3251 and H(0.2) = 0.5004, each half of the time: 0.4127. Marginals: H(0.55) = 0.6881.
        assert!((loss.held_out[1][0] - 0.4127).abs() < 0.04 && (loss.marginals[0] - 0.6881).abs() < 0.01, "{loss:?}");
        // H(0.1) = 0.3251 and H(0.6) = 0.6730: 0.4991. The parts tell all there is to know.
        // 2000 samples: standard error 0.013.
        assert!((loss.held_out[1][1] - 0.4991).abs() < 0.05 && (loss.marginals[1] - 0.4991).abs() < 0.05, "{loss:?}");
        for source in 0..3 {
            assert!(loss.held_out[1][source] <= loss.marginals[source] + 1e-6, "{loss:?}");
        }
        assert_eq!([loss.on_marginals[0], loss.on_marginals[2]], [false, true], "the third one never happened");
    }

    #[test]
    fn what_it_learnt_is_kept_as_values() {
        let (aips, _) = trained();
        let values = aips.values();
        assert_eq!(values.width(), CorrectingAips::layout(&spec(2, 3), &config()).width());
        CorrectingAips::check(&aips.sources().clone(), values.row(0)).unwrap();
        let mut again = CorrectingAips::new(&[AgentId(0)], &spec(2, 3), &config(), Seed::new(9));
        again.load(&values);
        let losses = |aips: &CorrectingAips| aips.cross_entropies(&[dataset()], 0..20_000, &mut Stopwatch::default());
        assert_eq!(losses(&again), losses(&aips));
        assert_eq!(again.on_marginals(0), aips.on_marginals(0));
        let mut wrong = values.row(0).to_vec();
        *wrong.last_mut().unwrap() = 0.5;
        let error = CorrectingAips::check(aips.sources(), &wrong).unwrap_err().to_string();
        assert_eq!(error, "influence source 2 listens to its AIP by 0.5, which is neither 0 nor 1");
    }

    #[test]
    fn a_source_that_does_not_listen_is_drawn_from_the_marginals_of_its_part() {
        let spec = spec(2, 2);
        let config = AipConfig { hidden: vec![1], ..config() };
        let mut aips = CorrectingAips::new(&[AgentId(0)], &spec, &config, Seed::new(0));
        // The hidden unit is off; the output biases are ln 9 = 2.1972. Constants: 0.1 and 0.5, then 0.5 and 0.9. The
        // first source listens: 9 times its odds.
        let ln9 = 9_f32.ln();
        let network = [0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, ln9, ln9];
        let values = [&network[..], &[-ln9, 0.0, 0.0, ln9], &[1.0, 0.0]].concat();
        let width = values.len();
        aips.load(&Rows::from_vec(values, width));
        let rows = 20_000;
        let mut dice: Vec<Dice> = (0..rows).map(|copy| Seed::new(9).for_copy(copy).dice()).collect();
        let d_sets = (0..rows).flat_map(|row| if row < 10_000 { [1.0, 0.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0, 0.0] });
        let d_sets = Rows::from_vec(d_sets.collect(), 4);
        let mut drawn = Rows::new(rows, 2);
        aips.begin(rows);
        aips.sample(&d_sets, &mut dice, &mut drawn);
        let share = |half: usize, source: usize| {
            (half * 10_000..(half + 1) * 10_000).filter(|&row| drawn.row(row)[source] == 1).count() as f64 / 1e4
        };
        // Standard errors of 10000 draws: at most 0.005.
        for (half, source, expected) in [(0, 0, 0.5), (0, 1, 0.5), (1, 0, 0.9), (1, 1, 0.9)] {
            assert!((share(half, source) - expected).abs() < 0.02, "{half} {source}: {}", share(half, source));
        }
    }
}
