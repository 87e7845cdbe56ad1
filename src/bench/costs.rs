//! From orders to the cost of a whole run, in core-microseconds per agent-step.
//!
//! A core-microsecond is a microsecond of wall time on one core: with two workers a microsecond of wall time costs two.
//! What happens once per order (simulators made, messages, files) counts as often as the schedule has orders of the
//! kind; episodes on the GS go in rounds, in which every worker plays one; a training of the AIPs costs what its
//! operations cost in the measured ones.

use super::floor::{Flops, aip_trainings_flops};
use super::measure::{Measured, Orders};
use crate::base::Phase;
use crate::config::{AipTraining, Config, schedule};
use crate::domain::Kinds;

/// How much of everything a run is.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Amounts {
    agents: f64,
    /// Timesteps of all agents.
    agent_steps: f64,
    periods: f64,
    /// Timesteps of all agents that simulators play again to go on after a period.
    retraced: f64,
    evaluations: f64,
    /// Episodes of each of them.
    evaluation_episodes: usize,
    /// Episodes of the one at the end.
    final_episodes: usize,
    /// Trainings of the AIPs, with a collection before each.
    retrainings: f64,
    /// Episodes per collection.
    collection_episodes: usize,
    horizon: f64,
    /// Operations of a training of all AIPs.
    retraining_flops: f64,
}

impl Amounts {
    fn of(config: &Config, kinds: &Kinds) -> Amounts {
        let (agents, horizon) = (kinds.agents(), kinds.horizon());
        let periods = schedule(config);
        let count = |of: fn(&crate::config::Period) -> bool| periods.iter().filter(|period| of(period)).count() as f64;
        let episodes = config.dataset_episodes(horizon);
        Amounts {
            agents: agents as f64,
            agent_steps: agents as f64 * config.last_step() as f64,
            periods: periods.len() as f64,
            retraced: (periods.len() - 1) as f64 * (agents * config.copies() * horizon) as f64 / 2.0,
            evaluations: count(|period| period.evaluate),
            evaluation_episodes: config.evaluation.episodes,
            final_episodes: config.evaluation.final_episodes,
            // Drift cannot be foreseen.
            retrainings: count(|period| period.train_aips == AipTraining::Yes),
            collection_episodes: episodes,
            horizon: horizon as f64,
            retraining_flops: aip_trainings_flops(config, kinds, episodes),
        }
    }
}

/// Phases of a simulator's step.
const SIMULATING: [Phase; 3] = [Phase::Insertion, Phase::SimulatorStep, Phase::Reading];

/// A cost beside what cannot be avoided, in core-microseconds per agent-step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    pub ours: f64,
    /// Inside SUMO's own step; nothing for simulators of our own, which could be faster.
    pub sumo: f64,
    /// Matrix products at the speed of large ones.
    pub products: f64,
    /// Parts of `ours`, in the order of [`Phase::ALL`].
    pub phases: [f64; Phase::ALL.len()],
}

impl Cost {
    pub fn floor(&self) -> f64 {
        self.sumo + self.products
    }

    pub fn ratio(&self) -> f64 {
        self.ours / self.floor()
    }

    pub fn phase(&self, phase: Phase) -> f64 {
        self.phases[phase as usize]
    }

    fn add(&mut self, other: Cost) {
        self.ours += other.ours;
        self.sumo += other.sumo;
        self.products += other.products;
        self.phases.iter_mut().zip(other.phases).for_each(|(mine, theirs)| *mine += theirs);
    }
}

/// What a run costs on a fleet.
#[derive(Clone, Debug)]
pub struct Costs {
    pub workers: usize,
    /// Of the policies' training: what is in no phase.
    pub other: f64,
    /// Of the policies' training: workers that wait for the slowest one.
    pub idle: f64,
    /// Messages and files between the orders.
    pub exchange: f64,
    pub training: Cost,
    pub evaluation: Cost,
    pub collection: Cost,
    pub aip_training: Cost,
    /// Steps of the GS per second of wall time while datasets are collected.
    pub gs_steps_per_s: Option<f64>,
    pub pss_kib: u64,
    pub peak_rss_kib: u64,
}

impl Costs {
    /// `config`: of the run, not of the short orders that were `measured`.
    pub fn of(config: &Config, kinds: &Kinds, peak_flops: f64, measured: &Measured) -> Costs {
        let amounts = Amounts::of(config, kinds);
        let flops = Flops::of_all(config, kinds);
        let sumo = config.traffic.is_some();
        let products = |flops: f64| 1e6 * flops / peak_flops;
        let workers = measured.workers as f64;
        let Measured { training, evaluation, collection, aip_training, .. } = measured;

        let mut phases = Phase::ALL.map(|phase| per_unit(training, phase));
        phases[Phase::Loading as usize] = per_order(training, Phase::Loading) * amounts.periods / amounts.agent_steps;
        // The measured orders begin with empty roads. A period begins with episodes of any age, half a horizon on average.
        let again = SIMULATING.iter().map(|&phase| phases[phase as usize]).sum::<f64>();
        phases[Phase::Retracing as usize] = again * amounts.retraced / amounts.agent_steps;
        let work = 1e6 * (training.work.as_secs_f64() - training.phases.total().as_secs_f64()) / training.units;
        let other = work.max(0.0);
        let busy = training.work - training.beginning();
        let idle = 1e6 * (workers * training.slowest.as_secs_f64() - busy.as_secs_f64()).max(0.0) / training.units;
        let training_cost = Cost {
            ours: phases.iter().sum::<f64>() + other + idle,
            sumo: if sumo { phases[Phase::SimulatorStep as usize] } else { 0.0 },
            products: products(flops.training),
            phases,
        };

        // On the GS: per round, and once per order.
        let on_the_gs = |orders: &Orders, count: f64, episodes: usize| {
            if orders.count == 0 || count == 0.0 {
                return Cost::default();
            }
            let rounds = episodes.div_ceil(measured.workers) as f64;
            let ours = rounds * workers * 1e6 * orders.slowest.as_secs_f64() / orders.units
                + per_order(orders, Phase::Loading);
            let acting = episodes as f64 * amounts.horizon * amounts.agents * flops.acting;
            let share = count / amounts.agent_steps;
            let mut phases = Phase::ALL.map(|phase| per_unit(orders, phase) / workers * episodes as f64 * share);
            phases[Phase::Loading as usize] = per_order(orders, Phase::Loading) * share;
            Cost {
                ours: ours * share,
                sumo: if sumo { phases[Phase::SimulatorStep as usize] } else { 0.0 },
                products: products(acting) * share,
                phases,
            }
        };
        let mut evaluation_cost = on_the_gs(evaluation, amounts.evaluations, amounts.evaluation_episodes);
        evaluation_cost.add(on_the_gs(evaluation, 1.0, amounts.final_episodes));
        let collection_cost = on_the_gs(collection, amounts.retrainings, amounts.collection_episodes);

        let mut aip_cost = Cost::default();
        if aip_training.count > 0 && amounts.retrainings > 0.0 {
            let scale = amounts.retrainings * amounts.retraining_flops / amounts.agent_steps;
            let per_flop = |seconds: f64| 1e6 * seconds / aip_training.units * scale;
            aip_cost = Cost {
                ours: per_flop(workers * aip_training.slowest.as_secs_f64()),
                sumo: 0.0,
                products: products(scale),
                phases: Phase::ALL.map(|phase| per_flop(aip_training.phases.spent(phase).as_secs_f64())),
            };
        }

        let exchange = |orders: &Orders, count: f64| {
            let load = orders.beginning().as_secs_f64() / workers;
            let outside = orders.wall.as_secs_f64() - orders.slowest.as_secs_f64() - load;
            1e6 * workers * outside.max(0.0) / orders.count.max(1) as f64 * count / amounts.agent_steps
        };
        let retrainings = amounts.retrainings;
        let exchange = exchange(training, amounts.periods)
            + exchange(evaluation, amounts.evaluations + 1.0)
            + exchange(collection, retrainings)
            + exchange(aip_training, retrainings);
        let rounds_per_s = (collection.count > 0).then(|| collection.units / collection.slowest.as_secs_f64());
        Costs {
            workers: measured.workers,
            other,
            idle,
            exchange,
            training: training_cost,
            evaluation: evaluation_cost,
            collection: collection_cost,
            aip_training: aip_cost,
            gs_steps_per_s: rounds_per_s.map(|rounds| rounds * workers * amounts.horizon),
            pss_kib: measured.pss_kib,
            peak_rss_kib: measured.peak_rss_kib,
        }
    }

    /// Everything.
    pub fn all(&self) -> Cost {
        let mut all = Cost { ours: self.exchange, ..Cost::default() };
        [self.training, self.evaluation, self.collection, self.aip_training].into_iter().for_each(|cost| all.add(cost));
        all
    }

    /// Timesteps of agents per second of wall time, everything included.
    pub fn agent_steps_per_s(&self) -> f64 {
        1e6 * self.workers as f64 / self.all().ours
    }
}

/// Core-microseconds of a phase per unit.
fn per_unit(orders: &Orders, phase: Phase) -> f64 {
    1e6 * orders.phases.spent(phase).as_secs_f64() / orders.units
}

/// Core-microseconds of a phase per order.
fn per_order(orders: &Orders, phase: Phase) -> f64 {
    1e6 * orders.phases.spent(phase).as_secs_f64() / orders.count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Stopwatch;
    use crate::domain::{RegionSpec, SourceSpec};
    use std::time::Duration;

    fn orders(count: usize, units: f64, wall: u64, slowest: u64, work: u64, phases: &[(Phase, u64)]) -> Orders {
        let seconds = Duration::from_secs;
        let mut watch = Stopwatch::default();
        phases.iter().for_each(|&(phase, time)| watch.note(phase, seconds(time)));
        Orders { count, units, wall: seconds(wall), slowest: seconds(slowest), work: seconds(work), phases: watch }
    }

    /// One agent, 1000 timesteps in ten periods, each with an evaluation of 3 episodes, one of 5 at the end; AIPs trained twice on 2 episodes
    /// of 10 steps. Networks as in the tests of the floor, and a machine of 1e6 operations per second.
    fn setting() -> (Config, Kinds) {
        let config = "total_steps = 1000\ntraffic = { network = 'n', local_network = 'l', horizon = 10 }\n\
                      policy = { hidden = [3] }\nppo = { rollout_steps = 4, epochs = 3, time_limit = 'bootstrap' }\n\
                      aip = { hidden = [5], batch = 8, epochs = 2, held_out = 0.5, dataset_steps = 40, \
                      retrain_every_steps = 500 }\nevaluation = { every_steps = 100, episodes = 3, final_episodes = 5 }";
        let sources = SourceSpec::bits(2);
        let spec = RegionSpec { obs_dim: 4, d_set_dim: 2, n_actions: 2, masks: false, sources, horizon: 10 };
        (toml::from_str(config).unwrap(), Kinds::one(1, spec))
    }

    #[test]
    fn a_run_on_two_workers_is_worked_out_by_hand() {
        let (config, kinds) = setting();
        let step = |seconds| (Phase::SimulatorStep, seconds);
        let measured = Measured {
            workers: 2,
            // 200 timesteps: workers of 8 and 6 s without loading, 2 s of loading, 1 s of messages.
            training: orders(1, 200.0, 10, 8, 16, &[step(4), (Phase::Forward, 5), (Phase::Loading, 2)]),
            // Two rounds of 3 s with 2 s of SUMO in each of the workers, half a second of messages per order.
            evaluation: orders(2, 2.0, 7, 6, 12, &[step(8)]),
            collection: orders(1, 1.0, 4, 4, 8, &[step(6)]),
            aip_training: orders(1, 6400.0, 2, 2, 3, &[(Phase::Backward, 2)]),
            pss_kib: 1,
            peak_rss_kib: 1,
        };
        let costs = Costs::of(&config, &kinds, 1e6, &measured);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6 * b.abs(), "{a} is not {b}");
        // In seconds per timestep, for 1000 timesteps:
        // step 4/200 = .02, forward 5/200 = .025, loading 2 * 10 / 1000 = .02, other (16 - 11)/200 = .025,
        // idle (16 - 14)/200 = .01.
        // Nine periods retrace half an episode of 10 steps: .02 x 45 / 1000 = .0009.
        near(costs.training.ours, 0.1009e6);
        near(costs.idle, 0.01e6);
        near(costs.other, 0.025e6);
        // 3 episodes are two rounds of 2 x 3 s: 12 s, ten times; 5 are three rounds: 18 s. SUMO 2 s per episode: 35 times.
        near(costs.evaluation.ours, 0.138e6);
        near(costs.evaluation.sumo, 0.07e6);
        // 4 episodes are two rounds of 2 x 4 s: 16 s, twice; SUMO 3 s per episode: 12 s, twice.
        near(costs.collection.ours, 0.032e6);
        near(costs.collection.sumo, 0.024e6);
        // 6400 operations as measured (2 x 2 s), twice; at 1e6 per second 12.8 ms.
        near(costs.aip_training.ours, 0.008e6);
        near(costs.aip_training.products, 12.8);
        // 2 x (10 - 8 - 1) s ten times, 2 x .5 s eleven times, nothing for the others: 31 s.
        near(costs.exchange, 0.031e6);
        near(costs.all().ours, 0.3099e6);
        near(costs.agent_steps_per_s(), 2.0 / 0.3099);
        // SUMO's step: .02 + .07 + .024; passes: .025 + 2 s of the AIPs' twice in 1000 timesteps.
        near(costs.all().phase(Phase::SimulatorStep), 0.114e6);
        near(costs.all().phase(Phase::Forward) + costs.all().phase(Phase::Backward), 0.029e6);
        // A round of two episodes of 10 steps in 4 s.
        near(costs.gs_steps_per_s.unwrap(), 5.0);
        // 402.7 operations per timestep of training.
        near(costs.training.floor(), 0.02e6 + 402.7);
    }
}
