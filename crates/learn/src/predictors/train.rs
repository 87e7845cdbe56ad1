//! Training of the influence predictors on the datasets (Algorithm 1, lines 4 to 6), and their loss: before and after
//! it, and on new episodes, from which they do not learn.

use serde::{Deserialize, Serialize};

use super::parts::PartFrequencies;
use super::{CrossEntropies, Dataset, Lesson, TrainablePredictor, mean_loss};
use crate::config::{AipConfig, held_out_episodes};
use dials_core::base::{AgentId, Dice, Seed, Stopwatch, Work};
use dials_core::domain::SourceSpec;
use stacknets::Threads;

/// Effect of one training on one agent's predictor, for each source that the agent has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AipLoss {
    /// Loss on the episodes it was trained on, before and after.
    pub training: [CrossEntropies; 2],
    /// Loss on the held-out episodes, before and after.
    pub held_out: [CrossEntropies; 2],
    /// Loss of the best constant on the held-out episodes: the frequency in the training episodes. In a domain whose
    /// episodes have parts: of each part.
    pub marginals: CrossEntropies,
    /// How often each source was not 0 in the training episodes.
    pub frequencies: Vec<f64>,
    /// Whether each source keeps its constants, because the AIP is not better on the held-out episodes. Empty for
    /// predictors that do not choose.
    pub on_marginals: Vec<bool>,
}

/// Trains every agent's predictor on its own dataset and measures the loss before and after.
///
/// `datasets`: one per agent of the stack, all of the same length. The last `held_out` of the episodes only measure.
/// `progress` is called with the share that is done. Agents are shared out among the threads.
pub fn train(
    predictor: &mut dyn TrainablePredictor,
    agents: &[AgentId],
    datasets: &[Dataset],
    (config, threads): (&AipConfig, &Threads),
    seed: Seed,
    work: Work<'_, f64>,
) -> Vec<AipLoss> {
    let Work { watch, progress } = work;
    let (first, last) = split(&datasets[0], config.held_out);
    let both = |predictor: &dyn TrainablePredictor, watch: &mut Stopwatch| {
        [0..first, first..last].map(|samples| predictor.losses(datasets, samples, watch))
    };
    let before = both(predictor, watch);
    let mut dice: Vec<Dice> = seed.for_agents(agents).collect();
    predictor.learn(Lesson { datasets, samples: first, config, threads }, &mut dice, Work { watch, progress });
    let after = both(predictor, watch);
    let per_agent = datasets.iter().enumerate().map(|(agent, dataset)| {
        let of_agent = |losses: &[CrossEntropies]| dataset.only_own(losses[agent].clone());
        let on_marginals = dataset.only_own(predictor.on_marginals(agent));
        let losses = [&before, &after].map(|losses| [of_agent(&losses[0]), of_agent(&losses[1])]);
        effect(predictor.sources(), dataset, first, losses, on_marginals)
    });
    per_agent.collect()
}

/// Puts the effect of a training on one agent's predictor together. `first`: number of training samples; `losses`: before
/// and after it, on the training samples and on the held-out ones.
pub(super) fn effect(
    spec: &SourceSpec,
    dataset: &Dataset,
    first: usize,
    [[training, held_out], [training_after, held_out_after]]: [[CrossEntropies; 2]; 2],
    on_marginals: Vec<bool>,
) -> AipLoss {
    let [seen, unseen] = [0..first, first..dataset.len()].map(|samples| PartFrequencies::of(spec, dataset, samples));
    AipLoss {
        training: [training, training_after],
        held_out: [held_out, held_out_after],
        marginals: dataset.only_own(unseen.cross_entropies(&seen.probabilities())),
        frequencies: dataset.only_own(seen.whole().iter().map(|classes| 1.0 - classes[0]).collect()),
        on_marginals,
    }
}

/// Returns where the training samples end and where the held-out ones end.
pub(super) fn split(dataset: &Dataset, share: f64) -> (usize, usize) {
    let episodes = dataset.episodes();
    let training = episodes - held_out_episodes(episodes, share);
    (training * dataset.horizon, dataset.len())
}

/// Loss of one agent's predictor on new episodes, for each source that the agent has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FreshLoss {
    pub predictor: CrossEntropies,
    /// Loss of the best constants for these very episodes, and for each of their parts: no constant predictor is better.
    pub marginals: CrossEntropies,
}

impl FreshLoss {
    /// Returns means over the sources: of the predictor and of the constants.
    pub fn means(&self) -> [f64; 2] {
        [mean_loss(&self.predictor), mean_loss(&self.marginals)]
    }

    /// Returns the same means over all agents.
    pub fn means_of_all(losses: &[FreshLoss]) -> [f64; 2] {
        [0, 1].map(|which| losses.iter().map(|loss| loss.means()[which]).sum::<f64>() / losses.len() as f64)
    }
}

/// Measures every agent's predictor on its own dataset. All datasets have the same length.
pub fn measure(predictor: &dyn TrainablePredictor, datasets: &[Dataset], watch: &mut Stopwatch) -> Vec<FreshLoss> {
    let losses = predictor.losses(datasets, 0..datasets[0].len(), watch);
    let per_agent = losses.into_iter().zip(datasets);
    per_agent.map(|(loss, dataset)| fresh(predictor.sources(), dataset, dataset.only_own(loss))).collect()
}

/// Puts the loss of one agent's predictor, for each source that it has, beside that of the best constants.
pub(super) fn fresh(spec: &SourceSpec, dataset: &Dataset, predictor: CrossEntropies) -> FreshLoss {
    let seen = PartFrequencies::of(spec, dataset, 0..dataset.len());
    FreshLoss { predictor, marginals: dataset.only_own(seen.entropies()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{region, trained};
    use crate::predictors::{AipStack, Marginals};
    use dials_core::domain::Kinds;
    use rand::Rng;

    #[test]
    fn the_last_episodes_only_measure_and_stop_a_training_that_makes_them_worse() {
        // u = x in the first 18 episodes, u = 1 - x in the last two: a predictor that learns u = x is wrong there.
        let spec = region(1, 1, SourceSpec::bits(1), 100);
        let mut dataset = Dataset::new(&spec);
        let mut dice = Seed::new(31).dice();
        for sample in 0..2000 {
            let x: bool = dice.random();
            dataset.push(&[f32::from(u8::from(x))], &[u8::from(x != (sample >= 1800))]);
        }
        let loss = |patience: Option<usize>| {
            let config =
                AipConfig { hidden: vec![8], learning_rate: 1e-2, epochs: 30, patience, ..AipConfig::default() };
            let mut aips = AipStack::new(&[AgentId(0)], &spec, &config, Seed::new(1));
            trained(&mut aips, std::slice::from_ref(&dataset), &config).remove(0)
        };
        // Certain of u = x where it holds: p > 0.95, so -ln(1 - p) > 3 in the end. Trained on all it would be ln 10 = 2.3.
        let AipLoss { training, held_out, .. } = loss(None);
        assert!(training[1][0] < 0.05 && held_out[1][0] > 3.0, "{training:?} {held_out:?}");
        let [before, after] = loss(Some(1)).held_out;
        assert_eq!(before, after, "the first parameters were the best");
    }

    #[test]
    fn an_aip_with_memory_learns_what_one_without_cannot() {
        // A source that repeats what the d-set showed two steps ago.
        let spec = region(3, 3, SourceSpec { classes: vec![3], parts: 0 }, 20);
        let mut dataset = Dataset::new(&spec);
        let mut dice = Seed::new(31).dice();
        let mut shown = [0_u8; 2];
        for sample in 0..4000 {
            if sample % 20 == 0 {
                shown = [0; 2];
            }
            let class = dice.random_range(0..3_u8);
            let mut d_set = [0.0; 3];
            d_set[usize::from(class)] = 1.0;
            dataset.push(&d_set, &[shown[0]]);
            shown = [shown[1], class];
        }
        let loss = |recurrent, batch| {
            let network = AipConfig { recurrent, hidden: vec![16], ..AipConfig::default() };
            let config = AipConfig { learning_rate: 1e-2, epochs: 30, batch, ..network };
            let mut aips = AipStack::new(&[AgentId(0)], &spec, &config, Seed::new(1));
            trained(&mut aips, std::slice::from_ref(&dataset), &config)[0].held_out[1][0]
        };
        // Without memory: the two first steps are sure (0), the others a die of three, 18 / 20 * ln 3 = 0.989 at least.
        let (with, without) = (loss(Some(16), 20), loss(None, 128));
        assert!(with < 0.2 && without > 0.95, "{with} {without}");
    }

    #[test]
    fn sources_that_an_agent_does_not_have_do_not_count() {
        let spec = region(1, 1, SourceSpec::bits(3), 4);
        let kinds = Kinds::one(3, spec.clone()).with_sources(vec![3, 1, 0]);
        let mut datasets = Dataset::of_all(&kinds);
        for t in 0..8 {
            datasets[0].push(&[0.0], &[t % 2, t % 2, t % 2]);
            datasets[1].push(&[0.0], &[t % 2, 0, 0]);
            datasets[2].push(&[0.0], &[0, 0, 0]);
        }
        let losses = measure(&Marginals::new(3, &spec), &datasets, &mut Stopwatch::default());
        assert_eq!([0, 1, 2].map(|agent| losses[agent].predictor.len()), [3, 1, 0]);
        let constants = losses.iter().map(|loss| loss.means()[1]);
        // Fair coins. The second agent loses as much per source as the first, the third has nothing to lose.
        assert!(constants.zip([2_f64.ln(), 2_f64.ln(), 0.0]).all(|(loss, expected)| (loss - expected).abs() < 1e-7));
        assert!((FreshLoss::means_of_all(&losses)[1] - 2_f64.ln() * 2.0 / 3.0).abs() < 1e-7);
    }
}
