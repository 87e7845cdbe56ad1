//! Stacked networks: the same architecture once per agent, the agent axis first, always.
//!
//! All networks of a worker live in one `[agents, parameters]` block, and one batched matrix product serves all agents
//! of it. Nothing couples the agents: a stack of A networks computes what A single networks compute, bit for bit (a
//! test holds it), so results do not depend on how agents are shared out over workers.
//!
//! Gradients are written by hand instead of by autograd: the networks are small and fixed, their losses have
//! closed-form derivatives, and a graph per minibatch costs more than the arithmetic of four agents. libtorch does the
//! matrix products.
//!
//! This room knows tensors; it does not know what the numbers mean.

mod activations;
mod adam;
mod convert;
mod gru;
mod net;
mod parameters;
mod product;
mod script;
mod stack_file;
mod states;

pub use activations::sigmoid;
pub use adam::{Adam, Moments};
pub use convert::{rows_to_tensor, tensor_to_slice};
pub use net::{Net, Sequences, Shape, Trace};
pub use parameters::{Layout, Parameters};
pub use script::write_script;
pub use stack_file::{read_stack, write_stack};
pub use states::States;
