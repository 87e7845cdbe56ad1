//! Training of the AIPs on the datasets, all agents of a stack at once (Algorithm 1, lines 4 to 6).

use rand::seq::SliceRandom;

use super::aip::sigmoid;
use super::{AipStack, Dataset};
use crate::base::{AgentId, Dice, Rows, Seed};
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
    /// How often each source was 1 in the training episodes.
    pub frequencies: Vec<f64>,
}

/// Rows of the samples of one stage for which losses are measured at once.
const LOSS_CHUNK: usize = 512;

/// Trains every agent's AIP on its own dataset and measures the loss before and after.
///
/// `datasets`: one per agent of the stack, all of one length. The last `held_out` of the episodes only measure. Adam
/// starts fresh and the incomplete last batch of an epoch is dropped, as in the authors' code; the weights go on from
/// the previous training. Minibatches are drawn from `seed`, each agent's from its own stream. `progress` is called
/// with the share that is done.
pub fn train(
    aips: &mut AipStack,
    agents: &[AgentId],
    datasets: &[Dataset],
    config: &AipConfig,
    seed: Seed,
    progress: &mut dyn FnMut(f64),
) -> Vec<AipLoss> {
    let (first, last) = split(&datasets[0], config.held_out);
    let before = [losses(aips, datasets, 0, first), losses(aips, datasets, first, last)];
    let mut dice: Vec<Dice> = agents.iter().map(|&agent| seed.for_agent(agent).dice()).collect();
    let mut adam = Adam::new(aips.parameters());
    let mut order: Vec<Vec<usize>> = vec![(0..first).collect(); agents.len()];
    let mut minibatch = Minibatch::new(agents.len(), config.batch, &datasets[0]);
    for epoch in 0..config.epochs {
        order.iter_mut().zip(&mut dice).for_each(|(order, dice)| order.shuffle(dice));
        for batch in 0..first / config.batch {
            minibatch.gather(datasets, |agent, i| order[agent][batch * config.batch + i]);
            minibatch.descend(aips, &mut adam, config.learning_rate);
        }
        progress((epoch + 1) as f64 / config.epochs as f64);
    }
    let after = [losses(aips, datasets, 0, first), losses(aips, datasets, first, last)];
    report(datasets, first, before, after)
}

/// Where the training samples end and the held-out ones end.
fn split(dataset: &Dataset, share: f64) -> (usize, usize) {
    let episodes = dataset.episodes();
    let training = episodes - held_out_episodes(episodes, share);
    (training * dataset.horizon, dataset.len())
}

/// One minibatch of every agent.
struct Minibatch {
    batch: usize,
    d_sets: Rows<f32>,
    sources: Rows<u8>,
}

impl Minibatch {
    fn new(agents: usize, batch: usize, like: &Dataset) -> Self {
        let rows = agents * batch;
        Minibatch {
            batch,
            d_sets: Rows::new(rows, like.d_sets.width()),
            sources: Rows::new(rows, like.sources.width()),
        }
    }

    /// Copies sample `pick(agent, i)` of every agent's dataset to row i of the agent.
    fn gather(&mut self, datasets: &[Dataset], pick: impl Fn(usize, usize) -> usize) {
        for (agent, dataset) in datasets.iter().enumerate() {
            for i in 0..self.batch {
                let (row, sample) = (agent * self.batch + i, pick(agent, i));
                dataset.d_sets.read(sample, self.d_sets.row_mut(row));
                self.sources.row_mut(row).copy_from_slice(dataset.sources.row(sample));
            }
        }
    }

    /// One gradient step on the cross-entropy, averaged over the batch and the sources of each agent.
    fn descend(&self, aips: &mut AipStack, adam: &mut Adam, learning_rate: f64) {
        let SourceSpec::Binary { sources } = aips.sources();
        let trace = aips.forward(&self.d_sets);
        let scale = 1.0 / (self.batch * sources) as f32;
        let logits = trace.output().iter().zip(self.sources.as_slice());
        // d/dx of -(u ln s(x) + (1 - u) ln(1 - s(x))) is s(x) - u.
        let gradient: Vec<f32> = logits.map(|(&x, &u)| (sigmoid(x) - f32::from(u)) * scale).collect();
        let net = aips.net_mut();
        net.backward(&trace, &gradient);
        adam.step(net.parameters_mut(), learning_rate);
    }
}

/// Mean cross-entropy of every agent and source over the samples `from..to`.
fn losses(aips: &mut AipStack, datasets: &[Dataset], from: usize, to: usize) -> Vec<CrossEntropies> {
    let SourceSpec::Binary { sources } = aips.sources();
    let mut sums = vec![vec![0.0; sources]; datasets.len()];
    for start in (from..to).step_by(LOSS_CHUNK) {
        let batch = LOSS_CHUNK.min(to - start);
        let mut chunk = Minibatch::new(datasets.len(), batch, &datasets[0]);
        chunk.gather(datasets, |_, i| start + i);
        let trace = aips.forward(&chunk.d_sets);
        let rows = trace.output().chunks_exact(sources).zip(chunk.sources.iter());
        for (row, (logits, observed)) in rows.enumerate() {
            for (source, (&logit, &u)) in logits.iter().zip(observed).enumerate() {
                sums[row / batch][source] += binary_cross_entropy(f64::from(logit), u);
            }
        }
    }
    let samples = (to - from) as f64;
    sums.iter_mut().flatten().for_each(|sum| *sum /= samples);
    sums
}

/// `-(u ln s(x) + (1 - u) ln(1 - s(x)))`, without overflow for any logit `x`.
fn binary_cross_entropy(logit: f64, u: u8) -> f64 {
    logit.max(0.0) - logit * f64::from(u) + (-logit.abs()).exp().ln_1p()
}

fn report(
    datasets: &[Dataset],
    first: usize,
    before: [Vec<CrossEntropies>; 2],
    after: [Vec<CrossEntropies>; 2],
) -> Vec<AipLoss> {
    let per_agent = datasets.iter().enumerate().map(|(agent, dataset)| {
        let frequencies = frequencies(dataset, 0, first);
        let observed = self::frequencies(dataset, first, dataset.len());
        let marginals = frequencies.iter().zip(observed).map(|(&p, q)| cross_entropy_of_constant(p, q)).collect();
        AipLoss {
            training: [before[0][agent].clone(), after[0][agent].clone()],
            held_out: [before[1][agent].clone(), after[1][agent].clone()],
            marginals,
            frequencies,
        }
    });
    per_agent.collect()
}

fn frequencies(dataset: &Dataset, from: usize, to: usize) -> Vec<f64> {
    let mut counts = vec![0_u64; dataset.sources.width()];
    for sample in from..to {
        counts.iter_mut().zip(dataset.sources.row(sample)).for_each(|(count, &u)| *count += u64::from(u));
    }
    counts.iter().map(|&count| count as f64 / (to - from) as f64).collect()
}

/// Cross-entropy of predicting 1 with probability `p` where 1 has frequency `q`.
///
/// A source that was never (or always) seen in training is predicted as half an event in 1e6, so that one surprise in
/// the held-out episodes does not make the mean infinite.
fn cross_entropy_of_constant(p: f64, q: f64) -> f64 {
    let p = p.clamp(5e-7, 1.0 - 5e-7);
    -(q * p.ln() + (1.0 - q) * (1.0 - p).ln())
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

    fn trained(agents: &[AgentId]) -> (Vec<AipLoss>, Vec<f32>) {
        let sources = SourceSpec::Binary { sources: 2 };
        let spec = RegionSpec { obs_dim: 3, d_set_dim: 3, n_actions: 2, sources, horizon: 100 };
        let mut aips = AipStack::new(agents, &spec, &[16, 16], Seed::new(1));
        let datasets: Vec<Dataset> = agents.iter().map(|&agent| known_dataset(agent)).collect();
        let config = AipConfig { learning_rate: 1e-3, epochs: 12, ..AipConfig::default() };
        let losses = train(&mut aips, agents, &datasets, &config, Seed::new(2), &mut |_| ());
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
        let mut aips = AipStack::new(&[AgentId(0)], &spec, &[8], Seed::new(1));
        let config = AipConfig { learning_rate: 1e-2, epochs: 30, held_out: 0.1, ..AipConfig::default() };
        let loss = train(&mut aips, &[AgentId(0)], &[dataset], &config, Seed::new(2), &mut |_| ()).remove(0);
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

    #[test]
    fn cross_entropies_are_worked_out_by_hand() {
        // s(0) = 1/2: ln 2 either way; s(ln 3) = 3/4: -ln(3/4) = 0.28768 for 1, -ln(1/4) = 1.38629 for 0.
        assert!((binary_cross_entropy(0.0, 1) - 2_f64.ln()).abs() < 1e-12);
        assert!((binary_cross_entropy(3_f64.ln(), 1) - 0.287_682).abs() < 1e-6);
        assert!((binary_cross_entropy(3_f64.ln(), 0) - 1.386_294).abs() < 1e-6);
        assert_eq!(binary_cross_entropy(1000.0, 1), 0.0);
        assert_eq!(binary_cross_entropy(1000.0, 0), 1000.0);
    }
}
