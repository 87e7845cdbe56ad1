//! The gated recurrent unit over sequences, with its gradient by hand.
//!
//! The same unit as torch's `GRU` (Cho et al. 2014). `*` is the elementwise product, `s` the sigmoid:
//!
//! ```text
//! r = s(Wxr x + bxr + Whr h + bhr)        z = s(Wxz x + bxz + Whz h + bhz)
//! n = tanh(Wxn x + bxn + r * (Whn h + bhn))        h' = (1 - z) * n + z * h
//! ```
//!
//! The input half of all steps is one matrix product, and so is each weight's gradient. Only the products with the
//! state are inside the loop over time. Rows are ordered by step, then by sequence, so that a step is contiguous.

use multiversion::multiversion;

use super::activations::{sigmoid, tanh};
use super::network::Sequences;
use super::product::{Before, Matrix, affine, multiply, resized, sum_rows};
use super::shape::Block;

/// The first blocks of the parameters of a network with a GRU: `[in, 3 hidden]`, `[hidden, 3 hidden]` and twice
/// `[1, 3 hidden]`, each in the order r, z, n.
pub(crate) const INPUT: usize = 0;
pub(crate) const STATE: usize = 1;
pub(crate) const INPUT_BIAS: usize = 2;
pub(crate) const STATE_BIAS: usize = 3;
pub(crate) const BLOCKS: usize = 4;

/// Results of a forward pass that the backward pass needs, and the memory that both work in.
#[derive(Default)]
pub(crate) struct GruTrace {
    /// State before each row, zero if it is cleared there: `[steps x sequences, hidden]`.
    before: Vec<f32>,
    /// Gates r, z, n and `Whn h + bhn` of each row: `[rows, 4 hidden]`.
    gates: Vec<f32>,
    /// State after each row: `[steps x sequences, hidden]`.
    pub(crate) outputs: Vec<f32>,
    starts: Vec<bool>,
    steps: usize,
    /// Input half of the gates, `[steps x sequences, 3 hidden]`, and state half, `[sequences, 3 hidden]`.
    from_inputs: Vec<f32>,
    from_state: Vec<f32>,
    /// Gradients of the loss by the input half and the state half of the gates: `[rows, 3 hidden]` each.
    by_input: Vec<f32>,
    by_state: Vec<f32>,
    /// Gradient of the loss by the state after a step: `[sequences, hidden]`.
    carried: Vec<f32>,
    through_weights: Vec<f32>,
}

/// Runs the unit over `sequences`. `inputs`: `[steps x sequences, in]`.
pub(crate) fn forward(
    blocks: &[Block],
    values: &[f32],
    inputs: &[f32],
    sequences: Sequences<'_>,
    trace: &mut GruTrace,
) {
    let Sequences { steps, states, starts } = sequences;
    let [input, state, input_bias, state_bias] =
        [INPUT, STATE, INPUT_BIAS, STATE_BIAS].map(|block| &values[blocks[block].place.clone()]);
    let hidden = state_bias.len() / 3;
    let (rows, sequences) = (starts.len(), starts.len() / steps);
    trace.steps = steps;
    trace.starts.clear();
    trace.starts.extend_from_slice(starts);
    let outputs = resized(&mut trace.outputs, rows * hidden);
    let before = resized(&mut trace.before, rows * hidden);
    let gates = resized(&mut trace.gates, rows * 4 * hidden);
    let from_inputs = resized(&mut trace.from_inputs, rows * 3 * hidden);
    let from_state = resized(&mut trace.from_state, sequences * 3 * hidden);
    affine(inputs, input, input_bias, from_inputs);
    for step in 0..steps {
        let first = step * sequences;
        let (earlier, now) = outputs.split_at_mut(first * hidden);
        let last = if step == 0 { states } else { &earlier[(first - sequences) * hidden..] };
        let before = &mut before[first * hidden..][..sequences * hidden];
        let pairs = before.chunks_exact_mut(hidden).zip(last.chunks_exact(hidden));
        for ((before, last), &start) in pairs.zip(&starts[first..]) {
            if start { before.fill(0.0) } else { before.copy_from_slice(last) }
        }
        affine(before, state, state_bias, from_state);
        for sequence in 0..sequences {
            let row = first + sequence;
            update_row(
                &from_inputs[row * 3 * hidden..][..3 * hidden],
                &from_state[sequence * 3 * hidden..][..3 * hidden],
                &before[sequence * hidden..][..hidden],
                &mut gates[row * 4 * hidden..][..4 * hidden],
                &mut now[sequence * hidden..][..hidden],
            );
        }
    }
}

/// Updates one row of one step. Compiled for several register widths; the widest that the machine has is used.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
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

/// Writes the gradients of all weights into `gradient`, a row of parameters.
///
/// `inputs`: those of the forward pass; `by_outputs`: gradient of the loss by [`GruTrace::outputs`], same shape.
///
/// No gradient flows back over a step that begins with a cleared state, nor into the first states.
pub(crate) fn backward(
    blocks: &[Block],
    values: &[f32],
    inputs: &[f32],
    by_outputs: &[f32],
    trace: &mut GruTrace,
    gradient: &mut [f32],
) {
    let hidden = blocks[STATE_BIAS].place.len() / 3;
    let (rows, steps) = (trace.starts.len(), trace.steps);
    let sequences = rows / steps;
    let by_input = resized(&mut trace.by_input, rows * 3 * hidden);
    let by_state = resized(&mut trace.by_state, rows * 3 * hidden);
    let carried = resized(&mut trace.carried, sequences * hidden);
    let through_weights = resized(&mut trace.through_weights, sequences * hidden);
    carried.fill(0.0);
    let state_weight = Matrix::new(&values[blocks[STATE].place.clone()], 3 * hidden);
    for step in (0..steps).rev() {
        let first = step * sequences;
        for sequence in 0..sequences {
            let row = first + sequence;
            differentiate_row(
                &by_outputs[row * hidden..][..hidden],
                &trace.gates[row * 4 * hidden..][..4 * hidden],
                &trace.before[row * hidden..][..hidden],
                &mut carried[sequence * hidden..][..hidden],
                &mut by_input[row * 3 * hidden..][..3 * hidden],
                &mut by_state[row * 3 * hidden..][..3 * hidden],
            );
        }
        if step > 0 {
            let by_state = &by_state[first * 3 * hidden..][..sequences * 3 * hidden];
            multiply(Matrix::new(by_state, 3 * hidden), state_weight.transposed(), through_weights, Before::Overwrite);
            let pairs = carried.chunks_exact_mut(hidden).zip(through_weights.chunks_exact(hidden));
            for ((carried, more), &start) in pairs.zip(&trace.starts[first..]) {
                if start {
                    carried.fill(0.0);
                } else {
                    carried.iter_mut().zip(more).for_each(|(carried, more)| *carried += more);
                }
            }
        }
    }
    let width = inputs.len() / rows;
    for (weight, bias, from, width, by) in
        [(INPUT, INPUT_BIAS, inputs, width, &*by_input), (STATE, STATE_BIAS, &*trace.before, hidden, &*by_state)]
    {
        let product = &mut gradient[blocks[weight].place.clone()];
        multiply(Matrix::new(from, width).transposed(), Matrix::new(by, 3 * hidden), product, Before::Overwrite);
        sum_rows(by, &mut gradient[blocks[bias].place.clone()]);
    }
}

/// Computes the gradients of one row. `carried` holds the gradient by the state after the step that comes from later
/// steps. Afterwards it holds the direct part of the gradient by the state before the step.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
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
