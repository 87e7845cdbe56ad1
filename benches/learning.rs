//! Benchmarks of the hot functions of learning, with the shapes of the shipped configs: `cargo bench --bench learning`.
//!
//! Throughputs are agent-steps per second of the function alone. For the speed of a whole run: `dials-traffic bench`.

use std::path::Path;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dials_core::base::{AgentId, Dice, Rows, Seed, Stopwatch};
use dials_core::domain::sampling;
use dials_core::domain::{RegionSpec, SourceSpec};
use dials_learn::algorithms::ppo::gae::advantages;
use dials_learn::algorithms::ppo::update::{Decayed, Learns, Settings, update};
use dials_learn::algorithms::ppo::{Memory, Sample, ValueUnits};
use dials_learn::policy::PolicyStack;
use dials_learn::predictors::{AipStack, InfluencePredictor};
use dials_session::config::{RunConfig, load};
use rand::Rng;
use stacknets::{Adam, Threads};

/// Networks and training settings of a domain.
struct Setting {
    name: &'static str,
    config: RunConfig,
    spec: RegionSpec,
}

/// Returns the settings of traffic (feed-forward networks) and of the warehouse (recurrent networks).
fn settings() -> [Setting; 2] {
    let config = |name: &str| load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(name), &[]).unwrap();
    let spec = |inputs, n_actions, sources, horizon| RegionSpec {
        obs_dim: inputs,
        d_set_dim: inputs,
        n_actions,
        sets: None,
        masks: false,
        sources,
        horizon,
        local_horizon: horizon,
    };
    let items = SourceSpec { classes: vec![4; 4], parts: 0 };
    [
        Setting { name: "traffic", config: config("traffic_4.toml"), spec: spec(40, 2, SourceSpec::bits(4), 300) },
        Setting { name: "warehouse", config: config("warehouse_4.toml"), spec: spec(37, 4, items, 100) },
    ]
}

impl Setting {
    fn policies(&self, agents: usize) -> PolicyStack {
        let bias = vec![0.0; self.spec.n_actions];
        PolicyStack::new(&AgentId::all(agents), &self.spec, &self.config.learning.policy, &bias, Seed::new(1))
    }

    /// Makes a memory of random decisions.
    fn memory(&self, agents: usize, dice: &mut Dice) -> Memory {
        let (capacity, state_width) =
            (self.config.learning.ppo.memory, self.config.learning.policy.recurrent.unwrap_or(0));
        let length = self.config.learning.sequence_length();
        let mut memory = Memory::new(agents, capacity, length, &self.spec, state_width);
        for agent in 0..agents {
            for slot in 0..capacity {
                let (obs, state) = (bits(self.spec.obs_dim, dice), numbers(state_width, dice));
                let action = dice.random_range(0..self.spec.n_actions) as u8;
                let log_prob = -(self.spec.n_actions as f32).ln();
                let [value, advantage] = dice.random();
                let sample =
                    Sample { action, log_prob, value, output: value, advantage, ret: value + advantage, start: false };
                memory.remember(agent, slot, (&obs, &[]), &state, sample);
            }
        }
        memory
    }
}

/// Makes a dice stream per agent.
fn streams(count: usize) -> Vec<Dice> {
    AgentId::all(count).into_iter().map(|agent| Seed::new(2).for_agent(agent).dice()).collect()
}

/// Draws zeros and ones, mostly zeros like observations.
fn bits(count: usize, dice: &mut Dice) -> Vec<f32> {
    (0..count).map(|_| f32::from(u8::from(dice.random_bool(0.2)))).collect()
}

fn numbers(count: usize, dice: &mut Dice) -> Vec<f32> {
    (0..count).map(|_| dice.random_range(-1.0..1.0)).collect()
}

fn gae(criterion: &mut Criterion) {
    let (steps, rows) = (16, 32);
    let dice = &mut Seed::new(3).dice();
    let (rewards, values) = (numbers(steps * rows, dice), numbers(steps * rows, dice));
    let ends: Vec<bool> = (0..steps * rows).map(|_| dice.random_bool(1.0 / 300.0)).collect();
    let last_values = numbers(rows, dice);
    let mut group = criterion.benchmark_group("advantages");
    group.throughput(Throughput::Elements((steps * rows) as u64));
    group.bench_function("16 steps of 32 rows", |bencher| {
        bencher.iter(|| advantages(&rewards, &values, &ends, &last_values, 0.99, 0.95));
    });
}

fn ppo(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("ppo_update");
    group.sample_size(20);
    for setting in settings() {
        for agents in [1, 4] {
            let mut policies = setting.policies(agents);
            let mut adam = Adam::new(policies.parameters());
            let memory = setting.memory(agents, &mut Seed::new(4).dice());
            let mut dice = streams(agents);
            let (config, watch) = (&setting.config.learning.ppo, &mut Stopwatch::default());
            // The rate is so small that the policies do not change, however long this runs.
            let decayed = Decayed { learning_rate: 1e-12, clip: config.clip };
            let units = ValueUnits::new(config.value_unit, agents);
            let settings = Settings { ppo: config, units: &units, decayed, learns: Learns::Everything, shared: false };
            group.throughput(Throughput::Elements((agents * config.memory) as u64));
            group.bench_function(BenchmarkId::new(setting.name, agents), |bencher| {
                bencher.iter(|| update(&mut policies, &mut adam, &memory, &mut dice, settings, watch));
            });
        }
    }
}

fn acting(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("acting");
    group.sample_size(50);
    for setting in settings() {
        // A block of local simulators, and all agents of a GS.
        for (agents, copies) in [(4, 8), (100, 1)] {
            let policies = setting.policies(agents);
            let rows = agents * copies;
            let mut states = policies.states(rows);
            let obs = Rows::from_vec(bits(rows * setting.spec.obs_dim, &mut Seed::new(5).dice()), setting.spec.obs_dim);
            let mut dice = streams(rows);
            let mut log_probs = vec![0.0; setting.spec.n_actions];
            group.throughput(Throughput::Elements(rows as u64));
            group.bench_function(BenchmarkId::new(setting.name, format!("{agents} agents x {copies}")), |bencher| {
                bencher.iter(|| {
                    let judgement = policies.judge(0..agents, &Threads::one(), &obs, &mut states);
                    let rows = judgement.rows().zip(&mut dice);
                    rows.fold(0_u64, |sum, ((logits, _), dice)| {
                        sampling::log_softmax(logits, &mut log_probs);
                        sum + u64::from(sampling::draw(&log_probs, dice))
                    })
                });
            });
        }
    }
}

fn aip_sampling(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("aip_sampling");
    group.sample_size(50);
    for setting in settings() {
        let (agents, copies) = (4, 8);
        let rows = agents * copies;
        let mut aips = AipStack::new(&AgentId::all(agents), &setting.spec, &setting.config.learning.aip, Seed::new(6));
        aips.begin(rows).expect("it is in this process");
        let width = setting.spec.d_set_dim;
        let d_set = Rows::from_vec(bits(rows * width, &mut Seed::new(7).dice()), width);
        let mut dice = streams(rows);
        let mut sources = Rows::new(rows, setting.spec.sources.count());
        group.throughput(Throughput::Elements(rows as u64));
        group.bench_function(BenchmarkId::new(setting.name, format!("{agents} agents x {copies}")), |bencher| {
            bencher.iter(|| aips.sample(&d_set, &mut dice, &mut sources).expect("it is in this process"));
        });
    }
}

fn adam(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("adam");
    for setting in settings() {
        for agents in [1, 4] {
            let mut policies = setting.policies(agents);
            let mut adam = Adam::new(policies.parameters());
            let gradient = vec![1e-3; policies.parameters().width()];
            group.throughput(Throughput::Elements((agents * gradient.len()) as u64));
            group.bench_function(BenchmarkId::new(setting.name, agents), |bencher| {
                bencher.iter(|| {
                    let learners = policies.learners(&mut adam, 1);
                    learners.into_iter().for_each(|mut learner| learner.descend(&gradient, 1e-12));
                });
            });
        }
    }
}

criterion_group!(benches, gae, ppo, acting, aip_sampling, adam);
criterion_main!(benches);
