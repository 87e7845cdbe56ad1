//! The AIPs of many agents as one stack, alone or as corrections of constants.
//!
//! Where cars are rare, a network alone is worse than constants, because it learns what only its training episodes
//! show. A correction (`aip.correct_marginals`) begins at the constants of the part of the episode: the outputs of the
//! network are added to their logits. The held-out episodes decide source by source whether it stays.
//!
//! # Why not otherwise
//!
//! **Why not a network alone?** Where a source happens once in a thousand steps, the training episodes hold few events.
//! A network learns when they happened there. Constants only learn how often.
//!
//! **Why add logits, and not mix probabilities?** A mixture needs a weight, and a weight per source is one more thing
//! to learn from few events. Added to logits, a network whose output is zero *is* the constants. So the first step of
//! learning begins where constants end, and the loss can only show what the network adds.
//!
//! **Why do the held-out episodes decide, and not a test of significance?** Either choice is safe: the constants stay, or a
//! correction that was better on unseen episodes. A test would need a level, that is, one more setting.

use std::ops::Range;

use anyhow::ensure;

use super::descent::{descend, losses};
use super::parts::{PartFrequencies, part_of};
use super::{CrossEntropies, Dataset, InfluencePredictor, Lesson, PredictorKind, TrainablePredictor, sources};
use crate::config::AipConfig;
use dials_core::base::{AgentId, Dice, Rows, Seed, Stopwatch, Work};
use dials_core::domain::{RegionSpec, Result, SourceSpec, logits_of};
use stacknets::{Layout, Shape, Stack, States};

/// Least probability of a class, half an event in 1e6, so that logits are finite.
const LEAST: f64 = 5e-7;

/// One AIP per agent: d-set -> GRU, if any -> hidden layers -> logits of the influence sources.
///
/// Source: DIALS paper, appendix "Hyperparameters" (traffic: 128 and 128; warehouse: GRU 64 and 64). The inputs are
/// scaled to `(x - 0.5) / 0.5` as in the authors' code.
pub struct AipStack {
    pub(super) sources: SourceSpec,
    pub(super) net: Stack,
    /// What the outputs of the networks correct, if anything.
    pub(super) constants: Option<Constants>,
    /// Hidden states of the rows that it samples for.
    states: States,
    /// Number of rows of one agent that it samples for.
    copies: usize,
}

/// Constants to which the outputs of networks are added. One row per agent each.
pub(super) struct Constants {
    /// Logits of the constants, `[parts, logits]`.
    logits: Rows<f32>,
    /// 1 for a source that listens to the network, 0 for one that keeps its constants, `[sources]`.
    listens: Rows<f32>,
}

impl Constants {
    /// Makes constants for which all values of a source are equally probable. All sources listen.
    fn new(agents: usize, sources: &SourceSpec) -> Constants {
        let mut listens = Rows::new(agents, sources.count());
        listens.fill(1.0);
        Constants { logits: Rows::new(agents, sources.parts.max(1) * sources.logits()), listens }
    }

    /// Adds an agent's constants of a part of the episode to the outputs of its network, which become the logits of one
    /// sample.
    pub(super) fn correct(&self, agent: usize, spec: &SourceSpec, part: usize, outputs: &mut [f32]) {
        let constants = &self.logits.row(agent)[part * spec.logits()..(part + 1) * spec.logits()];
        let widths = spec.classes.iter().map(|&classes| logits_of(classes));
        let listens = self.listens.row(agent).iter().zip(widths);
        let listens = listens.flat_map(|(&listens, width)| std::iter::repeat_n(listens, width));
        for ((output, constant), listens) in outputs.iter_mut().zip(constants).zip(listens) {
            *output = constant + listens * *output;
        }
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

impl AipStack {
    pub fn shape(spec: &RegionSpec, config: &AipConfig) -> Shape {
        Shape {
            sets: None,
            inputs: spec.d_set_dim,
            recurrent: config.recurrent,
            hidden: config.hidden.clone(),
            outputs: spec.sources.logits(),
            apart: 0,
        }
    }

    /// Makes AIPs with random parameters, each agent's from its own stream. Corrections begin at zero.
    pub fn new(agents: &[AgentId], spec: &RegionSpec, config: &AipConfig, seed: Seed) -> Self {
        let net = Stack::new(AipStack::shape(spec, config), seed.for_agents(agents));
        let constants = config.correct_marginals.then(|| Constants::new(agents.len(), &spec.sources));
        let mut aips = AipStack { sources: spec.sources.clone(), states: net.states(0), net, constants, copies: 0 };
        if aips.constants.is_some() {
            aips.silence();
        }
        aips
    }

    /// Returns the layout of a row of values: the network, and for corrections the logits of the constants and which
    /// sources listen.
    fn layout(spec: &RegionSpec, config: &AipConfig) -> Layout {
        let network = AipStack::shape(spec, config).layout();
        if !config.correct_marginals {
            return network;
        }
        let blocks = network.blocks(1).map(|(name, shape, _)| (name.to_owned(), shape[1..].to_vec()));
        let more = [
            ("constants".to_owned(), vec![spec.sources.parts.max(1), spec.sources.logits()]),
            ("listens".to_owned(), vec![spec.sources.count()]),
        ];
        Layout::new(blocks.chain(more).collect())
    }

    /// Makes the last layer zero, so that all outputs are.
    fn silence(&mut self) {
        let layout = self.net.parameters().layout();
        let places: Vec<_> = layout.blocks(1).map(|(_, _, place)| place).collect();
        let last = places[places.len() - 2].start..layout.width();
        let values = self.net.parameters_mut().values_mut();
        (0..values.len()).for_each(|agent| values.row_mut(agent)[last.clone()].fill(0.0));
    }

    fn outputs(&mut self, d_set: &Rows<f32>) -> Rows<f32> {
        let inputs = Rows::from_vec(d_set.as_slice().iter().map(|&x| scaled(x)).collect(), d_set.width());
        self.net.step(&inputs, &mut self.states)
    }

    /// Lets every source listen whose correction is better than its constants on the held-out samples. `frequencies`: of
    /// the others, from which the constants are.
    fn choose_who_listens(&mut self, lesson: Lesson<'_>, frequencies: &[PartFrequencies], watch: &mut Stopwatch) {
        let Lesson { datasets, samples, .. } = lesson;
        let held_out = samples..datasets[0].len();
        let corrected = losses(self, datasets, held_out.clone(), watch);
        let AipStack { sources, constants: Some(constants), .. } = self else { return };
        for (agent, (dataset, corrected)) in datasets.iter().zip(corrected).enumerate() {
            let seen = PartFrequencies::of(sources, dataset, held_out.clone());
            let constant = seen.cross_entropies(&frequencies[agent].probabilities());
            let losses = corrected.iter().zip(constant).zip(frequencies[agent].whole());
            for (listens, ((corrected, constant), whole)) in constants.listens.row_mut(agent).iter_mut().zip(losses) {
                // A source that never happened gave the network nothing to learn.
                let happened = whole[0] < 1.0;
                *listens = f32::from(u8::from(happened && *corrected < constant));
            }
        }
    }
}

pub(super) fn scaled(x: f32) -> f32 {
    (x - 0.5) / 0.5
}

impl InfluencePredictor for AipStack {
    fn begin(&mut self, rows: usize) -> Result<()> {
        self.states = self.net.states(rows);
        self.copies = rows / self.net.parameters().networks();
        Ok(())
    }

    fn forget(&mut self, rows: &[usize]) -> Result<()> {
        rows.iter().for_each(|&row| self.states.clear(row));
        Ok(())
    }

    fn watch(&mut self, d_set: &Rows<f32>) -> Result<()> {
        // Without memory there is nothing to remember.
        if !self.states.as_slice().is_empty() {
            self.outputs(d_set);
        }
        Ok(())
    }

    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>) -> Result<()> {
        let mut outputs = self.outputs(d_set);
        let spec = &self.sources;
        let rows = sources.as_mut_slice().chunks_exact_mut(spec.count()).zip(dice);
        let outputs = outputs.as_mut_slice().chunks_exact_mut(spec.logits());
        for (row, ((sources, dice), logits)) in rows.zip(outputs).enumerate() {
            if let Some(constants) = &self.constants {
                constants.correct(row / self.copies, spec, part_of(spec, d_set.row(row)), logits);
            }
            sources::sample(spec, logits, dice, sources);
        }
        Ok(())
    }
}

impl TrainablePredictor for AipStack {
    fn sources(&self) -> &SourceSpec {
        &self.sources
    }

    fn values(&self) -> Rows<f32> {
        let networks = self.net.parameters().values();
        let Some(Constants { logits, listens }) = &self.constants else { return networks.clone() };
        let width = networks.width() + logits.width() + listens.width();
        let rows = networks.iter().zip(logits.iter()).zip(listens.iter());
        let values = rows.flat_map(|((network, logits), listens)| [network, logits, listens].concat());
        Rows::from_vec(values.collect(), width)
    }

    fn load(&mut self, values: &Rows<f32>) {
        let networks = self.net.parameters_mut();
        let Some(Constants { logits, listens }) = &mut self.constants else { return networks.load(values) };
        for (agent, row) in values.iter().enumerate() {
            let (network, others) = row.split_at(networks.values().width());
            let (constants, their_listens) = others.split_at(logits.width());
            networks.values_mut().row_mut(agent).copy_from_slice(network);
            logits.row_mut(agent).copy_from_slice(constants);
            listens.row_mut(agent).copy_from_slice(their_listens);
        }
    }

    fn learn(&mut self, lesson: Lesson<'_>, dice: &mut [Dice], work: Work<'_, f64>) {
        let Work { watch, progress } = work;
        let mut frequencies: Vec<PartFrequencies> = Vec::new();
        if let Some(constants) = &mut self.constants {
            for (agent, dataset) in lesson.datasets.iter().enumerate() {
                frequencies.push(PartFrequencies::of(&self.sources, dataset, 0..lesson.samples));
                let probabilities = frequencies[agent].probabilities();
                let logits = probabilities.iter().flatten().flat_map(|classes| logits(classes));
                let places = constants.logits.row_mut(agent).iter_mut();
                places.zip(logits).for_each(|(place, logit)| *place = logit as f32);
            }
            constants.listens.fill(1.0);
        }
        descend(self, lesson, dice, Work { watch: &mut *watch, progress });
        if self.constants.is_some() {
            self.choose_who_listens(lesson, &frequencies, watch);
        }
    }

    fn losses(&self, datasets: &[Dataset], samples: Range<usize>, watch: &mut Stopwatch) -> Vec<CrossEntropies> {
        losses(self, datasets, samples, watch)
    }

    fn on_marginals(&self, agent: usize) -> Vec<bool> {
        let listens = self.constants.as_ref().map_or(&[][..], |constants| constants.listens.row(agent));
        listens.iter().map(|&listens| listens == 0.0).collect()
    }
}

/// The kinds of AIPs.
pub(super) enum Aips {
    /// Trained, alone or as corrections of marginals.
    Trained,
    /// Random ones that are never trained.
    Untrained,
}

impl Aips {
    /// Returns the settings that count: those that never learn correct nothing.
    fn settings(&self, config: &AipConfig) -> AipConfig {
        let corrects = config.correct_marginals && self.learns();
        AipConfig { correct_marginals: corrects, ..config.clone() }
    }
}

impl PredictorKind for Aips {
    fn learns(&self) -> bool {
        matches!(self, Aips::Trained)
    }

    fn reads(&self, key: &str) -> bool {
        self.learns() || ["hidden", "recurrent"].contains(&key)
    }

    fn make(&self, agents: &[AgentId], spec: &RegionSpec, aip: &AipConfig, seed: Seed) -> Box<dyn TrainablePredictor> {
        Box::new(AipStack::new(agents, spec, &self.settings(aip), seed))
    }

    fn layout(&self, spec: &RegionSpec, config: &AipConfig) -> Layout {
        AipStack::layout(spec, &self.settings(config))
    }

    /// Checks that each source of a correction either listens or does not.
    fn check_values(&self, spec: &RegionSpec, config: &AipConfig, values: &[f32]) -> Result<()> {
        if self.settings(config).correct_marginals {
            let listens = &values[values.len() - spec.sources.count()..];
            for (source, &listens) in listens.iter().enumerate() {
                ensure!(
                    listens == 0.0 || listens == 1.0,
                    "influence source {source} listens to its AIP by {listens}, which is neither 0 nor 1"
                );
            }
        }
        Ok(())
    }

    fn sampling_flops(&self, spec: &RegionSpec, config: &AipConfig) -> f64 {
        AipStack::shape(spec, config).forward_flops()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{dice, region, trained};
    use rand::Rng;

    fn spec(parts: usize, sources: usize) -> RegionSpec {
        region(1, 4, SourceSpec { parts, ..SourceSpec::bits(sources) }, 100)
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

    #[test]
    fn it_learns_what_the_d_set_shows_and_is_never_worse_than_marginals_on_held_out_episodes() {
        let mut aips = AipStack::new(&[AgentId(0)], &spec(2, 3), &config(), Seed::new(1));
        let loss = trained(&mut aips, &[dataset()], &config()).remove(0);
        // H(0.9) = 0.3251 and H(0.2) = 0.5004, each half of the time: 0.4127. Marginals: H(0.55) = 0.6881.
        assert!((loss.held_out[1][0] - 0.4127).abs() < 0.04 && (loss.marginals[0] - 0.6881).abs() < 0.01, "{loss:?}");
        // H(0.1) = 0.3251 and H(0.6) = 0.6730: 0.4991. The parts say all there is to know.
        // 2000 samples: standard error 0.013.
        assert!((loss.held_out[1][1] - 0.4991).abs() < 0.05 && (loss.marginals[1] - 0.4991).abs() < 0.05, "{loss:?}");
        for source in 0..3 {
            assert!(loss.held_out[1][source] <= loss.marginals[source] + 1e-6, "{loss:?}");
        }
        assert_eq!([loss.on_marginals[0], loss.on_marginals[2]], [false, true], "the third one never happened");

        // What it learnt is kept as values.
        let values = aips.values();
        assert_eq!(values.width(), AipStack::layout(&spec(2, 3), &config()).width());
        Aips::Trained.check_values(&spec(2, 3), &config(), values.row(0)).unwrap();
        let mut wrong = values.row(0).to_vec();
        *wrong.last_mut().unwrap() = 0.5;
        let error = Aips::Trained.check_values(&spec(2, 3), &config(), &wrong).unwrap_err().to_string();
        assert_eq!(error, "influence source 2 listens to its AIP by 0.5, which is neither 0 nor 1");
    }

    #[test]
    fn a_source_that_does_not_listen_is_drawn_from_the_marginals_of_its_part() {
        let spec = spec(2, 2);
        let config = AipConfig { hidden: vec![1], ..config() };
        let mut aips = AipStack::new(&[AgentId(0)], &spec, &config, Seed::new(0));
        // The hidden unit is off; the output biases are ln 9 = 2.1972. Constants: 0.1 and 0.5, then 0.5 and 0.9. The
        // first source listens: 9 times its odds.
        let ln9 = 9_f32.ln();
        let network = [0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, ln9, ln9];
        let values = [&network[..], &[-ln9, 0.0, 0.0, ln9], &[1.0, 0.0]].concat();
        let width = values.len();
        aips.load(&Rows::from_vec(values, width));
        let rows = 20_000;
        let d_sets = (0..rows).flat_map(|row| if row < 10_000 { [1.0, 0.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0, 0.0] });
        let d_sets = Rows::from_vec(d_sets.collect(), 4);
        let mut drawn = Rows::new(rows, 2);
        aips.begin(rows).unwrap();
        aips.sample(&d_sets, &mut dice(rows), &mut drawn).unwrap();
        let share = |half: usize, source: usize| {
            (half * 10_000..(half + 1) * 10_000).filter(|&row| drawn.row(row)[source] == 1).count() as f64 / 1e4
        };
        // Standard errors of 10000 draws: at most 0.005.
        for (half, source, expected) in [(0, 0, 0.5), (0, 1, 0.5), (1, 0, 0.9), (1, 1, 0.9)] {
            assert!((share(half, source) - expected).abs() < 0.02, "{half} {source}: {}", share(half, source));
        }
    }
}
