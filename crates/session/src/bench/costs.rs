//! From orders to the cost of a whole run, in core-microseconds per agent-step.
//!
//! A core-microsecond is a microsecond of wall time on one core: with two workers a microsecond of wall time costs two.
//! Work that is done once per order (making simulators, messages, files) counts once for each order of the schedule.
//! Episodes on the GS go in rounds, in which every worker plays one. A training of the AIPs costs what its operations cost
//! in the measured trainings.

use std::ops::{Add, Mul};

use super::floor::{Flops, aip_trainings_flops};
use super::measure::{Measured, Orders, beginning};
use crate::config::RunConfig;
use crate::cost::{Prices, Workload};
use dials_core::base::Phase;
use dials_core::domain::Kinds;
use dials_learn::config::Simulator;

/// What happens in the lanes of a worker, which may be at work at the same time.
const IN_LANES: [Phase; 6] =
    [Phase::Reset, Phase::Insertion, Phase::SimulatorStep, Phase::Reading, Phase::Acting, Phase::AipSampling];
/// What learners do, which may be at work at the same time. So are minibatches gathered, but the phase has more than that.
const IN_LEARNERS: [Phase; 3] = [Phase::Forward, Phase::Backward, Phase::Adam];
const SIMULATING: [Phase; 3] = [Phase::Insertion, Phase::SimulatorStep, Phase::Reading];
/// Our work around a simulator's own step.
const AROUND: [Phase; 2] = [Phase::Insertion, Phase::Reading];
/// All work on a sample of training that is not the simulator's.
const LEARNING: [Phase; 6] =
    [Phase::Acting, Phase::AipSampling, Phase::Bookkeeping, Phase::Forward, Phase::Backward, Phase::Adam];

/// A cost with its lower bound, in core-microseconds per agent-step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    pub(crate) ours: f64,
    /// Part inside SUMO's own step; 0 for simulators of our own, which could be faster.
    pub(crate) sumo: f64,
    /// Cost of the matrix products at the speed of large products.
    pub products: f64,
    /// Parts of `ours`, in the order of [`Phase::ALL`].
    pub(crate) phases: [f64; Phase::ALL.len()],
}

impl Cost {
    pub(crate) fn floor(&self) -> f64 {
        self.sumo + self.products
    }

    pub(crate) fn ratio(&self) -> f64 {
        self.ours / self.floor()
    }

    pub(crate) fn phase(&self, phase: Phase) -> f64 {
        self.phases[phase as usize]
    }

    /// Returns a cost that is all in one phase.
    fn in_phase(phase: Phase, us: f64) -> Cost {
        let mut cost = Cost { ours: us, ..Cost::default() };
        cost.phases[phase as usize] = us;
        cost
    }
}

impl Add for Cost {
    type Output = Cost;

    fn add(self, other: Cost) -> Cost {
        Cost {
            ours: self.ours + other.ours,
            sumo: self.sumo + other.sumo,
            products: self.products + other.products,
            phases: std::array::from_fn(|phase| self.phases[phase] + other.phases[phase]),
        }
    }
}

impl Mul<f64> for Cost {
    type Output = Cost;

    fn mul(self, times: f64) -> Cost {
        Cost {
            ours: self.ours * times,
            sumo: self.sumo * times,
            products: self.products * times,
            phases: self.phases.map(|phase| phase * times),
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Steps {
    /// Whether another program makes them.
    pub foreign: bool,
    pub per_timestep: usize,
}

#[derive(Clone, Debug)]
pub struct Costs {
    pub(crate) workers: usize,
    /// Part of the policies' training that is in no phase.
    pub(crate) other: f64,
    /// Part of the policies' training in which workers wait for the slowest one.
    pub(crate) idle: f64,
    /// Cost of messages and files between the orders.
    pub(crate) exchange: f64,
    pub training: Cost,
    pub(crate) evaluation: Cost,
    pub(crate) collection: Cost,
    pub aip_training: Cost,
    /// Number of steps of the GS per second of wall time while datasets are collected.
    pub(crate) gs_steps_per_s: Option<f64>,
    pub(crate) simulators: SimulatorCosts,
    pub(crate) pss_kib: u64,
    pub(crate) peak_rss_kib: u64,
}

impl Costs {
    /// Computes the costs. `config`: that of the run, not that of the short orders in `measured`.
    pub fn of(config: &RunConfig, kinds: &Kinds, steps: Steps, peak_flops: f64, measured: &Measured) -> Costs {
        let work = Workload::of(config, kinds.agents(), config.learning.last_step());
        let machine = Machine { workers: measured.workers as f64, sumo: steps.foreign, peak_flops };
        let Measured { training, evaluation, collection, aip_training, .. } = measured;

        let flops = Flops::of_all(config, kinds);
        let of_episodes = |orders: &Orders, episodes: usize| {
            machine.on_the_gs(orders, episodes, work.gs_steps(episodes) * flops.acting)
        };
        let retraining_flops = aip_trainings_flops(config, kinds, work.dataset_episodes);
        let in_no_phase = 1e6 * (training.work.as_secs_f64() - training.phases.total().as_secs_f64()) / training.units;
        let busy = (training.work - beginning(&training.phases)).as_secs_f64();
        let at_once = AtOnce::of(config, kinds, steps.foreign, measured.workers);
        let lent = |phase: &Phase| (at_once.cores(*phase) - 1.0) * spent(training, *phase);
        let on_lent_cores = Phase::ALL.iter().map(lent).sum::<f64>();
        let waited = machine.workers * training.slowest.as_secs_f64() - busy - on_lent_cores;
        let (other, idle) = (in_no_phase.max(0.0), 1e6 * waited.max(0.0) / training.units);
        let mut phases = Phase::ALL.map(|phase| per_unit(training, phase));
        Orders::BEGINNING.iter().for_each(|&phase| phases[phase as usize] = 0.0);
        Phase::ALL.iter().for_each(|&phase| phases[phase as usize] *= at_once.cores(phase));
        // The measured orders begin with empty roads and replay none.
        let replayed = SIMULATING.iter().map(|&phase| phases[phase as usize]).sum();
        let prices = Prices {
            step: Cost {
                ours: phases.iter().sum::<f64>() + other + idle,
                sumo: machine.sumo_step(&phases),
                products: machine.products(flops.training),
                phases,
            },
            retraced_step: Cost::in_phase(Phase::Retracing, replayed),
            period: Cost::in_phase(Phase::Loading, per_order(training, Phase::Loading)),
            evaluation: of_episodes(evaluation, work.evaluation_episodes),
            final_evaluation: of_episodes(evaluation, work.final_episodes),
            collection: of_episodes(collection, work.dataset_episodes),
            aip_training: machine.aip_training(aip_training, retraining_flops),
        };
        let exchange = Prices {
            period: machine.exchange(training),
            evaluation: machine.exchange(evaluation),
            final_evaluation: machine.exchange(evaluation),
            collection: machine.exchange(collection),
            aip_training: machine.exchange(aip_training),
            ..Prices::default()
        };

        let per_agent_step = 1.0 / work.agent_steps();
        let whole = prices.of_run(&work);
        let rounds_per_s = (collection.count > 0).then(|| collection.units / collection.slowest.as_secs_f64());
        Costs {
            workers: measured.workers,
            other,
            idle,
            exchange: exchange.of_run(&work).sum() * per_agent_step,
            training: whole.training * per_agent_step,
            evaluation: whole.evaluation * per_agent_step,
            collection: whole.collection * per_agent_step,
            aip_training: whole.aip_training * per_agent_step,
            gs_steps_per_s: rounds_per_s.map(|rounds| rounds * machine.workers * work.horizon as f64),
            simulators: SimulatorCosts::of(config, kinds, (steps.per_timestep, at_once), measured),
            pss_kib: measured.pss_kib,
            peak_rss_kib: measured.peak_rss_kib,
        }
    }

    pub(crate) fn all(&self) -> Cost {
        let exchange = Cost { ours: self.exchange, ..Cost::default() };
        exchange + self.training + self.evaluation + self.collection + self.aip_training
    }

    /// Returns the timesteps of agents per second of wall time, everything included.
    pub fn agent_steps_per_s(&self) -> f64 {
        1e6 * self.workers as f64 / self.all().ours
    }
}

struct Machine {
    workers: f64,
    /// Whether the simulators are SUMO's.
    sumo: bool,
    /// Peak speed of matrix products, in operations per second.
    peak_flops: f64,
}

impl Machine {
    fn products(&self, flops: f64) -> f64 {
        1e6 * flops / self.peak_flops
    }

    fn sumo_step(&self, phases: &[f64]) -> f64 {
        if self.sumo { phases[Phase::SimulatorStep as usize] } else { 0.0 }
    }

    /// Returns the price of N episodes on the GS: of their rounds, and of the work once per order.
    fn on_the_gs(&self, orders: &Orders, episodes: usize, flops: f64) -> Cost {
        if orders.count == 0 {
            return Cost::default();
        }
        let rounds = (episodes as f64 / self.workers).ceil();
        let of_rounds = rounds * self.workers * 1e6 * orders.slowest.as_secs_f64() / orders.units;
        let mut phases = Phase::ALL.map(|phase| per_unit(orders, phase) / self.workers * episodes as f64);
        phases[Phase::Loading as usize] = per_order(orders, Phase::Loading);
        Cost {
            ours: of_rounds + per_order(orders, Phase::Loading),
            sumo: self.sumo_step(&phases),
            products: self.products(flops),
            phases,
        }
    }

    fn aip_training(&self, orders: &Orders, flops: f64) -> Cost {
        if orders.count == 0 {
            return Cost::default();
        }
        let per_flop = |seconds: f64| 1e6 * seconds / orders.units * flops;
        Cost {
            ours: per_flop(self.workers * orders.slowest.as_secs_f64()),
            sumo: 0.0,
            products: self.products(flops),
            phases: Phase::ALL.map(|phase| per_flop(orders.phases.spent(phase).as_secs_f64())),
        }
    }

    /// Returns the price of the messages and files of an order.
    fn exchange(&self, orders: &Orders) -> f64 {
        let load = beginning(&orders.phases).as_secs_f64() / self.workers;
        let outside = orders.wall.as_secs_f64() - orders.slowest.as_secs_f64() - load;
        1e6 * self.workers * outside.max(0.0) / orders.count.max(1) as f64
    }
}

/// Cost of one step of a simulator for one agent, in core-microseconds. Making simulators and beginning episodes is not
/// in it. For traffic such a step is a light, or the local region of one, for a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StepCost {
    /// Inside the simulator's own step.
    pub(crate) own_us: f64,
    /// Around it: setting lights, letting cars in, reading.
    pub(crate) around_us: f64,
}

/// Costs of the simulators of a run by themselves, and of learning for comparison.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SimulatorCosts {
    pub(crate) steps_per_timestep: usize,
    /// The simulators by name: the GS in evaluations, the GS while datasets are collected, when it also observes the
    /// influence on the local regions, and what the policies train on.
    pub(crate) named: Vec<(&'static str, StepCost)>,
    /// Everything else in training, per agent and timestep.
    pub(crate) learning_us: f64,
}

impl SimulatorCosts {
    fn of(
        config: &RunConfig,
        kinds: &Kinds,
        (steps_per_timestep, at_once): (usize, AtOnce),
        measured: &Measured,
    ) -> SimulatorCosts {
        let steps = steps_per_timestep as f64;
        // An episode of each worker is that many steps of agents.
        let of_episode = (measured.workers * kinds.horizon() * kinds.agents()) as f64 * steps;
        let cost = |orders: &Orders, steps_per_unit: f64| StepCost {
            own_us: per_unit(orders, Phase::SimulatorStep) / steps_per_unit,
            around_us: AROUND.iter().map(|&phase| per_unit(orders, phase)).sum::<f64>() / steps_per_unit,
        };
        let mut named = vec![("GS in evaluation", cost(&measured.evaluation, of_episode))];
        if measured.collection.count > 0 {
            named.push(("GS in collection", cost(&measured.collection, of_episode)));
        }
        let on_gs = config.learning.simulator == Simulator::Global;
        named.push((
            if on_gs { "GS in training" } else { "LS in training" },
            cost(&measured.training, steps / at_once.lanes),
        ));
        let learning_us =
            LEARNING.iter().map(|&phase| at_once.cores(phase) * per_unit(&measured.training, phase)).sum();
        SimulatorCosts { steps_per_timestep, named, learning_us }
    }
}

/// Cores at work in the lanes and in the learners of the one worker that learns for all, on its own core and on those of the others,
/// which wait; 1 otherwise. Its times are those of the wall, as if all of these cores were at work all the time.
#[derive(Clone, Copy)]
struct AtOnce {
    lanes: f64,
    learners: f64,
}

impl AtOnce {
    fn of(config: &RunConfig, kinds: &Kinds, foreign: bool, workers: usize) -> AtOnce {
        if !config.learning.learns_at_one_place() {
            return AtOnce { lanes: 1.0, learners: 1.0 };
        }
        let agents = kinds.agents();
        let at_most = |count: usize| workers.min(count) as f64;
        let lanes = at_most(config.learning.most_at_work(agents, foreign));
        AtOnce { lanes, learners: at_most(config.learning.most_learners(agents)) }
    }

    fn cores(self, phase: Phase) -> f64 {
        if IN_LANES.contains(&phase) {
            self.lanes
        } else if IN_LEARNERS.contains(&phase) {
            self.learners
        } else {
            1.0
        }
    }
}

fn spent(orders: &Orders, phase: Phase) -> f64 {
    orders.phases.spent(phase).as_secs_f64()
}

fn per_unit(orders: &Orders, phase: Phase) -> f64 {
    1e6 * spent(orders, phase) / orders.units
}

fn per_order(orders: &Orders, phase: Phase) -> f64 {
    1e6 * spent(orders, phase) / orders.count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::floor::tests::small;
    use super::*;
    use dials_core::base::Stopwatch;
    use dials_learn::config::Share;
    use std::time::Duration;

    fn orders(count: usize, units: f64, wall: u64, slowest: u64, work: u64, phases: &[(Phase, u64)]) -> Orders {
        let seconds = Duration::from_secs;
        let mut watch = Stopwatch::default();
        phases.iter().for_each(|&(phase, time)| watch.note(phase, seconds(time)));
        Orders { count, units, wall: seconds(wall), slowest: seconds(slowest), work: seconds(work), phases: watch }
    }

    #[test]
    fn a_run_on_two_workers_is_worked_out_by_hand() {
        // Networks as in the tests of the floor, and a machine of 1e6 operations per second.
        let (config, spec) = small();
        let kinds = Kinds::one(1, spec);
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
        let steps = Steps { foreign: true, per_timestep: 5 };
        let costs = Costs::of(&config, &kinds, steps, 1e6, &measured);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6 * b.abs(), "{a} is not {b}");
        // In seconds per timestep, for 1000 timesteps:
        // step 4/200 = .02, forward 5/200 = .025, loading 2 * 10 / 1000 = .02, other (16 - 11)/200 = .025,
        // idle (16 - 14)/200 = .01.
        // Nine periods replay half an episode of 10 steps: .02 x 45 / 1000 = .0009.
        near(costs.training.ours, 0.1009e6);
        near(costs.idle, 0.01e6);
        near(costs.other, 0.025e6);
        // 3 episodes: two rounds of 2 x 3 s = 12 s, ten times; 5: three rounds, 18 s. SUMO: 2 s per episode, 35 times.
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
        // Per agent and step of SUMO, of which a timestep has 5: in training 4 s / 200 / 5; in two evaluations, each of an
        // episode of 10 timesteps on 2 workers, 8 s / 2 / 2 / 50; in the collection 6 s / 2 / 50.
        let expected = [("GS in evaluation", 0.04e6), ("GS in collection", 0.06e6), ("LS in training", 0.004e6)];
        for ((name, cost), (expected_name, own_us)) in costs.simulators.named.iter().zip(expected) {
            assert_eq!((*name, cost.around_us), (expected_name, 0.0));
            near(cost.own_us, own_us);
        }
        // The forward passes: 5 s / 200.
        near(costs.simulators.learning_us, 0.025e6);
        // 402.7 operations per timestep of training.
        near(costs.training.floor(), 0.02e6 + 402.7);
    }

    #[test]
    fn cores_that_a_worker_lends_to_the_learner_are_not_idle() {
        let (mut config, spec) = small();
        config.learning.simulator = Simulator::Global;
        config.learning.gs.copies = Some(2);
        let measured = Measured {
            workers: 2,
            // One worker learns for 8 s. In 3 of them its two copies are at work, the second one on the other's core.
            training: orders(1, 200.0, 8, 8, 8, &[(Phase::SimulatorStep, 3), (Phase::Forward, 5)]),
            evaluation: orders(2, 2.0, 7, 6, 12, &[]),
            collection: orders(1, 1.0, 1, 1, 1, &[]),
            aip_training: orders(1, 1.0, 1, 1, 1, &[]),
            pss_kib: 1,
            peak_rss_kib: 1,
        };
        let costs = Costs::of(&config, &Kinds::one(1, spec), Steps { foreign: true, per_timestep: 1 }, 1e6, &measured);
        // Two cores for 8 s are 16 s: 2 x 3 of SUMO, 5 of passes, and 5 in which one core waits. For 200 timesteps.
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6 * b.abs(), "{a} is not {b}");
        near(costs.idle, 0.025e6);
        near(costs.training.phase(Phase::SimulatorStep), 0.03e6);
        near(costs.training.phase(Phase::Forward), 0.025e6);
        assert_eq!(costs.other, 0.0);
    }

    #[test]
    fn cores_at_work_at_once_are_counted_by_hand() {
        let (mut config, spec) = small();
        let kinds = Kinds::one(4, spec);
        let of = |config: &RunConfig, workers: usize| {
            let at_once = AtOnce::of(config, &kinds, true, workers);
            (at_once.lanes, at_once.learners)
        };
        assert_eq!(of(&config, 3), (1.0, 1.0), "each worker has agents of its own");
        (config.learning.simulator, config.learning.gs.copies) = (Simulator::Global, Some(2));
        assert_eq!(of(&config, 3), (2.0, 3.0), "two copies, and four learners on three cores");
        config.learning.policy.share = Share::Kind;
        assert_eq!(of(&config, 3), (2.0, 1.0), "one policy, in one network");
        config.learning.policy.separate_critic = true;
        assert_eq!(of(&config, 3), (2.0, 2.0), "a tower each");
        assert_eq!(of(&config, 1), (1.0, 1.0));
        config.learning.ppo.max_gradient_norm = Some(0.5);
        assert_eq!(of(&config, 3), (2.0, 1.0), "the limit joins the towers");
    }
}
