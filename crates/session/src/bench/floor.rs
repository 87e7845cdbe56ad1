//! The floor under a run's cost: its matrix products, in floating-point operations.

use crate::config::RunConfig;
use dials_core::domain::{Kinds, RegionSpec};
use dials_learn::algorithms;
use dials_learn::config::held_out_episodes;
use dials_learn::policy::PolicyStack;
use dials_learn::predictors::AipStack;

/// Number of operations per agent and unit of work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Flops {
    /// Operations per timestep of training: PPO, acting, and sampling from the AIP.
    pub(crate) training: f64,
    /// Operations per step on the GS, in evaluation and collection.
    pub(crate) acting: f64,
}

impl Flops {
    /// Returns the means over the agents of all kinds.
    pub(crate) fn of_all(config: &RunConfig, kinds: &Kinds) -> Flops {
        let mean = |pick: fn(Flops) -> f64| {
            let sums = kinds.iter().map(|kind| kind.agents.len() as f64 * pick(Flops::of(config, &kind.spec)));
            sums.sum::<f64>() / kinds.agents() as f64
        };
        Flops { training: mean(|flops| flops.training), acting: mean(|flops| flops.acting) }
    }

    fn of(config: &RunConfig, spec: &RegionSpec) -> Flops {
        let policy = PolicyStack::shape(spec, &config.learning.policy);
        let learning =
            algorithms::of(&config.learning).flops_per_step(&config.learning, &policy, config.training_horizon());
        let predictor = config.learning.predictor_in_use();
        let sampling = predictor.map_or(0.0, |choice| choice.kind().sampling_flops(spec, &config.learning.aip));
        Flops { training: learning + sampling, acting: policy.forward_flops() }
    }
}

/// Returns the operations of all agents' AIP trainings on datasets of N episodes.
pub(crate) fn aip_trainings_flops(config: &RunConfig, kinds: &Kinds, episodes: usize) -> f64 {
    kinds.iter().map(|kind| kind.agents.len() as f64 * aip_training_flops(config, &kind.spec, episodes)).sum()
}

/// Returns the operations of one agent: the gradient steps, and the loss before and after on all samples.
fn aip_training_flops(config: &RunConfig, spec: &RegionSpec, episodes: usize) -> f64 {
    let config_of_aips = &config.learning.aip;
    let aip = AipStack::shape(spec, config_of_aips);
    let steps = if aip.recurrent.is_some() { spec.horizon } else { 1 };
    let visits = config_of_aips.epochs * gradient_steps(config, spec.horizon, episodes) * config_of_aips.batch * steps;
    visits as f64 * (aip.forward_flops() + aip.backward_flops(steps))
        + 2.0 * (episodes * spec.horizon) as f64 * aip.forward_flops()
}

/// Returns the gradient steps of an AIP per pass over such a dataset.
pub(crate) fn gradient_steps(config: &RunConfig, horizon: usize, episodes: usize) -> usize {
    let sequences_per_episode = if config.learning.aip.recurrent.is_some() { 1 } else { horizon };
    let training = episodes - held_out_episodes(episodes, config.learning.aip.held_out);
    training * sequences_per_episode / config.learning.aip.batch
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use dials_core::base::AgentId;
    use dials_core::domain::{Kind, SourceSpec};
    use dials_learn::config::Simulator;

    /// Returns small networks. Policy 4 -> 3 -> (2 + 1): 21 weights; AIP 2 -> 5 -> 2: 20 weights.
    pub(in crate::bench) fn small() -> (RunConfig, RegionSpec) {
        // A run of 1000 timesteps in ten periods, each with an evaluation of 3 episodes, and one of 5 at the end. AIPs are
        // trained twice on 4 episodes of 10 steps.
        let config = "total_steps = 1000\ntraffic = { network = 'n', local_network = 'l', horizon = 10 }\n\
                      policy = { hidden = [3] }\n\
                      ppo = { memory = 100, rollout_steps = 4, epochs = 3, time_limit = 'bootstrap' }\n\
                      aip = { hidden = [5], batch = 8, epochs = 2, held_out = 0.5, dataset_steps = 40, \
                      retrain_every_steps = 500 }\n\
                      evaluation = { every_steps = 100, episodes = 3, final_episodes = 5 }";
        let sources = SourceSpec::bits(2);
        let (horizon, local_horizon) = (10, 10);
        let spec = RegionSpec {
            obs_dim: 4,
            d_set_dim: 2,
            n_actions: 2,
            sets: None,
            masks: false,
            sources,
            horizon,
            local_horizon,
        };
        (toml::from_str(config).unwrap(), spec)
    }

    #[test]
    fn the_operations_of_a_timestep_and_of_an_aip_training_are_counted_by_hand() {
        let (mut config, spec) = small();
        // Forward 42, backward 42 + 2 * 3 * 3 = 60: three epochs 306. Acting 42 * (1 + 1/4 + 1/10) = 56.7. AIP 40.
        let flops = Flops::of(&config, &spec);
        assert!((flops.training - 402.7).abs() < 1e-9, "{flops:?}");
        assert_eq!(flops.acting, 42.0);
        config.learning.simulator = Simulator::Global;
        assert!((Flops::of(&config, &spec).training - 362.7).abs() < 1e-9);
        // Four episodes of 10, two held out: 20 samples make two batches of 8. Forward 40, backward 40 + 2 * 10 = 60:
        // 2 epochs * 16 samples * 100 = 3200, and the losses 2 * 40 samples * 40 = 3200.
        assert_eq!(aip_training_flops(&config, &spec, 4), 6400.0);
    }

    #[test]
    fn agents_of_two_kinds_cost_their_mean() {
        let (config, spec) = small();
        let wider = RegionSpec { obs_dim: 5, ..spec.clone() };
        let kind = |name: &str, spec, agents: [usize; 2]| Kind {
            name: name.to_owned(),
            spec,
            agents: agents.map(AgentId).to_vec(),
        };
        let kinds = Kinds::new(vec![kind("a", spec, [0, 2]), kind("b", wider, [1, 3])]).unwrap();
        // An input more: 2 * 3 operations more per pass.
        assert_eq!(Flops::of_all(&config, &kinds).acting, (42.0 + 48.0) / 2.0);
        assert_eq!(aip_trainings_flops(&config, &kinds, 4), 4.0 * 6400.0);
    }
}
