//! The matrix products that a run asks for, in floating-point operations.

use crate::config::{Config, TimeLimit, held_out_episodes};
use crate::domain::RegionSpec;
use crate::influence::{AipStack, sampling_flops};
use crate::nn::Shape;
use crate::policy::PolicyStack;

/// Operations per agent and unit of work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flops {
    /// Per timestep of training: PPO, acting, and sampling from the AIP.
    pub training: f64,
    /// Per step on the GS, in evaluation and collection.
    pub acting: f64,
}

impl Flops {
    pub fn of(config: &Config, spec: &RegionSpec) -> Flops {
        let (ppo, policy) = (&config.ppo, PolicyStack::shape(spec, &config.policy));
        let acting = policy.forward_flops();
        let update = ppo.epochs as f64 * (acting + policy.backward_flops(config.sequence_length()));
        // Beside every decision, the value after the last step of a rollout and, where it counts, of an episode.
        let last_values = 1.0 / ppo.rollout_steps as f64
            + if ppo.time_limit == TimeLimit::Bootstrap { 1.0 / config.horizon() as f64 } else { 0.0 };
        let predictor = config.simulator.predictor();
        let sampling = predictor.map_or(0.0, |choice| sampling_flops(choice, spec, &config.aip));
        Flops { training: update + (1.0 + last_values) * acting + sampling, acting }
    }
}

/// Operations of one agent's AIP training on a dataset of so many episodes: the gradient steps, and the loss before and
/// after on all samples.
pub fn aip_training_flops(config: &Config, spec: &RegionSpec, episodes: usize) -> f64 {
    let aip: Shape = AipStack::shape(spec, &config.aip);
    let steps = if aip.recurrent.is_some() { spec.horizon } else { 1 };
    let visits = config.aip.epochs * gradient_steps(config, spec, episodes) * config.aip.batch * steps;
    visits as f64 * (aip.forward_flops() + aip.backward_flops(steps))
        + 2.0 * (episodes * spec.horizon) as f64 * aip.forward_flops()
}

/// Gradient steps of an AIP per pass over such a dataset.
pub fn gradient_steps(config: &Config, spec: &RegionSpec, episodes: usize) -> usize {
    let sequences_per_episode = if config.aip.recurrent.is_some() { 1 } else { spec.horizon };
    let training = episodes - held_out_episodes(episodes, config.aip.held_out);
    training * sequences_per_episode / config.aip.batch
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Simulator;
    use crate::domain::SourceSpec;

    /// Policy 4 -> 3 -> (2 + 1): 21 weights; AIP 2 -> 5 -> 2: 20 weights.
    fn small() -> (Config, RegionSpec) {
        let config = "warehouse = { agents_per_side = 1, horizon = 10 }\npolicy = { hidden = [3] }\n\
                      ppo = { rollout_steps = 4, epochs = 3, time_limit = 'bootstrap' }\n\
                      aip = { hidden = [5], batch = 8, epochs = 2, held_out = 0.5 }";
        let sources = SourceSpec::Binary { sources: 2 };
        (toml::from_str(config).unwrap(), RegionSpec { obs_dim: 4, d_set_dim: 2, n_actions: 2, sources, horizon: 10 })
    }

    #[test]
    fn the_operations_of_a_timestep_are_counted_by_hand() {
        let (mut config, spec) = small();
        // Forward 42, backward 42 + 2 * 3 * 3 = 60: three epochs 306. Acting 42 * (1 + 1/4 + 1/10) = 56.7. AIP 40.
        let flops = Flops::of(&config, &spec);
        assert!((flops.training - 402.7).abs() < 1e-9, "{flops:?}");
        assert_eq!(flops.acting, 42.0);
        config.simulator = Simulator::Global;
        assert!((Flops::of(&config, &spec).training - 362.7).abs() < 1e-9);
    }

    #[test]
    fn the_operations_of_an_aip_training_are_counted_by_hand() {
        let (config, spec) = small();
        // Four episodes of 10, two held out: 20 samples make two batches of 8. Forward 40, backward 40 + 2 * 10 = 60:
        // 2 epochs * 16 samples * 100 = 3200, and the losses 2 * 40 samples * 40 = 3200.
        assert_eq!(aip_training_flops(&config, &spec, 4), 6400.0);
    }
}
