//! The gated recurrent unit over sequences, stacked over agents, with its gradient by hand.
//!
//! As torch's `GRU` (Cho et al. 2014), with `*` for the elementwise product:
//!
//! ```text
//! r = s(Wxr x + bxr + Whr h + bhr)        z = s(Wxz x + bxz + Whz h + bhz)
//! n = tanh(Wxn x + bxn + r * (Whn h + bhn))        h' = (1 - z) * n + z * h
//! ```
//!
//! The input half of all steps is one matrix product, and so are the gradients of all weights: only the products with
//! the state stand inside the loop over time. Rows are ordered agent, step, sequence, so that a step is a view.

use multiversion::multiversion;
use tch::{Device, Kind, Tensor};

use super::Parameters;
use super::activations::{sigmoid, tanh};
use super::convert::{tensor_to_slice, tensor_to_slice_mut};
use super::product::{affine, backwards};
use super::states::States;

/// The first blocks of the parameters of a network with a GRU: `[in, 3 hidden]`, `[hidden, 3 hidden]` and twice
/// `[1, 3 hidden]`, each in the order r, z, n.
pub const INPUT: usize = 0;
pub const STATE: usize = 1;
pub const INPUT_BIAS: usize = 2;
pub const STATE_BIAS: usize = 3;
pub const BLOCKS: usize = 4;

/// What the backward pass needs of a forward pass.
pub struct GruTrace {
    shape: SequenceShape,
    /// `[agents, steps x batch, in]`
    inputs: Tensor,
    /// The state before each step, cleared where an episode begins: `[agents, steps x batch, hidden]`.
    before: Tensor,
    /// r, z, n and `Whn h + bhn` of each row, `4 hidden` each.
    gates: Vec<f32>,
    /// The state after each step: `[agents, steps x batch, hidden]`.
    pub outputs: Tensor,
    starts: Vec<bool>,
}

/// How many sequences of how many steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SequenceShape {
    pub agents: usize,
    pub steps: usize,
    /// Sequences per agent.
    pub batch: usize,
}

impl SequenceShape {
    fn row(self, agent: usize, step: usize, sequence: usize) -> usize {
        (agent * self.steps + step) * self.batch + sequence
    }

    fn sequences(self) -> impl Iterator<Item = (usize, usize)> {
        (0..self.agents).flat_map(move |agent| (0..self.batch).map(move |sequence| (agent, sequence)))
    }
}

fn zeros(shape: SequenceShape, rows: usize, width: usize) -> Tensor {
    Tensor::zeros(&[shape.agents as i64, rows as i64, width as i64], (Kind::Float, Device::Cpu))
}

/// One step of all sequences as a view.
fn at_step(table: &Tensor, shape: SequenceShape, step: usize) -> Tensor {
    table.narrow(1, (step * shape.batch) as i64, shape.batch as i64)
}

/// Runs the units over sequences.
///
/// `inputs`: `[agents, steps x batch, in]`; `states`: one row per (agent, sequence), before the first step; `starts`: one
/// per row of `inputs`, whether an episode begins with this step.
pub fn forward(
    parameters: &Parameters,
    inputs: Tensor,
    shape: SequenceShape,
    states: &States,
    starts: &[bool],
) -> GruTrace {
    let hidden = parameters.block_range(STATE_BIAS).len() / 3;
    let rows = shape.steps * shape.batch;
    let from_inputs = affine(parameters, &inputs, INPUT, INPUT_BIAS); // [agents, steps x batch, 3 hidden]
    let (mut before, mut outputs) = (zeros(shape, rows, hidden), zeros(shape, rows, hidden));
    let mut gates = vec![0.0; shape.agents * rows * 4 * hidden];
    for step in 0..shape.steps {
        {
            let (before, outputs) = (tensor_to_slice_mut(&mut before), tensor_to_slice(&outputs));
            for (agent, sequence) in shape.sequences() {
                let row = shape.row(agent, step, sequence);
                if starts[row] {
                    continue; // it is zero already
                }
                let state = if step == 0 {
                    states.row(agent * shape.batch + sequence)
                } else {
                    let last = shape.row(agent, step - 1, sequence);
                    &outputs[last * hidden..(last + 1) * hidden]
                };
                before[row * hidden..(row + 1) * hidden].copy_from_slice(state);
            }
        }
        // [agents, batch, 3 hidden]
        let from_state = affine(parameters, &at_step(&before, shape, step), STATE, STATE_BIAS);
        let (from_inputs, from_state) = (tensor_to_slice(&from_inputs), tensor_to_slice(&from_state));
        let (before, outputs) = (tensor_to_slice(&before), tensor_to_slice_mut(&mut outputs));
        for (index, (agent, sequence)) in shape.sequences().enumerate() {
            let row = shape.row(agent, step, sequence);
            update_row(
                &from_inputs[row * 3 * hidden..(row + 1) * 3 * hidden],
                &from_state[index * 3 * hidden..(index + 1) * 3 * hidden],
                &before[row * hidden..(row + 1) * hidden],
                &mut gates[row * 4 * hidden..(row + 1) * 4 * hidden],
                &mut outputs[row * hidden..(row + 1) * hidden],
            );
        }
    }
    GruTrace { shape, inputs, before, gates, outputs, starts: starts.to_vec() }
}

/// One row of one step, with the widest registers that the machine has.
#[multiversion(targets("x86_64+avx2"))]
fn update_row(from_input: &[f32], from_state: &[f32], before: &[f32], gates: &mut [f32], after: &mut [f32]) {
    let hidden = before.len();
    let (xr, xz, xn) = thirds(from_input, hidden);
    let (hr, hz, hn) = thirds(from_state, hidden);
    let (r, rest) = gates.split_at_mut(hidden);
    let (z, rest) = rest.split_at_mut(hidden);
    let (n, kept) = rest.split_at_mut(hidden);
    for i in 0..hidden {
        r[i] = sigmoid(xr[i] + hr[i]);
        z[i] = sigmoid(xz[i] + hz[i]);
        n[i] = tanh(xn[i] + r[i] * hn[i]);
        kept[i] = hn[i];
        after[i] = n[i] + z[i] * (before[i] - n[i]);
    }
}

fn thirds(row: &[f32], hidden: usize) -> (&[f32], &[f32], &[f32]) {
    (&row[..hidden], &row[hidden..2 * hidden], &row[2 * hidden..3 * hidden])
}

/// Writes the gradients of all weights. `output_gradient`: of the loss by [`GruTrace::outputs`], same shape.
///
/// Nothing flows from a step into the one before it where an episode begins between them, nor into the first states.
pub fn backward(parameters: &mut Parameters, trace: &GruTrace, output_gradient: &Tensor) {
    let shape = trace.shape;
    let hidden = parameters.block_range(STATE_BIAS).len() / 3;
    let rows = shape.steps * shape.batch;
    let mut by_input = zeros(shape, rows, 3 * hidden);
    let mut by_state = zeros(shape, rows, 3 * hidden);
    // Of the loss by the state after the step: `[agents x batch, hidden]`.
    let mut carried = vec![0.0; shape.agents * shape.batch * hidden];
    let (outside, before) = (tensor_to_slice(output_gradient), tensor_to_slice(&trace.before));
    for step in (0..shape.steps).rev() {
        {
            let by_input = tensor_to_slice_mut(&mut by_input);
            let by_state = tensor_to_slice_mut(&mut by_state);
            for (index, (agent, sequence)) in shape.sequences().enumerate() {
                let row = shape.row(agent, step, sequence);
                differentiate_row(
                    &outside[row * hidden..(row + 1) * hidden],
                    &trace.gates[row * 4 * hidden..(row + 1) * 4 * hidden],
                    &before[row * hidden..(row + 1) * hidden],
                    &mut carried[index * hidden..(index + 1) * hidden],
                    &mut by_input[row * 3 * hidden..(row + 1) * 3 * hidden],
                    &mut by_state[row * 3 * hidden..(row + 1) * 3 * hidden],
                );
            }
        }
        if step > 0 {
            let through_weights = backwards(parameters, &at_step(&by_state, shape, step), STATE); // [agents, batch, hidden]
            let through_weights = tensor_to_slice(&through_weights);
            for (index, (agent, sequence)) in shape.sequences().enumerate() {
                let carried = &mut carried[index * hidden..(index + 1) * hidden];
                if trace.starts[shape.row(agent, step, sequence)] {
                    carried.fill(0.0);
                } else {
                    let more = &through_weights[index * hidden..(index + 1) * hidden];
                    carried.iter_mut().zip(more).for_each(|(carried, more)| *carried += more);
                }
            }
        }
    }
    let _ = trace.inputs.transpose(1, 2).bmm_out(&parameters.gradient_view(INPUT), &by_input);
    let _ = trace.before.transpose(1, 2).bmm_out(&parameters.gradient_view(STATE), &by_state);
    for (bias, gradient) in [(INPUT_BIAS, &by_input), (STATE_BIAS, &by_state)] {
        let bias = parameters.gradient_view(bias);
        let _ = gradient.sum_intlist_out(&bias, Some([1_i64].as_slice()), true, Kind::Float);
    }
}

/// Of one row: `carried` holds the gradient by the state after the step that comes from later steps, and afterwards the
/// direct part of that by the state before it.
#[multiversion(targets("x86_64+avx2"))]
fn differentiate_row(
    outside: &[f32],
    gates: &[f32],
    before: &[f32],
    carried: &mut [f32],
    by_input: &mut [f32],
    by_state: &mut [f32],
) {
    let hidden = before.len();
    let (r, rest) = gates.split_at(hidden);
    let (z, rest) = rest.split_at(hidden);
    let (n, hn) = rest.split_at(hidden);
    let (input_r, rest) = by_input.split_at_mut(hidden);
    let (input_z, input_n) = rest.split_at_mut(hidden);
    let (state_r, rest) = by_state.split_at_mut(hidden);
    let (state_z, state_n) = rest.split_at_mut(hidden);
    for i in 0..hidden {
        let after = outside[i] + carried[i];
        let dn = after * (1.0 - z[i]) * (1.0 - n[i] * n[i]);
        let dz = after * (before[i] - n[i]) * z[i] * (1.0 - z[i]);
        let dr = dn * hn[i] * r[i] * (1.0 - r[i]);
        (input_r[i], input_z[i], input_n[i]) = (dr, dz, dn);
        (state_r[i], state_z[i], state_n[i]) = (dr, dz, dn * r[i]);
        carried[i] = after * z[i];
    }
}
