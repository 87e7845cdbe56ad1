//! What a network looks like, and where its weights and biases lie within a row of parameters.

use std::ops::Range;

/// What a network looks like: inputs -> GRU, if any -> hidden layers with ReLU -> linear outputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    pub inputs: usize,
    /// Width of the GRU.
    pub recurrent: Option<usize>,
    pub hidden: Vec<usize>,
    pub outputs: usize,
}

impl Shape {
    /// Width of the hidden state; 0 without a GRU.
    pub fn state_width(&self) -> usize {
        self.recurrent.unwrap_or(0)
    }

    /// Inputs and outputs of the linear layers.
    pub(super) fn layers(&self) -> impl DoubleEndedIterator<Item = (usize, usize)> + ExactSizeIterator {
        let inputs = |layer: usize| match layer {
            0 => self.recurrent.unwrap_or(self.inputs),
            _ => self.hidden[layer - 1],
        };
        let outputs = |layer: usize| self.hidden.get(layer).copied().unwrap_or(self.outputs);
        (0..self.hidden.len() + 1).map(move |layer| (inputs(layer), outputs(layer)))
    }

    /// Where the weights and biases lie.
    pub fn layout(&self) -> Layout {
        let mut blocks = Vec::new();
        if let Some(width) = self.recurrent {
            blocks.push(("gru.input_weight".to_owned(), vec![self.inputs, 3 * width]));
            blocks.push(("gru.state_weight".to_owned(), vec![width, 3 * width]));
            blocks.push(("gru.input_bias".to_owned(), vec![1, 3 * width]));
            blocks.push(("gru.state_bias".to_owned(), vec![1, 3 * width]));
        }
        for (index, (inputs, outputs)) in self.layers().enumerate() {
            blocks.push((format!("layers.{index}.weight"), vec![inputs, outputs]));
            blocks.push((format!("layers.{index}.bias"), vec![1, outputs]));
        }
        Layout::new(blocks)
    }

    /// Bounds of the initial values of each stretch of a row, in order: (length, bound).
    ///
    /// As torch's `Linear` and `GRU`: U(-b, b) for weights and biases alike, `b = 1 / sqrt(inputs)` for a linear layer
    /// and `1 / sqrt(width)` for a GRU.
    pub(super) fn initial_bounds(&self) -> Vec<(usize, f32)> {
        let gru = self.recurrent.map(|width| {
            let length = (self.inputs + width + 2) * 3 * width;
            (length, 1.0 / (width as f32).sqrt())
        });
        let layer = |(inputs, outputs): (usize, usize)| ((inputs + 1) * outputs, 1.0 / (inputs as f32).sqrt());
        gru.into_iter().chain(self.layers().map(layer)).collect()
    }
}

/// Where the named weights and biases of a network lie within its row of parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    width: usize,
    blocks: Vec<Block>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Block {
    name: String,
    /// Of one agent, e.g. `[in, out]`.
    shape: Vec<usize>,
    offset: usize,
    len: usize,
}

impl Layout {
    /// Blocks of these names and shapes, one after another.
    pub fn new(blocks: Vec<(String, Vec<usize>)>) -> Self {
        let mut width = 0;
        let blocks = blocks
            .into_iter()
            .map(|(name, shape)| {
                let len = shape.iter().product();
                let block = Block { name, shape, offset: width, len };
                width += len;
                block
            })
            .collect();
        Layout { width, blocks }
    }

    /// Parameters per agent.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Names, shapes `[agents, ...]` and places within a row, in order.
    pub fn blocks(&self, agents: usize) -> impl Iterator<Item = (&str, Vec<usize>, Range<usize>)> {
        self.blocks.iter().map(move |block| {
            let shape = std::iter::once(agents).chain(block.shape.iter().copied()).collect();
            (block.name.as_str(), shape, block.offset..block.offset + block.len)
        })
    }

    /// Where a block lies within a row.
    pub(super) fn range(&self, block: usize) -> Range<usize> {
        let block = &self.blocks[block];
        block.offset..block.offset + block.len
    }
}
