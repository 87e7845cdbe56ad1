//! One network, seen through a row of parameters: forward and backward.

use super::gru::{self, GruTrace};
use super::product::{Before, Matrix, affine, multiply, resized, sum_rows};
use super::sets::{OverSets, SetsTrace};
use super::shape::{Block, Layout, Shape};

/// One network of a stack: a shape over a row of parameters.
#[derive(Clone, Copy)]
pub struct Network<'a> {
    pub(crate) shape: &'a Shape,
    pub(crate) layout: &'a Layout,
    pub(crate) values: &'a [f32],
}

/// The sequences that a network with a GRU runs over. [`Network::forward`] takes them with the inputs.
#[derive(Clone, Copy)]
pub struct Sequences<'a> {
    /// Number of steps of each sequence. Rows of inputs are ordered by step, then by sequence.
    pub steps: usize,
    /// States before the first step: `[sequences, state_width]`.
    pub states: &'a [f32],
    /// Whether the state is cleared before this step, because something new begins: `[steps x sequences]`. No gradient
    /// flows back over such a beginning.
    pub starts: &'a [bool],
}

impl Sequences<'static> {
    /// The sequences of a network without a GRU, which has no state between rows.
    pub const NONE: Self = Sequences { steps: 1, states: &[], starts: &[] };
}

/// Results of a forward pass that the backward pass needs, and the memory that both work in.
///
/// One trace serves many passes, of any network, without new memory. Make it by `Trace::default()`.
#[derive(Default)]
pub struct Trace {
    towers: [TowerTrace; 2],
    /// Outputs and last states of two towers side by side. One tower has its own.
    side_by_side: Option<SideBySide>,
    /// The trace of a network over sets.
    over_sets: Option<SetsTrace>,
    /// Gradient of the loss by the parameters, after a backward pass.
    gradient: Vec<f32>,
}

/// The trace of one tower.
#[derive(Default)]
struct TowerTrace {
    gru: GruTrace,
    /// Inputs, then the values after each layer and its ReLU. The last one is the output.
    values: Vec<Vec<f32>>,
    /// Gradients of the loss by the values of two neighbouring layers.
    by_layer: [Vec<f32>; 2],
}

#[derive(Default)]
struct SideBySide {
    outputs: Vec<f32>,
    states: Vec<f32>,
}

impl Trace {
    /// Returns the outputs of the last forward pass, `[rows, outputs]`.
    pub fn output(&self) -> &[f32] {
        match (&self.over_sets, &self.side_by_side) {
            (Some(trace), _) => trace.outputs(),
            (None, Some(both)) => &both.outputs,
            (None, None) => self.towers[0].output(),
        }
    }

    /// Returns the gradient of the loss by the parameters, `[parameters]`, from the last backward pass.
    pub fn gradient(&self) -> &[f32] {
        &self.gradient
    }

    /// Returns the same gradient, for writing.
    pub fn gradient_mut(&mut self) -> &mut [f32] {
        &mut self.gradient
    }

    /// Shortens the same gradient to this Euclidean norm if it is longer.
    ///
    /// Like torch's `clip_grad_norm_`, but the norm is not made a little larger first (by 1e-6). The sum has one order on
    /// all machines.
    pub fn shorten_gradient(&mut self, most: f64) {
        let norm = self.gradient.iter().map(|&slope| f64::from(slope).powi(2)).sum::<f64>().sqrt();
        if norm > most {
            let factor = (most / norm) as f32;
            self.gradient.iter_mut().for_each(|slope| *slope *= factor);
        }
    }

    /// Returns the states after the last step, `[sequences, state_width]`; `length`: number of values in them.
    pub(crate) fn last_states(&self, length: usize) -> &[f32] {
        match &self.side_by_side {
            _ if length == 0 => &[],
            Some(both) => &both.states,
            None => self.towers[0].last_states(length),
        }
    }
}

impl TowerTrace {
    fn output(&self) -> &[f32] {
        self.values.last().expect("there was a forward pass")
    }

    fn last_states(&self, length: usize) -> &[f32] {
        &self.gru.outputs[self.gru.outputs.len() - length..]
    }
}

impl Network<'_> {
    /// Returns the width of the hidden state; 0 without a GRU.
    pub fn state_width(self) -> usize {
        self.shape.state_width()
    }

    /// Runs the network over `inputs`, `[steps x sequences, inputs]`. The trace then holds the outputs in the same order.
    ///
    /// A network without a GRU ignores the sequences: `inputs` are any number of rows, and [`Sequences::NONE`] will do.
    ///
    /// # Panics
    /// If the lengths do not fit each other and the network.
    pub fn forward(self, inputs: &[f32], sequences: Sequences<'_>, trace: &mut Trace) {
        if let Some(network) = self.over_sets() {
            return network.forward(inputs, trace.over_sets.get_or_insert_default());
        }
        trace.over_sets = None;
        if self.shape.apart == 0 {
            trace.side_by_side = None;
            self.tower(self.shape, 0).forward(inputs, sequences, &mut trace.towers[0]);
            return;
        }
        let shapes = self.shape.towers();
        let width = self.state_width();
        let SideBySide { outputs, states } = trace.side_by_side.get_or_insert_default();
        resized(outputs, inputs.len() / self.shape.inputs * self.shape.outputs);
        resized(states, sequences.states.len());
        let (mut first_output, mut first_state) = (0, 0);
        for (index, (shape, trace)) in shapes.iter().zip(&mut trace.towers).enumerate() {
            let own = shape.state_width();
            let states_before = columns(sequences.states, width, first_state, own);
            let sequences = Sequences { states: &states_before, ..sequences };
            self.tower(shape, index).forward(inputs, sequences, trace);
            put_columns(trace.output(), shape.outputs, outputs, self.shape.outputs, first_output);
            if own > 0 {
                put_columns(trace.last_states(states_before.len()), own, states, width, first_state);
            }
            first_output += shape.outputs;
            first_state += own;
        }
    }

    /// Writes the gradient of the loss by all parameters into the trace, summed over the rows.
    ///
    /// `by_output`: gradient of the loss by the outputs of the last forward pass of this trace, `[rows, outputs]`. It is
    /// the caller's to compute: no loss is built in.
    ///
    /// # Panics
    /// If its length is another one than that of the outputs.
    pub fn backward(self, by_output: &[f32], trace: &mut Trace) {
        let gradient = resized(&mut trace.gradient, self.layout.width());
        if let (Some(network), Some(trace)) = (self.over_sets(), &mut trace.over_sets) {
            return network.backward(by_output, trace, gradient);
        }
        if self.shape.apart == 0 {
            self.tower(self.shape, 0).backward(by_output, &mut trace.towers[0], gradient);
            return;
        }
        let mut first = 0;
        for (index, (shape, trace)) in self.shape.towers().iter().zip(&mut trace.towers).enumerate() {
            let by_output = columns(by_output, self.shape.outputs, first, shape.outputs);
            self.tower(shape, index).backward(&by_output, trace, gradient);
            first += shape.outputs;
        }
    }
}

/// Returns `count` neighbouring columns of a table of `width` columns.
fn columns(table: &[f32], width: usize, first: usize, count: usize) -> Vec<f32> {
    if count == 0 {
        return Vec::new();
    }
    table.chunks_exact(width).flat_map(|row| &row[first..first + count]).copied().collect()
}

/// Writes all columns of a table into neighbouring columns of a wider one.
fn put_columns(table: &[f32], count: usize, into: &mut [f32], width: usize, first: usize) {
    let rows = into.chunks_exact_mut(width).zip(table.chunks_exact(count));
    rows.for_each(|(into, row)| into[first..first + count].copy_from_slice(row));
}

/// One tower of a network: a shape without outputs apart, over its blocks in the network's row.
#[derive(Clone, Copy)]
struct Tower<'a> {
    shape: &'a Shape,
    blocks: &'a [Block],
    values: &'a [f32],
}

impl<'a> Network<'a> {
    fn over_sets(self) -> Option<OverSets<'a>> {
        let blocks = &self.layout.blocks;
        self.shape.sets.map(|sets| OverSets { sets, hidden: &self.shape.hidden, blocks, values: self.values })
    }

    fn tower(self, shape: &'a Shape, index: usize) -> Tower<'a> {
        Tower { shape, blocks: self.layout.of_tower(shape, index), values: self.values }
    }
}

impl Tower<'_> {
    fn forward(self, inputs: &[f32], sequences: Sequences<'_>, trace: &mut TowerTrace) {
        let Tower { shape, blocks, values } = self;
        let rows = inputs.len() / shape.inputs;
        trace.values.resize_with(shape.hidden.len() + 2, Vec::new);
        resized(&mut trace.values[0], inputs.len()).copy_from_slice(inputs);
        if shape.recurrent.is_some() {
            gru::forward(blocks, values, inputs, sequences, &mut trace.gru);
        }
        for (layer, (_, outputs)) in shape.layers().enumerate() {
            let block = shape.first_layer() + 2 * layer;
            let (before, after) = trace.values.split_at_mut(layer + 1);
            let before = if layer == 0 && shape.recurrent.is_some() { &trace.gru.outputs } else { &before[layer] };
            let after = resized(&mut after[0], rows * outputs);
            let [weight, bias] = [block, block + 1].map(|block| &values[blocks[block].place.clone()]);
            affine(before, weight, bias, after);
            if layer < shape.hidden.len() {
                // Not `max`, which would hide a NaN.
                after.iter_mut().for_each(|value| *value = if *value < 0.0 { 0.0 } else { *value });
            }
        }
    }

    fn backward(self, by_output: &[f32], trace: &mut TowerTrace, gradient: &mut [f32]) {
        let Tower { shape, blocks, values } = self;
        let rows = by_output.len() / shape.outputs;
        let [by_after, by_before] = &mut trace.by_layer;
        resized(by_after, by_output.len()).copy_from_slice(by_output);
        for (layer, (inputs, outputs)) in shape.layers().enumerate().rev() {
            let block = shape.first_layer() + 2 * layer;
            let recurrent_below = layer == 0 && shape.recurrent.is_some();
            let before = if recurrent_below { &trace.gru.outputs } else { &trace.values[layer] };
            let after = Matrix::new(by_after, outputs);
            let [weight, bias] = [block, block + 1].map(|block| blocks[block].place.clone());
            let transposed = Matrix::new(before, inputs).transposed();
            multiply(transposed, after, &mut gradient[weight.clone()], Before::Overwrite);
            sum_rows(by_after, &mut gradient[bias]);
            if layer > 0 || recurrent_below {
                let weight = Matrix::new(&values[weight], outputs);
                multiply(after, weight.transposed(), resized(by_before, rows * inputs), Before::Overwrite);
                std::mem::swap(by_after, by_before);
            }
            if layer > 0 {
                // The gradient passes if the ReLU's output is positive.
                by_after.iter_mut().zip(before).for_each(|(by, &value)| *by = if value > 0.0 { *by } else { 0.0 });
            }
        }
        if shape.recurrent.is_some() {
            gru::backward(blocks, values, &trace.values[0], by_after, &mut trace.gru, gradient);
        }
    }
}
