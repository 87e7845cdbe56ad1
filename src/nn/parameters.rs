//! The parameters of a stack in one block of memory.

use tch::{Device, Kind, Tensor};

use super::convert::{tensor_to_slice, tensor_to_slice_mut};
use crate::base::Rows;

/// The parameters and gradients of `agents` networks of one shape.
///
/// Both are `[agents, width]`: the network of an agent is one row, so a row is what goes into a message or a file, and
/// one pass over memory updates everything. Named blocks of a row are the weights and biases.
pub struct Parameters {
    agents: usize,
    width: usize,
    blocks: Vec<Block>,
    values: Tensor,
    gradients: Tensor,
}

struct Block {
    name: String,
    /// Of one agent, e.g. `[in, out]`.
    shape: Vec<i64>,
    offset: usize,
    len: usize,
}

impl Parameters {
    /// Zeroed parameters with named blocks of the given shapes.
    pub fn new(agents: usize, blocks: &[(String, Vec<i64>)]) -> Self {
        let mut width = 0;
        let blocks = blocks
            .iter()
            .map(|(name, shape)| {
                let len = shape.iter().product::<i64>() as usize;
                let block = Block { name: name.clone(), shape: shape.clone(), offset: width, len };
                width += len;
                block
            })
            .collect();
        let zeros = || Tensor::zeros(&[agents as i64, width as i64], (Kind::Float, Device::Cpu));
        Parameters { agents, width, blocks, values: zeros(), gradients: zeros() }
    }

    pub fn agents(&self) -> usize {
        self.agents
    }

    /// Parameters per agent.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Names, shapes `[agents, ...]` and offsets within an agent's row, in order.
    pub fn blocks(&self) -> impl Iterator<Item = (&str, Vec<usize>, usize)> {
        self.blocks.iter().map(|block| {
            let shape = std::iter::once(self.agents).chain(block.shape.iter().map(|&n| n as usize)).collect();
            (block.name.as_str(), shape, block.offset)
        })
    }

    /// All values, `[agents, width]`.
    pub fn values(&self) -> &[f32] {
        tensor_to_slice(&self.values)
    }

    pub fn gradients(&self) -> &[f32] {
        tensor_to_slice(&self.gradients)
    }

    /// Values to be written and the gradients beside them.
    pub fn values_mut(&mut self) -> (&mut [f32], &[f32]) {
        (tensor_to_slice_mut(&mut self.values), tensor_to_slice(&self.gradients))
    }

    /// A copy of all values, one row per agent.
    pub fn to_rows(&self) -> Rows<f32> {
        Rows::from_vec(self.values().to_vec(), self.width)
    }

    /// Takes over the values of `rows`, one row per agent.
    pub fn load(&mut self, rows: &Rows<f32>) {
        assert_eq!((rows.len(), rows.width()), (self.agents, self.width), "parameters of another stack");
        self.values_mut().0.copy_from_slice(rows.as_slice());
    }

    /// The values of one block as a view `[agents, ..shape]`.
    pub(super) fn view(&self, block: usize) -> Tensor {
        self.block_of(&self.values, block)
    }

    /// The gradients of one block as a view `[agents, ..shape]`, to be written by `_out` operations.
    pub(super) fn gradient_view(&self, block: usize) -> Tensor {
        self.block_of(&self.gradients, block)
    }

    fn block_of(&self, all: &Tensor, block: usize) -> Tensor {
        let block = &self.blocks[block];
        let mut shape = vec![self.agents as i64];
        shape.extend(&block.shape);
        let mut strides = vec![self.width as i64];
        strides.extend((1..=block.shape.len()).map(|axis| block.shape[axis..].iter().product::<i64>()));
        all.as_strided(&shape, &strides, block.offset as i64)
    }

    pub(super) fn block_range(&self, block: usize) -> std::ops::Range<usize> {
        let block = &self.blocks[block];
        block.offset..block.offset + block.len
    }
}
