//! Stacked networks: the same architecture once per agent, the agent axis first, always.
//!
//! All networks of a worker live in one `[agents, parameters]` block. Nothing couples the agents: a stack of A networks
//! computes what A single networks compute, bit for bit (a test holds it), so results do not depend on how agents are
//! shared out over workers and threads. So the arithmetic goes agent by agent, each while its parameters are in the
//! cache.
//!
//! Gradients are written by hand instead of by autograd, and products are those of the crate `gemm` instead of
//! libtorch's: the networks are small and fixed, their losses have closed-form derivatives, and a graph, tensors and
//! BLAS per minibatch cost more than the arithmetic (measured: docs/performance.md).
//!
//! This room does not know what the numbers mean.

mod activations;
mod adam;
mod few_rows;
mod flops;
mod gru;
mod net;
mod network;
#[cfg(test)]
mod order_of_sums;
mod parameters;
mod product;
mod script;
mod shape;
mod stack_file;
mod states;
mod threads;
mod vectors;

pub use activations::sigmoid;
pub use adam::{Adam, Learner, Moments};
pub use flops::Peak;
pub use net::Net;
pub use network::{Network, Sequences, Trace};
pub use parameters::Parameters;
pub use script::write_script;
pub use shape::{Layout, Shape};
pub use stack_file::{StackToWrite, read_stack, write_stacks};
pub use states::States;
pub use threads::Threads;
pub use vectors::{use_vectors, vector_instructions};
