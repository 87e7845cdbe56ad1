//! Stacked networks: one network of the same architecture per agent.
//!
//! All networks of a stack are one `[agents, parameters]` block; the agent axis always comes first. Nothing couples the
//! agents: a stack of A networks computes what A single networks compute, bit for bit (a test holds it). So results do
//! not depend on how agents are shared among workers and threads. The arithmetic goes agent by agent, while the agent's
//! parameters are in the cache.
//!
//! Gradients are written by hand, without autograd, and products come from the crate `gemm`, not from libtorch. The
//! networks are small, and their losses have closed-form derivatives. A graph, tensors and BLAS calls per minibatch
//! would cost more than the arithmetic itself (measured: docs/performance.md).
//!
//! Nothing here knows what the numbers mean.
//!
//! - `rows`: the table of numbers that goes in and comes out.
//! - `shape`, `parameters`: layers of a network, and its row of parameters; `stack_file`: as a safetensors file.
//! - `net`: a stack; `network`: one network of it, forward and backward; `gru`: its recurrent part; `states`:
//!   the hidden states between steps.
//! - `adam`: the optimiser.
//! - `product`, `few_rows`, `activations`, `buffer`: the arithmetic; `vectors`: the width of its registers;
//!   `order_of_sums` (tests): the order in which products of 256 bits add up.
//! - `threads`: threads that share the agents.
//! - `flops`: amount of arithmetic, for benchmarks; `peak`: how fast products are at their best; `yardstick`: how fast
//!   libtorch's are.
//! - `script`: TorchScript export; `no_script` replaces it in builds without libtorch.

mod activations;
mod adam;
mod buffer;
mod few_rows;
mod flops;
mod gru;
mod net;
mod network;
#[cfg(test)]
mod order_of_sums;
mod parameters;
mod peak;
mod product;
mod rows;
#[cfg_attr(not(feature = "torch"), path = "no_script.rs")]
mod script;
mod shape;
mod stack_file;
mod states;
#[cfg(test)]
mod testing;
mod threads;
mod vectors;
#[cfg(feature = "torch")]
mod yardstick;

pub use activations::sigmoid;
pub use adam::{Adam, Learner, Moments};
pub use net::Net;
pub use network::{Network, Sequences, Trace};
pub use parameters::Parameters;
pub use peak::Peak;
pub use rows::Rows;
pub use script::{check_script, script};
pub use shape::{Layout, Shape};
pub use stack_file::{StackToWrite, about_stacks, read_stack, write_stacks};
pub use states::States;
pub use threads::Threads;
pub use vectors::{VectorWidth, use_vectors, vector_instructions};
