//! The layers of a network, and the places of its weights and biases in a row of parameters.

use std::ops::Range;

/// The layers of a network: inputs -> GRU, if any -> hidden layers with ReLU -> linear outputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    pub inputs: usize,
    /// Width of the GRU, if there is one.
    pub recurrent: Option<usize>,
    pub hidden: Vec<usize>,
    pub outputs: usize,
}

impl Shape {
    /// Returns the width of the hidden state; 0 without a GRU.
    pub fn state_width(&self) -> usize {
        self.recurrent.unwrap_or(0)
    }

    /// Returns the number of inputs and outputs of each linear layer.
    pub(super) fn layers(&self) -> impl DoubleEndedIterator<Item = (usize, usize)> + ExactSizeIterator {
        let inputs = |layer: usize| match layer {
            0 => self.recurrent.unwrap_or(self.inputs),
            _ => self.hidden[layer - 1],
        };
        let outputs = |layer: usize| self.hidden.get(layer).copied().unwrap_or(self.outputs);
        (0..self.hidden.len() + 1).map(move |layer| (inputs(layer), outputs(layer)))
    }

    /// Returns the places of the weights and biases.
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

    /// Returns the bounds of the initial values, in order: (number of values, bound).
    ///
    /// The same as torch's `Linear` and `GRU`: U(-b, b) for weights and biases, with `b = 1 / sqrt(inputs)` for a
    /// linear layer and `1 / sqrt(width)` for a GRU.
    pub(super) fn initial_bounds(&self) -> Vec<(usize, f32)> {
        let gru = self.recurrent.map(|width| {
            let length = (self.inputs + width + 2) * 3 * width;
            (length, 1.0 / (width as f32).sqrt())
        });
        let layer = |(inputs, outputs): (usize, usize)| ((inputs + 1) * outputs, 1.0 / (inputs as f32).sqrt());
        gru.into_iter().chain(self.layers().map(layer)).collect()
    }
}

/// Places of the named weights and biases of a network within its row of parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    width: usize,
    blocks: Vec<ParameterBlock>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct ParameterBlock {
    name: String,
    /// Shape for one agent, such as `[in, out]`.
    shape: Vec<usize>,
    offset: usize,
    len: usize,
}

impl Layout {
    /// Makes a layout of blocks with these names and shapes, in order.
    pub fn new(blocks: Vec<(String, Vec<usize>)>) -> Self {
        let mut width = 0;
        let blocks = blocks
            .into_iter()
            .map(|(name, shape)| {
                let len = shape.iter().product();
                let block = ParameterBlock { name, shape, offset: width, len };
                width += len;
                block
            })
            .collect();
        Layout { width, blocks }
    }

    /// Returns the number of parameters per agent.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns names, shapes `[agents, ...]` and places within a row, in order.
    pub fn blocks(&self, agents: usize) -> impl Iterator<Item = (&str, Vec<usize>, Range<usize>)> {
        self.blocks.iter().map(move |block| {
            let shape = std::iter::once(agents).chain(block.shape.iter().copied()).collect();
            (block.name.as_str(), shape, block.offset..block.offset + block.len)
        })
    }

    /// Returns the place of a block within a row.
    pub(super) fn range(&self, block: usize) -> Range<usize> {
        let block = &self.blocks[block];
        block.offset..block.offset + block.len
    }
}
