//! Many equal small neural networks side by side, trained one by one and bit for bit as if each were alone.
//!
//! Some methods train hundreds of small networks at once: one per agent, per member of an ensemble, per seed, per sensor.
//! A tensor library is made for one large network. It pays a graph, tensors and library calls for every minibatch of every
//! small one, and its results depend on what else is in the batch. This crate holds N networks of the same shape in one
//! block of memory, `[networks, parameters]`. It computes them network by network, while the network's parameters are in
//! the cache.
//!
//! - **Nothing couples the networks.** A stack of N networks computes what N stacks of one compute, *bit for bit*, with any
//!   number of threads, in any number of processes (tests hold it).
//! - **One shape, much used**: inputs -> GRU, if wanted -> hidden layers with ReLU -> linear outputs, in one tower or two
//!   ([`Shape`]). `f32`, on CPUs.
//! - **Gradients by hand.** The loss is yours: you give its gradient by the outputs, and get that by all parameters. There
//!   is no graph and no autograd.
//! - **Adam** for each network on its own, in one pass over memory.
//! - **Files** that Python reads: safetensors, and TorchScript with the feature `torch`.
//!
//! # Example
//!
//! Three networks learn XOR, each with its own random parameters:
//!
//! ```
//! use rand::SeedableRng;
//! use rand_xoshiro::Xoshiro256PlusPlus;
//! use stacknets::{Adam, Sequences, Shape, Stack, Trace};
//!
//! let shape = Shape { inputs: 2, recurrent: None, hidden: vec![16], outputs: 1, apart: 0 };
//! let mut stack = Stack::new(shape, (0..3).map(Xoshiro256PlusPlus::seed_from_u64));
//! let mut adam = Adam::new(stack.parameters());
//! let (inputs, wanted) = ([0., 0., 0., 1., 1., 0., 1., 1.], [0., 1., 1., 0.]); // [4, 2] and [4, 1]
//!
//! let mut trace = Trace::default();
//! for mut learner in adam.learners(&mut stack, 500) {
//!     for _ in 0..500 {
//!         learner.network().forward(&inputs, Sequences::NONE, &mut trace);
//!         // The loss is half the sum of the squared errors. Its gradient by an output is the error.
//!         let errors: Vec<f32> = trace.output().iter().zip(wanted).map(|(output, wanted)| output - wanted).collect();
//!         learner.network().backward(&errors, &mut trace);
//!         learner.descend(trace.gradient(), 0.01);
//!     }
//! }
//!
//! for number in 0..3 {
//!     stack.network(number).forward(&inputs, Sequences::NONE, &mut trace);
//!     assert!(trace.output().iter().zip(wanted).all(|(output, wanted)| (output - wanted).abs() < 0.05));
//! }
//! ```
//!
//! `examples/side_by_side.rs` trains a hundred networks with a GRU on several threads, and compares one of them with the
//! same network alone.
//!
//! # How to use it
//!
//! - [`Stack`] has the networks, [`Stack::network`] is one of them. To *apply* all at once, with one or more rows of inputs
//!   each: [`Stack::step`], with [`States`] for networks with a GRU.
//! - To *train*: [`Adam::learners`] lends each network with its part of the optimiser as a [`Learner`]. It runs
//!   [`Network::forward`] and [`Network::backward`] over a minibatch, with a [`Trace`] as working memory, and
//!   [`Learner::descend`]s. Learners are independent: [`Threads::map`] shares them among threads.
//! - To *save*: [`Parameters::values`] is a plain table, [`Rows`]; [`Layout`] says which weight is where. [`write_stacks`] and
//!   [`read_stack`] make files of it, [`Moments`] is the optimiser's state.
//! - To *measure*: [`Shape::forward_flops`], [`Shape::backward_flops`] and [`peak`] give a lower bound for the time.
//!
//! # Shapes
//!
//! All tables are row-major, and where there is an axis of networks it comes first. Inputs of sequences are
//! `[steps x sequences, inputs]`: a step's rows are neighbours.
//!
//! # Which bits are the same
//!
//! The same program with the same inputs gives the same bits on every x86-64 machine with AVX2 and FMA after
//! [`use_vectors`]`(`[`VectorWidth::Bits256`]`)`. By default products use the widest registers that the machine has, and
//! machines agree if [`vector_instructions`] agree. A product's bits depend on its shape: a network that gets 32 rows at
//! once can differ in the last bit from one that gets them one by one. They never depend on the other networks.
//!
//! # Errors
//!
//! Lengths that do not fit are mistakes of the caller, and panic with both of them. Files, threads and missing instructions
//! are [`anyhow`] errors that name the file or the cause.

#![warn(missing_docs, unreachable_pub)]

// From top to bottom:
// - `stack`: a stack; `network`: one network of it, forward and backward; `gru`: its recurrent part; `states`: the hidden
//   states between steps; `adam`: the optimiser.
// - `shape`, `parameters`: layers of a network, and its row of parameters; `rows`: tables; `stack_file`: safetensors.
// - `product`, `few_rows`, `activations`, `buffer`: the arithmetic; `vectors`: the width of its registers;
//   `order_of_sums` (tests): the order in which products of 256 bits add up.
// - `threads`: threads that share the networks.
// - `flops`, `peak`: for benchmarks.
mod activations;
mod adam;
mod buffer;
mod few_rows;
mod flops;
mod gru;
mod network;
#[cfg(test)]
mod order_of_sums;
mod parameters;
mod peak;
mod product;
mod rows;
mod shape;
mod stack;
mod stack_file;
mod states;
#[cfg(test)]
mod testing;
mod threads;
mod vectors;

pub use activations::sigmoid;
pub use adam::{Adam, Learner, Moments};
pub use flops::{SIDE, fastest_product};
pub use network::{Network, Sequences, Trace};
pub use parameters::Parameters;
pub use peak::peak;
pub use rows::Rows;
pub use shape::{Layout, Shape};
pub use stack::Stack;
pub use stack_file::{StackToWrite, about_stacks, read_stack, stack_as_bytes, write_stacks};
pub use states::States;
pub use threads::Threads;
pub use vectors::{VectorWidth, use_vectors, vector_instructions};

/// The README's example is tested, too.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
