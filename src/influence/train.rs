//! Training of the AIPs on the datasets, all agents of a stack at once (Algorithm 1, lines 4 to 6).

use std::ops::Range;

use rand::seq::SliceRandom;

use super::{AipStack, Dataset, sources};
use crate::base::{AgentId, Dice, Phase, Rows, Seed, Stopwatch};
use crate::config::{AipConfig, held_out_episodes};
use crate::domain::SourceSpec;
use crate::nn::Adam;
use serde::{Deserialize, Serialize};

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

/// Samples per agent for which losses are measured at once.
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
    let before = [0..first, first..last].map(|samples| losses(aips, datasets, steps, samples, watch));
    let mut dice: Vec<Dice> = agents.iter().map(|&agent| seed.for_agent(agent).dice()).collect();
    let mut adam = Adam::new(aips.parameters());
    // Sequences of `steps` samples each.
    let mut order: Vec<Vec<usize>> = vec![(0..first / steps).collect(); agents.len()];
    let mut minibatch = Minibatch::new(agents.len(), config.batch, steps, &datasets[0]);
    for epoch in 0..config.epochs {
        order.iter_mut().zip(&mut dice).for_each(|(order, dice)| order.shuffle(dice));
        for batch in 0..first / steps / config.batch {
            watch.time(Phase::Bookkeeping, || {
                minibatch.gather(datasets, |agent, i| order[agent][batch * config.batch + i]);
            });
            minibatch.descend(aips, &mut adam, config.learning_rate, watch);
        }
        progress((epoch + 1) as f64 / config.epochs as f64);
    }
    let after = [0..first, first..last].map(|samples| losses(aips, datasets, steps, samples, watch));
    report(datasets, aips.sources(), first, before, after)
}

/// Where the training samples end and the held-out ones end.
fn split(dataset: &Dataset, share: f64) -> (usize, usize) {
    let episodes = dataset.episodes();
    let training = episodes - held_out_episodes(episodes, share);
    (training * dataset.horizon, dataset.len())
}

/// Some sequences of every agent; rows ordered agent, step, sequence.
struct Minibatch {
    sequences: usize,
    steps: usize,
    d_sets: Rows<f32>,
    sources: Rows<u8>,
}

impl Minibatch {
    fn new(agents: usize, sequences: usize, steps: usize, like: &Dataset) -> Self {
        let rows = agents * sequences * steps;
        Minibatch {
            sequences,
            steps,
            d_sets: Rows::new(rows, like.d_sets.width()),
            sources: Rows::new(rows, like.sources.width()),
        }
    }

    /// Copies sequence `pick(agent, i)` of every agent's dataset to the i-th of the agent.
    fn gather(&mut self, datasets: &[Dataset], pick: impl Fn(usize, usize) -> usize) {
        for (agent, dataset) in datasets.iter().enumerate() {
            for i in 0..self.sequences {
                let sequence = pick(agent, i);
                for step in 0..self.steps {
                    let row = (agent * self.steps + step) * self.sequences + i;
                    let sample = sequence * self.steps + step;
                    dataset.d_sets.read(sample, self.d_sets.row_mut(row));
                    self.sources.row_mut(row).copy_from_slice(dataset.sources.row(sample));
                }
            }
        }
    }

    /// One gradient step on the cross-entropy, averaged over the samples and the sources of each agent.
    fn descend(&self, aips: &mut AipStack, adam: &mut Adam, learning_rate: f64, watch: &mut Stopwatch) {
        let spec = aips.sources();
        let (trace, gradient) = watch.time(Phase::Forward, || {
            let trace = aips.forward(&self.d_sets, self.steps);
            let scale = 1.0 / (self.sequences * self.steps * spec.count()) as f32;
            let mut gradient = vec![0.0; trace.output().len()];
            let rows = gradient.chunks_exact_mut(spec.logits()).zip(trace.output().chunks_exact(spec.logits()));
            for ((gradient, logits), observed) in rows.zip(self.sources.iter()) {
                sources::write_gradient(spec, logits, observed, scale, gradient);
            }
            (trace, gradient)
        });
        let net = aips.net_mut();
        watch.time(Phase::Backward, || net.backward(&trace, &gradient));
        watch.time(Phase::Adam, || adam.step(net.parameters_mut(), learning_rate));
    }
}

/// Mean cross-entropy of every agent and source over some of the samples, which are whole sequences of `steps`.
fn losses(
    aips: &AipStack,
    datasets: &[Dataset],
    steps: usize,
    samples: Range<usize>,
    watch: &mut Stopwatch,
) -> Vec<CrossEntropies> {
    let spec = aips.sources();
    let mut sums = vec![vec![0.0; spec.count()]; datasets.len()];
    let (first, last) = (samples.start / steps, samples.end / steps);
    let chunk = (LOSS_CHUNK / steps).max(1);
    for start in (first..last).step_by(chunk) {
        let mut minibatch = Minibatch::new(datasets.len(), chunk.min(last - start), steps, &datasets[0]);
        watch.time(Phase::Bookkeeping, || minibatch.gather(datasets, |_, i| start + i));
        watch.time(Phase::Forward, || {
            let trace = aips.forward(&minibatch.d_sets, steps);
            let rows = trace.output().chunks_exact(spec.logits()).zip(minibatch.sources.iter());
            for (row, (logits, observed)) in rows.enumerate() {
                let agent = row / (minibatch.sequences * steps);
                sources::add_cross_entropies(spec, logits, observed, &mut sums[agent]);
            }
        });
    }
    let count = samples.len() as f64;
    sums.iter_mut().flatten().for_each(|sum| *sum /= count);
    sums
}

/// The frequencies of each source's classes.
type Frequencies = Vec<Vec<f64>>;

fn report(
    datasets: &[Dataset],
    spec: SourceSpec,
    first: usize,
    before: [Vec<CrossEntropies>; 2],
    after: [Vec<CrossEntropies>; 2],
) -> Vec<AipLoss> {
    let per_agent = datasets.iter().enumerate().map(|(agent, dataset)| {
        let seen = frequencies(dataset, spec, 0..first);
        let held_out = frequencies(dataset, spec, first..dataset.len());
        AipLoss {
            training: [before[0][agent].clone(), after[0][agent].clone()],
            held_out: [before[1][agent].clone(), after[1][agent].clone()],
            marginals: seen.iter().zip(&held_out).map(|(p, q)| cross_entropy_of_constants(p, q)).collect(),
            frequencies: seen.iter().map(|classes| 1.0 - classes[0]).collect(),
        }
    });
    per_agent.collect()
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
        let values = aips.parameters().values().to_vec();
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
