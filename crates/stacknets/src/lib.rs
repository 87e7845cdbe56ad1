#![doc = include_str!("../README.md")]
//!
//! # How to use it
//!
//! - [`Stack`] has the networks, [`Stack::network`] is one of them. To *apply* all at once, with one or more rows of inputs
//!   each: [`Stack::step`], with [`States`] for networks with a GRU.
//! - To *train*: [`Adam::trainers`] lends each network with its part of the optimiser as a [`Trainer`]. It runs
//!   [`Network::forward`] and [`Network::backward`] over a minibatch, with a [`Trace`] as working memory, and
//!   [`Trainer::descend`]s. Trainers are independent: [`Threads::map`] shares them among threads.
//! - To *save*: [`Parameters::values`] is a plain table, [`Rows`]; [`Layout`] says which weight is where. [`write_stacks`] and
//!   [`read_stack`] make files of it, [`Moments`] is the optimiser's state.
//! - To *measure*: [`Shape::forward_flops`], [`Shape::backward_flops`] and [`peak`] give a lower bound for the time.

#![warn(missing_docs, unreachable_pub)]

// From top to bottom:
// - `stack`: a stack; `network`: one network of it, forward and backward; `gru`: its recurrent part; `sets`: networks over sets; `states`: the hidden
//   states between steps; `adam`: the optimiser; `orthogonal`: weights to begin with.
// - `shape`: layers of a network, and its row of parameters; `rows`: tables; `stack_file`: safetensors.
// - `product`, `few_rows`, `activations`: the arithmetic; `vectors`: the width of its registers; `order_of_sums` (tests):
//   the order in which products of 256 bits add up.
// - `threads`: threads that share the networks. `flops`: the least work and the peak speed, for benchmarks.
mod activations;
mod adam;
mod few_rows;
mod flops;
mod gru;
mod network;
#[cfg(test)]
mod order_of_sums;
mod orthogonal;
mod product;
mod rows;
mod sets;
mod shape;
mod stack;
mod stack_file;
mod states;
#[cfg(test)]
mod testing;
mod threads;
mod vectors;

pub use activations::sigmoid;
pub use adam::{Adam, Moments, Trainer};
pub use flops::{SIDE, fastest_product, peak};
pub use network::{Network, Sequences, Trace};
pub use orthogonal::Gains;
pub use rows::Rows;
pub use sets::Sets;
pub use shape::{Layout, Parameters, Shape};
pub use stack::Stack;
pub use stack_file::{
    LARGEST_PARAMETER, StackToWrite, about_stacks, check_tensors, read_stack, stack_as_bytes, write_stacks,
};
pub use states::States;
pub use threads::Threads;
pub use vectors::{VectorWidth, use_vectors, vector_instructions};
