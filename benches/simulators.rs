//! Benchmarks of the simulators under random actions: `cargo bench --bench simulators`.
//!
//! Throughputs are agent-steps per second of the simulator alone, without policies and AIPs. Episodes restart at their
//! horizon, so the traffic is that of a whole episode.

use std::path::Path;
use std::sync::Arc;

use criterion::{
    BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main, measurement::WallTime,
};
use dials_core::base::{AgentId, Dice, Rows, Seed};
use dials_core::domain::{Action, Beginning, Domain, GlobalSimulator, LocalSimulator, RegionSpec};
use dials_session::config::load;
use dials_session::domains::find;
use rand::Rng;

/// Probability of an arrival per edge and step, as at the boundary of the paper's grids.
const ARRIVALS: f64 = 0.1;

fn domain(config: &str) -> Arc<dyn Domain> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(config);
    find(&load(&path, &[]).unwrap()).unwrap()
}

/// Draws random actions. In traffic, most of them keep the light.
fn act(spec: &RegionSpec, actions: &mut [Action], dice: &mut Dice) {
    for action in actions {
        *action = match spec.n_actions {
            2 => Action::from(dice.random_bool(0.1)),
            n_actions => dice.random_range(0..n_actions) as Action,
        };
    }
}

fn influence(spec: &RegionSpec, sources: &mut Rows<u8>, dice: &mut Dice) {
    let classes = spec.sources.classes.iter().cycle();
    for (source, &classes) in sources.as_mut_slice().iter_mut().zip(classes) {
        *source = match classes {
            2 => u8::from(dice.random_bool(ARRIVALS)),
            classes => dice.random_range(0..classes),
        };
    }
}

fn local(group: &mut BenchmarkGroup<'_, WallTime>, name: &str, domain: &dyn Domain, rows: usize) {
    let spec = domain.kinds()[0].spec.clone();
    let mut simulator = domain.local_simulator(&[AgentId(0)], rows, Seed::new(1)).unwrap();
    simulator.reset(&Beginning::first(0..rows)).unwrap();
    let (mut actions, mut sources) = (vec![0; rows], Rows::new(rows, spec.sources.count()));
    let (mut dice, mut steps) = (Seed::new(2).dice(), 0);
    group.throughput(Throughput::Elements(rows as u64));
    group.bench_function(BenchmarkId::new(name, rows), |bencher| {
        bencher.iter(|| step_local(&mut *simulator, &spec, &mut actions, &mut sources, &mut dice, &mut steps));
    });
}

/// Steps a local simulator. Its rows start their episodes at different steps.
fn step_local(
    simulator: &mut dyn LocalSimulator,
    spec: &RegionSpec,
    actions: &mut [Action],
    sources: &mut Rows<u8>,
    dice: &mut Dice,
    steps: &mut usize,
) {
    act(spec, actions, dice);
    influence(spec, sources, dice);
    simulator.step(actions, sources).unwrap();
    *steps += 1;
    let rows = actions.len();
    let age = |row: usize| *steps + row * spec.horizon / rows;
    let over = (0..rows).filter(|&row| age(row).is_multiple_of(spec.horizon));
    let begin = |row| Beginning { row, episode: (age(row) / spec.horizon) as u64 };
    simulator.reset(&over.map(begin).collect::<Vec<_>>()).unwrap();
}

fn global(group: &mut BenchmarkGroup<'_, WallTime>, name: &str, domain: &dyn Domain) {
    let spec = domain.kinds()[0].spec.clone();
    let mut simulator = domain.global_simulator().unwrap();
    simulator.reset(Seed::new(1)).unwrap();
    let mut actions = vec![0; domain.agents()];
    let (mut dice, mut steps) = (Seed::new(2).dice(), 0);
    group.throughput(Throughput::Elements(domain.agents() as u64));
    group.bench_function(BenchmarkId::new(name, domain.agents()), |bencher| {
        bencher.iter(|| step_global(&mut *simulator, &spec, &mut actions, &mut dice, &mut steps));
    });
}

fn step_global(
    simulator: &mut dyn GlobalSimulator,
    spec: &RegionSpec,
    actions: &mut [Action],
    dice: &mut Dice,
    steps: &mut usize,
) {
    act(spec, actions, dice);
    simulator.step(actions).unwrap();
    *steps += 1;
    if steps.is_multiple_of(spec.horizon) {
        simulator.reset(Seed::new(1).for_episode(*steps)).unwrap();
    }
}

fn simulators(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("local_simulator");
    group.sample_size(50);
    for rows in [8, 16, 32, 64] {
        local(&mut group, "traffic", &*domain("traffic_4.toml"), rows);
    }
    local(&mut group, "warehouse", &*domain("warehouse_4.toml"), 32);
    group.finish();

    let mut group = criterion.benchmark_group("global_simulator");
    group.sample_size(50);
    for name in ["traffic", "warehouse"] {
        for agents in [4, 100] {
            global(&mut group, name, &*domain(&format!("{name}_{agents}.toml")));
        }
    }
    group.finish();
}

criterion_group!(benches, simulators);
criterion_main!(benches);
