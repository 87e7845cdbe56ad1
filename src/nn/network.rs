//! One network, seen through a row of parameters: forward and backward.

use super::buffer::resized;
use super::gru::{self, GruTrace};
use super::product::{Before, Matrix, affine, multiply, sum_rows};
use super::shape::{Layout, Shape};

/// One agent's network: a shape over a row of parameters.
#[derive(Clone, Copy)]
pub struct Network<'a> {
    pub(super) shape: &'a Shape,
    pub(super) layout: &'a Layout,
    pub(super) values: &'a [f32],
}

/// The sequences that a network runs over. [`Network::forward`] takes them with the inputs.
#[derive(Clone, Copy)]
pub struct Sequences<'a> {
    /// Number of steps of each sequence. Rows of inputs are ordered by step, then by sequence.
    pub steps: usize,
    /// States before the first step: `[sequences, state_width]`.
    pub states: &'a [f32],
    /// Whether an episode begins with this step, one per row of the inputs.
    pub starts: &'a [bool],
}

/// Results of a forward pass that the backward pass needs, and the memory that both work in.
///
/// One trace serves many passes, of any agent, without new memory.
#[derive(Default)]
pub struct Trace {
    gru: GruTrace,
    /// Inputs, then the values after each layer and its ReLU. The last one is the output.
    values: Vec<Vec<f32>>,
    /// Gradient of the loss by the parameters, after a backward pass.
    gradient: Vec<f32>,
    /// Gradients of the loss by the values of two neighbouring layers.
    by_layer: [Vec<f32>; 2],
}

impl Trace {
    /// Returns the outputs of the last forward pass, `[rows, outputs]`.
    pub fn output(&self) -> &[f32] {
        self.values.last().expect("there was a forward pass")
    }

    /// Returns the gradient of the loss by the parameters, from the last backward pass.
    pub fn gradient(&self) -> &[f32] {
        &self.gradient
    }

    /// Returns the states after the last step, `[sequences, state_width]`; `length`: number of values in them.
    pub(super) fn last_states(&self, length: usize) -> &[f32] {
        &self.gru.outputs[self.gru.outputs.len() - length..]
    }
}

impl Network<'_> {
    /// Returns the width of the hidden state; 0 without a GRU.
    pub fn state_width(self) -> usize {
        self.shape.state_width()
    }

    /// Runs the network over `inputs`, `[steps, sequences, in]`. The trace then holds the outputs in the same order.
    ///
    /// A network without a GRU ignores the sequences.
    pub fn forward(self, inputs: &[f32], sequences: Sequences<'_>, trace: &mut Trace) {
        let Network { shape, layout, values } = self;
        let rows = inputs.len() / shape.inputs;
        trace.values.resize_with(shape.hidden.len() + 2, Vec::new);
        resized(&mut trace.values[0], inputs.len()).copy_from_slice(inputs);
        if shape.recurrent.is_some() {
            let Sequences { steps, states, starts } = sequences;
            gru::forward(layout, values, inputs, steps, states, starts, &mut trace.gru);
        }
        for (layer, (_, outputs)) in shape.layers().enumerate() {
            let block = first_layer(shape) + 2 * layer;
            let (before, after) = trace.values.split_at_mut(layer + 1);
            let before = if layer == 0 && shape.recurrent.is_some() { &trace.gru.outputs } else { &before[layer] };
            let after = resized(&mut after[0], rows * outputs);
            affine(before, &values[layout.range(block)], &values[layout.range(block + 1)], after);
            if layer < shape.hidden.len() {
                // Not `max`, which would hide a NaN.
                after.iter_mut().for_each(|value| *value = if *value < 0.0 { 0.0 } else { *value });
            }
        }
    }

    /// Writes the gradient by all parameters into the trace.
    ///
    /// `by_output`: gradient of the loss by the outputs of the forward pass, `[rows, outputs]`.
    pub fn backward(self, by_output: &[f32], trace: &mut Trace) {
        let Network { shape, layout, values } = self;
        let gradient = resized(&mut trace.gradient, layout.width());
        let rows = by_output.len() / shape.outputs;
        let [by_after, by_before] = &mut trace.by_layer;
        resized(by_after, by_output.len()).copy_from_slice(by_output);
        for (layer, (inputs, outputs)) in shape.layers().enumerate().rev() {
            let block = first_layer(shape) + 2 * layer;
            let recurrent_below = layer == 0 && shape.recurrent.is_some();
            let before = if recurrent_below { &trace.gru.outputs } else { &trace.values[layer] };
            let after = Matrix::new(by_after, outputs);
            multiply(
                Matrix::new(before, inputs).transposed(),
                after,
                &mut gradient[layout.range(block)],
                Before::Overwrite,
            );
            sum_rows(by_after, &mut gradient[layout.range(block + 1)]);
            if layer > 0 || recurrent_below {
                let weight = Matrix::new(&values[layout.range(block)], outputs);
                multiply(after, weight.transposed(), resized(by_before, rows * inputs), Before::Overwrite);
                std::mem::swap(by_after, by_before);
            }
            if layer > 0 {
                // The gradient passes if the ReLU's output is positive.
                by_after.iter_mut().zip(before).for_each(|(by, &value)| *by = if value > 0.0 { *by } else { 0.0 });
            }
        }
        if shape.recurrent.is_some() {
            gru::backward(layout, values, &trace.values[0], by_after, &mut trace.gru, gradient);
        }
    }
}

/// Returns the block of the first linear layer's weight.
pub(super) fn first_layer(shape: &Shape) -> usize {
    if shape.recurrent.is_some() { gru::BLOCKS } else { 0 }
}
