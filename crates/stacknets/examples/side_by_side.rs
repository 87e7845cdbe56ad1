//! A hundred recurrent networks learn to count on two threads. One of them learns again alone: the same bits.
//!
//! `cargo run --release -p stacknets --example side_by_side`

use anyhow::Result;
use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use stacknets::{Adam, Rows, Sequences, Shape, Stack, Threads, Trace, Trainer};

const NETWORKS: u64 = 100;
/// Length of a sequence, and number of sequences in a minibatch.
const STEPS: usize = 8;
const BATCH: usize = 16;
const GRADIENT_STEPS: u32 = 300;

/// Working memory, one per thread.
#[derive(Default)]
struct Scratch {
    trace: Trace,
    errors: Vec<f32>,
}

fn main() -> Result<()> {
    let all: Vec<u64> = (0..NETWORKS).collect();
    let (stack, losses) = train(&all, Threads::new(2)?);
    let mean = losses.iter().sum::<f32>() / losses.len() as f32;
    println!("{NETWORKS} networks of {} parameters: mean squared error {mean:.4}", stack.parameters().width());

    let (alone, _) = train(&[42], Threads::one());
    let same = alone.parameters().values().row(0) == stack.parameters().values().row(42);
    println!("network 42 alone has the same parameters, bit for bit: {same}");
    assert!(same);

    // To apply all of them at once, with one row of inputs each, step by step.
    let mut states = stack.states(all.len());
    for bit in [1.0, 0.0, 1.0, 1.0] {
        let outputs = stack.step(&Rows::from_vec(vec![bit; all.len()], 1), &mut states);
        println!("sees {bit}; networks 0 to 2 count {:.2?}", &outputs.as_slice()[..3]);
    }
    Ok(())
}

/// Trains the networks with these seeds. Returns them, and the last loss of each.
fn train(seeds: &[u64], threads: Threads) -> (Stack, Vec<f32>) {
    let shape = Shape { inputs: 1, recurrent: Some(16), hidden: vec![16], outputs: 1, apart: 0, sets: None };
    let dice = |&seed: &u64| Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut stack = Stack::new(shape, seeds.iter().map(dice));
    let mut adam = Adam::new(stack.parameters());
    let trainers = adam.trainers(&mut stack, GRADIENT_STEPS).into_iter().zip(seeds).collect();
    let losses = threads.map(trainers, 2, |scratch, (trainer, &seed)| learn(trainer, seed, scratch));
    (stack, losses)
}

/// Makes all gradient steps of one network. Returns the last loss.
fn learn(mut trainer: Trainer<'_>, seed: u64, Scratch { trace, errors }: &mut Scratch) -> f32 {
    let mut dice = Xoshiro256PlusPlus::seed_from_u64(seed + NETWORKS);
    let (states, starts) = (vec![0.0; BATCH * trainer.network().state_width()], [false; STEPS * BATCH]);
    for _ in 0..GRADIENT_STEPS {
        // `[STEPS x BATCH, 1]`: random bits. To be learnt: the number of ones in the sequence so far.
        let bits: Vec<f32> = (0..STEPS * BATCH).map(|_| f32::from(u8::from(dice.random_bool(0.5)))).collect();
        let count = |row: usize| bits[row % BATCH..=row].iter().step_by(BATCH).sum::<f32>();
        trainer.network().forward(&bits, Sequences { steps: STEPS, states: &states, starts: &starts }, trace);
        // The loss is the mean of half the squared errors.
        let rows = trace.output().iter().enumerate();
        errors.clear();
        errors.extend(rows.map(|(row, output)| (output - count(row)) / (STEPS * BATCH) as f32));
        trainer.network().backward(errors, trace);
        trace.shorten_gradient(1.0);
        trainer.descend(trace.gradient(), 0.01);
    }
    errors.iter().map(|error| error * error).sum::<f32>() * (STEPS * BATCH) as f32
}
