//! The parameters of a stack in one block of memory.

use std::ops::Range;

use tch::{Device, Kind, Tensor};

use super::convert::{tensor_to_slice, tensor_to_slice_mut};
use crate::base::Rows;

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
}

/// The parameters and gradients of `agents` networks of one shape.
///
/// Both are `[agents, width]`: the network of an agent is one row, so a row is what goes into a message or a file, and
/// one pass over memory updates everything.
pub struct Parameters {
    agents: usize,
    layout: Layout,
    values: Tensor,
    /// Made for the first backward pass: networks that only act have none.
    gradients: Option<Tensor>,
}

const NO_GRADIENTS: &str = "a backward pass makes the gradients";

impl Parameters {
    /// Zeroed parameters.
    pub fn new(agents: usize, layout: Layout) -> Self {
        let values = Tensor::zeros(&[agents as i64, layout.width as i64], (Kind::Float, Device::Cpu));
        Parameters { agents, values, gradients: None, layout }
    }

    pub fn agents(&self) -> usize {
        self.agents
    }

    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Parameters per agent.
    pub fn width(&self) -> usize {
        self.layout.width
    }

    /// All values, `[agents, width]`.
    pub fn values(&self) -> &[f32] {
        tensor_to_slice(&self.values)
    }

    /// As the last backward pass left them, `[agents, width]`.
    pub fn gradients(&self) -> &[f32] {
        tensor_to_slice(self.gradients.as_ref().expect(NO_GRADIENTS))
    }

    /// All values, to be written.
    pub fn values_mut(&mut self) -> &mut [f32] {
        tensor_to_slice_mut(&mut self.values)
    }

    /// Values to be written and the gradients beside them.
    pub fn values_and_gradients(&mut self) -> (&mut [f32], &[f32]) {
        let gradients = self.gradients.as_ref().expect(NO_GRADIENTS);
        (tensor_to_slice_mut(&mut self.values), tensor_to_slice(gradients))
    }

    /// Makes room for gradients, once.
    pub(super) fn need_gradients(&mut self) {
        self.gradients.get_or_insert_with(|| self.values.zeros_like());
    }

    /// A copy of all values, one row per agent.
    pub fn to_rows(&self) -> Rows<f32> {
        Rows::from_vec(self.values().to_vec(), self.width())
    }

    /// Takes over the values of `rows`, one row per agent.
    pub fn load(&mut self, rows: &Rows<f32>) {
        assert_eq!((rows.len(), rows.width()), (self.agents, self.width()), "parameters of another stack");
        self.values_mut().copy_from_slice(rows.as_slice());
    }

    /// The values of one block as a view `[agents, ..shape]`.
    pub(super) fn view(&self, block: usize) -> Tensor {
        self.block_of(&self.values, block)
    }

    /// The gradients of one block as a view `[agents, ..shape]`, to be written by `_out` operations.
    pub(super) fn gradient_view(&self, block: usize) -> Tensor {
        self.block_of(self.gradients.as_ref().expect(NO_GRADIENTS), block)
    }

    fn block_of(&self, all: &Tensor, block: usize) -> Tensor {
        let block = &self.layout.blocks[block];
        let mut shape = vec![self.agents as i64];
        shape.extend(block.shape.iter().map(|&n| n as i64));
        let mut strides = vec![self.layout.width as i64];
        strides.extend((1..=block.shape.len()).map(|axis| block.shape[axis..].iter().product::<usize>() as i64));
        all.as_strided(&shape, &strides, block.offset as i64)
    }

    pub(super) fn block_range(&self, block: usize) -> Range<usize> {
        let block = &self.layout.blocks[block];
        block.offset..block.offset + block.len
    }
}
