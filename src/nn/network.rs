//! One network, seen through a row of parameters: forward and backward.

use super::gru::{self, GruTrace};
use super::product::{Before, Matrix, multiply, sum_rows};
use super::shape::{Layout, Shape};

/// One agent's network: a shape over a row of parameters.
#[derive(Clone, Copy)]
pub struct Network<'a> {
    pub(super) shape: &'a Shape,
    pub(super) layout: &'a Layout,
    pub(super) values: &'a [f32],
}

/// Sequences that a network runs over: what [`Network::forward`] needs beside the inputs.
#[derive(Clone, Copy)]
pub struct Sequences<'a> {
    /// Steps of each. Rows of inputs are ordered step, sequence.
    pub steps: usize,
    /// Before the first step: `[sequences, state_width]`.
    pub states: &'a [f32],
    /// One per row of the inputs: an episode begins with this step.
    pub starts: &'a [bool],
}

/// What a forward pass leaves behind for the backward pass, and the room that both work in: one trace serves one pass
/// after another, of any agent, without new memory.
#[derive(Default)]
pub struct Trace {
    gru: GruTrace,
    /// The inputs, then what every layer made of them, ReLU included; the last one is the output.
    values: Vec<Vec<f32>>,
    /// Of the loss by the parameters, after a backward pass.
    gradient: Vec<f32>,
    /// Of the loss by the values of two layers that follow each other.
    by_layer: [Vec<f32>; 2],
}

impl Trace {
    /// `[rows, outputs]`
    pub fn output(&self) -> &[f32] {
        self.values.last().expect("there was a forward pass")
    }

    /// Of the loss by the parameters, as the last backward pass left it.
    pub fn gradient(&self) -> &[f32] {
        &self.gradient
    }

    /// The states after the last `sequences` rows.
    pub(super) fn last_states(&self, length: usize) -> &[f32] {
        &self.gru.outputs[self.gru.outputs.len() - length..]
    }
}

impl Network<'_> {
    /// Width of the hidden state; 0 without a GRU.
    pub fn state_width(self) -> usize {
        self.shape.state_width()
    }

    /// `inputs`: `[steps, sequences, in]`; the trace then holds outputs in the same order. Networks without a GRU take no
    /// notice of the sequences.
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
                // Not `max`, which would hide a value that is no number any more.
                after.iter_mut().for_each(|value| *value = if *value < 0.0 { 0.0 } else { *value });
            }
        }
    }

    /// Leaves the gradient by all parameters in the trace, given the gradient of the loss by the outputs of its forward
    /// pass, `[rows, outputs]`.
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
                // The ReLU let through what is positive after it.
                by_after.iter_mut().zip(before).for_each(|(by, &value)| *by = if value > 0.0 { *by } else { 0.0 });
            }
        }
        if shape.recurrent.is_some() {
            gru::backward(layout, values, &trace.values[0], by_after, &mut trace.gru, gradient);
        }
    }
}

/// The block of the first linear layer's weight.
pub(super) fn first_layer(shape: &Shape) -> usize {
    if shape.recurrent.is_some() { gru::BLOCKS } else { 0 }
}

/// `out = inputs x weight + bias`. `weight`: `[in, out]`; `bias`: `[out]`; `inputs`: `[rows, in]`; `out`: `[rows, out]`.
pub(super) fn affine(inputs: &[f32], weight: &[f32], bias: &[f32], out: &mut [f32]) {
    out.chunks_exact_mut(bias.len()).for_each(|row| row.copy_from_slice(bias));
    multiply(Matrix::new(inputs, weight.len() / bias.len()), Matrix::new(weight, bias.len()), out, Before::Add);
}

/// The buffer with this length; what stands in it is left over from before.
pub(super) fn resized(buffer: &mut Vec<f32>, length: usize) -> &mut [f32] {
    buffer.resize(length, 0.0);
    buffer
}
