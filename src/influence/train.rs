//! Training of the AIPs on the datasets, one agent after another (Algorithm 1, lines 4 to 6).

use std::ops::Range;

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::aip::scaled;
use super::{AipStack, Dataset, sources};
use crate::base::{AgentId, Phase, Seed, Stopwatch};
use crate::config::{AipConfig, held_out_episodes};
use crate::domain::SourceSpec;
use crate::nn::{Adam, Network, Sequences, Trace};

/// Mean cross-entropy of every influence source, in nats.
pub type CrossEntropies = Vec<f64>;

/// What one training did to one agent's AIP.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AipLoss {
    /// On the episodes it was trained on, before and after.
    pub training: [CrossEntropies; 2],
    /// On the episodes held out, before and after.
    pub held_out: [CrossEntropies; 2],
    /// On the episodes held out, of the best constant: the frequency in the training episodes.
    pub marginals: CrossEntropies,
    /// How often each source was not 0 in the training episodes.
    pub frequencies: Vec<f64>,
}

/// Samples for which losses are measured at once.
const LOSS_CHUNK: usize = 512;

/// Trains every agent's AIP on its own dataset and measures the loss before and after.
///
/// `datasets`: one per agent of the stack, all of one length. The last `held_out` of the episodes only measure. Adam
/// starts fresh and the incomplete last batch of an epoch is dropped, as in the authors' code; the weights go on from
/// the previous training. AIPs with memory are trained on whole episodes, others on single samples. Minibatches are
/// drawn from `seed`, each agent's from its own stream. `progress` is called with the share that is done.
pub fn train(
    aips: &mut AipStack,
    agents: &[AgentId],
    datasets: &[Dataset],
    config: &AipConfig,
    seed: Seed,
    watch: &mut Stopwatch,
    progress: &mut dyn FnMut(f64),
) -> Vec<AipLoss> {
    let (first, last) = split(&datasets[0], config.held_out);
    let steps = if aips.net().shape().recurrent.is_some() { datasets[0].horizon } else { 1 };
    // Sequences of `steps` samples each.
    let batches = first / steps / config.batch;
    let spec = aips.sources();
    let mut room = Room::default();
    let mut adam = Adam::new(aips.parameters());
    let learners = aips.learners(&mut adam, (config.epochs * batches) as u32);
    let mut losses = Vec::with_capacity(agents.len());
    for (index, ((mut learner, dataset), &agent)) in learners.into_iter().zip(datasets).zip(agents).enumerate() {
        let measure = |network: Network<'_>, room: &mut Room, watch: &mut Stopwatch| {
            [0..first, first..last].map(|samples| room.cross_entropies(network, spec, dataset, steps, samples, watch))
        };
        let before = measure(learner.network(), &mut room, watch);
        let mut dice = seed.for_agent(agent).dice();
        let mut order: Vec<usize> = (0..first / steps).collect();
        for epoch in 0..config.epochs {
            order.shuffle(&mut dice);
            for sequences in order.chunks_exact(config.batch) {
                watch.time(Phase::Bookkeeping, || room.gather(dataset, steps, sequences.iter().copied()));
                watch.time(Phase::Forward, || {
                    room.forward(learner.network(), spec);
                    room.differentiate(spec);
                });
                watch.time(Phase::Backward, || learner.network().backward(&room.gradient, &mut room.trace));
                watch.time(Phase::Adam, || learner.descend(room.trace.gradient(), config.learning_rate));
            }
            progress((index as f64 + (epoch + 1) as f64 / config.epochs as f64) / agents.len() as f64);
        }
        let after = measure(learner.network(), &mut room, watch);
        losses.push(report(dataset, spec, first, before, after));
    }
    losses
}

/// Where the training samples end and the held-out ones end.
fn split(dataset: &Dataset, share: f64) -> (usize, usize) {
    let episodes = dataset.episodes();
    let training = episodes - held_out_episodes(episodes, share);
    (training * dataset.horizon, dataset.len())
}

/// What a training works in, one agent after another: some sequences of its dataset, rows ordered step, sequence.
#[derive(Default)]
struct Room {
    steps: usize,
    d_sets: Vec<f32>,
    sources: Vec<u8>,
    /// Sequences begin with episodes: in cleared states, and with no episode that begins within.
    states: Vec<f32>,
    starts: Vec<bool>,
    trace: Trace,
    /// Of the loss by the logits.
    gradient: Vec<f32>,
}

impl Room {
    /// Copies sequences of `steps` samples.
    fn gather(&mut self, dataset: &Dataset, steps: usize, sequences: impl ExactSizeIterator<Item = usize> + Clone) {
        let (rows, width) = (sequences.len() * steps, dataset.d_sets.width());
        self.steps = steps;
        self.d_sets.resize(rows * width, 0.0);
        self.sources.clear();
        let mut d_sets = self.d_sets.chunks_exact_mut(width);
        for step in 0..steps {
            for sequence in sequences.clone() {
                let sample = sequence * steps + step;
                dataset.d_sets.read(sample, d_sets.next().expect("a place per row"));
                self.sources.extend_from_slice(dataset.sources.row(sample));
            }
        }
        self.d_sets.iter_mut().for_each(|x| *x = scaled(*x));
    }

    fn forward(&mut self, network: Network<'_>, spec: SourceSpec) {
        let rows = self.sources.len() / spec.count();
        self.states.resize(rows / self.steps * network.state_width(), 0.0);
        self.starts.resize(rows, false);
        let sequences = Sequences { steps: self.steps, states: &self.states, starts: &self.starts };
        network.forward(&self.d_sets, sequences, &mut self.trace);
    }

    /// The gradient of the cross-entropy, averaged over the samples and the sources.
    fn differentiate(&mut self, spec: SourceSpec) {
        let logits = self.trace.output();
        self.gradient.resize(logits.len(), 0.0);
        let scale = 1.0 / self.sources.len() as f32;
        let rows = self.gradient.chunks_exact_mut(spec.logits()).zip(logits.chunks_exact(spec.logits()));
        for ((gradient, logits), observed) in rows.zip(self.sources.chunks_exact(spec.count())) {
            sources::write_gradient(spec, logits, observed, scale, gradient);
        }
    }

    /// Mean cross-entropy of every source over some of the samples, which are whole sequences of `steps`.
    fn cross_entropies(
        &mut self,
        network: Network<'_>,
        spec: SourceSpec,
        dataset: &Dataset,
        steps: usize,
        samples: Range<usize>,
        watch: &mut Stopwatch,
    ) -> CrossEntropies {
        let mut sums = vec![0.0; spec.count()];
        let (first, last) = (samples.start / steps, samples.end / steps);
        let chunk = (LOSS_CHUNK / steps).max(1);
        for start in (first..last).step_by(chunk) {
            watch.time(Phase::Bookkeeping, || self.gather(dataset, steps, start..last.min(start + chunk)));
            watch.time(Phase::Forward, || {
                self.forward(network, spec);
                let rows = self.trace.output().chunks_exact(spec.logits()).zip(self.sources.chunks_exact(spec.count()));
                rows.for_each(|(logits, observed)| sources::add_cross_entropies(spec, logits, observed, &mut sums));
            });
        }
        sums.iter_mut().for_each(|sum| *sum /= samples.len() as f64);
        sums
    }
}

/// The frequencies of each source's classes.
type Frequencies = Vec<Vec<f64>>;

fn report(
    dataset: &Dataset,
    spec: SourceSpec,
    first: usize,
    [training_before, held_out_before]: [CrossEntropies; 2],
    [training_after, held_out_after]: [CrossEntropies; 2],
) -> AipLoss {
    let seen = frequencies(dataset, spec, 0..first);
    let held_out = frequencies(dataset, spec, first..dataset.len());
    AipLoss {
        training: [training_before, training_after],
        held_out: [held_out_before, held_out_after],
        marginals: seen.iter().zip(&held_out).map(|(p, q)| cross_entropy_of_constants(p, q)).collect(),
        frequencies: seen.iter().map(|classes| 1.0 - classes[0]).collect(),
    }
}

fn frequencies(dataset: &Dataset, spec: SourceSpec, samples: Range<usize>) -> Frequencies {
    let mut counts = vec![vec![0_u64; spec.classes()]; spec.count()];
    for sample in samples.clone() {
        let observed = dataset.sources.row(sample);
        counts.iter_mut().zip(observed).for_each(|(counts, &u)| counts[usize::from(u)] += 1);
    }
    let share = |count: &u64| *count as f64 / samples.len() as f64;
    counts.iter().map(|counts| counts.iter().map(share).collect()).collect()
}

/// Cross-entropy of predicting the frequencies `p` where the true ones are `q`.
///
/// A class that was never seen in training is predicted as half an event in 1e6, so that one surprise in the held-out
/// episodes does not make the mean infinite.
fn cross_entropy_of_constants(p: &[f64], q: &[f64]) -> f64 {
    -p.iter().zip(q).map(|(p, q)| q * p.max(5e-7).ln()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::AipConfig;
    use crate::domain::RegionSpec;
    use rand::Rng;

    /// Two sources with a known conditional distribution: P(u_0 = 1 | x) is 0.9 where x_0 = 1 and 0.2 elsewhere;
    /// u_1 is a fair coin.
    fn known_dataset(agent: AgentId) -> Dataset {
        let sources = SourceSpec::Binary { sources: 2 };
        let spec = RegionSpec { obs_dim: 3, d_set_dim: 3, n_actions: 2, sources, horizon: 100 };
        let mut dataset = Dataset::new(&spec);
        let mut dice = Seed::new(21).for_agent(agent).dice();
        for _ in 0..20_000 {
            let x: [bool; 3] = dice.random();
            let u = [dice.random_bool(if x[0] { 0.9 } else { 0.2 }), dice.random_bool(0.5)];
            dataset.push(&x.map(|bit| f32::from(u8::from(bit))), &u.map(u8::from));
        }
        dataset
    }

    fn config() -> AipConfig {
        AipConfig { hidden: vec![16, 16], learning_rate: 1e-3, epochs: 12, ..AipConfig::default() }
    }

    fn trained(agents: &[AgentId]) -> (Vec<AipLoss>, Vec<f32>) {
        let sources = SourceSpec::Binary { sources: 2 };
        let spec = RegionSpec { obs_dim: 3, d_set_dim: 3, n_actions: 2, sources, horizon: 100 };
        let mut aips = AipStack::new(agents, &spec, &config(), Seed::new(1));
        let datasets: Vec<Dataset> = agents.iter().map(|&agent| known_dataset(agent)).collect();
        let losses =
            train(&mut aips, agents, &datasets, &config(), Seed::new(2), &mut Stopwatch::default(), &mut |_| ());
        let values = aips.parameters().values().as_slice().to_vec();
        (losses, values)
    }

    #[test]
    fn an_aip_reaches_the_entropy_of_a_known_distribution() {
        let (losses, _) = trained(&AgentId::all(2));
        // H(0.9) = 0.3251 and H(0.2) = 0.5004, each half of the time: 0.4127; the coin: ln 2 = 0.6931.
        // The marginal of u_0 is 0.55: H = 0.6881. 2000 held-out samples: standard error of the loss about 0.012.
        for loss in losses {
            assert!((loss.held_out[0][0] - 0.69).abs() < 0.08, "untrained {:?}", loss.held_out[0]);
            assert!((loss.held_out[1][0] - 0.4127).abs() < 0.04, "{:?}", loss.held_out[1]);
            assert!((loss.held_out[1][1] - 2_f64.ln()).abs() < 0.01, "{:?}", loss.held_out[1]);
            assert!((loss.training[1][0] - 0.4127).abs() < 0.02, "{:?}", loss.training[1]);
            assert!((loss.marginals[0] - 0.6881).abs() < 0.01, "{:?}", loss.marginals);
            assert!((loss.frequencies[0] - 0.55).abs() < 0.015, "{:?}", loss.frequencies);
        }
    }

    #[test]
    fn the_last_episodes_measure_and_are_not_trained_on() {
        // u = x in the first 18 episodes, u = 1 - x in the last two: whoever learns u = x is wrong there.
        let sources = SourceSpec::Binary { sources: 1 };
        let spec = RegionSpec { obs_dim: 1, d_set_dim: 1, n_actions: 2, sources, horizon: 100 };
        let mut dataset = Dataset::new(&spec);
        let mut dice = Seed::new(31).dice();
        for sample in 0..2000 {
            let x: bool = dice.random();
            dataset.push(&[f32::from(u8::from(x))], &[u8::from(x != (sample >= 1800))]);
        }
        let config = AipConfig { hidden: vec![8], learning_rate: 1e-2, epochs: 30, ..AipConfig::default() };
        let mut aips = AipStack::new(&[AgentId(0)], &spec, &config, Seed::new(1));
        let loss =
            train(&mut aips, &[AgentId(0)], &[dataset], &config, Seed::new(2), &mut Stopwatch::default(), &mut |_| ())
                .remove(0);
        // Certain of u = x where it holds: p > 0.95, so -ln(1 - p) > 3 in the end. Trained on all it would be ln 10 = 2.3.
        assert!(loss.training[1][0] < 0.05, "{:?}", loss.training);
        assert!(loss.held_out[1][0] > 3.0, "{:?}", loss.held_out);
    }

    #[test]
    fn agents_train_alike_in_any_company() {
        let (both, together) = trained(&[AgentId(0), AgentId(1)]);
        let (single, alone) = trained(&[AgentId(1)]);
        assert_eq!(single[0], both[1]);
        assert_eq!(alone, together[together.len() / 2..]);
    }

    /// A source that repeats what the d-set showed two steps ago: only a memory can tell.
    fn delayed_dataset() -> Dataset {
        let sources = SourceSpec::Categorical { sources: 1, classes: 3 };
        let spec = RegionSpec { obs_dim: 3, d_set_dim: 3, n_actions: 2, sources, horizon: 20 };
        let mut dataset = Dataset::new(&spec);
        let mut dice = Seed::new(31).dice();
        for _ in 0..200 {
            let mut shown = [0_u8; 2];
            for _ in 0..20 {
                let class = dice.random_range(0..3_u8);
                let mut d_set = [0.0; 3];
                d_set[usize::from(class)] = 1.0;
                dataset.push(&d_set, &[shown[0]]);
                shown = [shown[1], class];
            }
        }
        dataset
    }

    #[test]
    fn an_aip_with_memory_learns_what_one_without_cannot() {
        let sources = SourceSpec::Categorical { sources: 1, classes: 3 };
        let spec = RegionSpec { obs_dim: 3, d_set_dim: 3, n_actions: 2, sources, horizon: 20 };
        let loss = |recurrent: Option<usize>| {
            let batch = if recurrent.is_some() { 20 } else { 128 };
            let config = AipConfig {
                recurrent,
                hidden: vec![16],
                learning_rate: 1e-2,
                epochs: 30,
                batch,
                ..AipConfig::default()
            };
            let mut aips = AipStack::new(&[AgentId(0)], &spec, &config, Seed::new(1));
            let datasets = [delayed_dataset()];
            train(&mut aips, &[AgentId(0)], &datasets, &config, Seed::new(2), &mut Stopwatch::default(), &mut |_| ())
                .remove(0)
                .held_out[1][0]
        };
        // Without memory: the two first steps are sure (0), the others a die of three, 18 / 20 * ln 3 = 0.989 at least.
        let (with, without) = (loss(Some(16)), loss(None));
        assert!(with < 0.2 && without > 0.95, "{with} {without}");
    }
}
