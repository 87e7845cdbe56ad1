//! The layers of a network, the places of its weights and biases in a row of parameters, and the rows of a stack.

use std::ops::Range;

use super::sets::Sets;
use super::{Rows, gru};

/// The layers of a network: inputs -> GRU, if any -> hidden layers with ReLU -> linear outputs.
///
/// Some outputs can be apart: a second *tower* with the same inputs and the same hidden layers makes them. The two
/// towers share nothing but the inputs. An actor and a critic can be such towers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Number of inputs.
    pub inputs: usize,
    /// Width of the GRU, if there is one.
    pub recurrent: Option<usize>,
    /// Widths of the hidden layers; empty if there are none.
    pub hidden: Vec<usize>,
    /// Number of outputs, of both towers.
    pub outputs: usize,
    /// Number of outputs, the last ones, that the second tower makes; 0 if there is one tower.
    pub apart: usize,
    /// Whether the inputs are sets, and how they lie. Such a network has neither a GRU nor a second tower. The last hidden layer
    /// is that of its scorer and of its value, the others encode the items.
    pub sets: Option<Sets>,
}

/// Beginning of the names of the second tower's blocks: in most networks with two towers it is a critic.
const APART: &str = "critic.";

impl Shape {
    /// Returns the shape of a network over sets: a number for each choice, then the value.
    pub fn over_sets(sets: Sets, hidden: Vec<usize>) -> Shape {
        let (inputs, outputs) = (sets.inputs(), sets.choices + 1);
        Shape { inputs, recurrent: None, hidden, outputs, apart: 0, sets: Some(sets) }
    }

    /// Returns the width of the hidden state, that of the first tower and then that of the second; 0 without a GRU.
    pub fn state_width(&self) -> usize {
        self.recurrent.unwrap_or(0) * if self.apart > 0 { 2 } else { 1 }
    }

    /// Returns the shapes of its towers, which have one tower each.
    pub(crate) fn towers(&self) -> Vec<Shape> {
        let outputs = [self.outputs - self.apart, self.apart].into_iter().filter(|&outputs| outputs > 0);
        outputs.map(|outputs| Shape { outputs, apart: 0, ..self.clone() }).collect()
    }

    /// Returns the number of blocks of a tower.
    pub(crate) fn blocks_per_tower(&self) -> usize {
        self.first_layer() + 2 * (self.hidden.len() + 1)
    }

    /// Returns the block of the first linear layer's weight in a tower.
    pub(crate) fn first_layer(&self) -> usize {
        if self.recurrent.is_some() { gru::BLOCKS } else { 0 }
    }

    /// Returns which parameters matter to the last output alone, one flag per parameter. They are all of its tower if
    /// no other output is in it, else its weights and its bias in the last layer.
    pub fn only_for_the_last_output(&self) -> Vec<bool> {
        let layout = self.layout();
        let of_last_tower = if self.apart > 0 { self.apart } else { self.outputs };
        let mut flags = vec![false; layout.width()];
        if self.sets.is_some() {
            let of_value = layout.blocks.iter().filter(|block| block.name.starts_with("value."));
            of_value.for_each(|block| flags[block.place.clone()].fill(true));
        } else if of_last_tower == 1 {
            let tower = layout.of_tower(self, self.towers().len() - 1);
            flags[tower[0].place.start..].fill(true);
        } else {
            // The last two blocks: `[in, outputs]` and `[1, outputs]`.
            for block in &layout.blocks[layout.blocks.len() - 2..] {
                let flags = flags[block.place.clone()].iter_mut();
                flags.skip(of_last_tower - 1).step_by(of_last_tower).for_each(|flag| *flag = true);
            }
        }
        flags
    }

    /// Returns the number of inputs and outputs of each linear layer. Only for one tower.
    pub(crate) fn layers(&self) -> impl DoubleEndedIterator<Item = (usize, usize)> + ExactSizeIterator {
        let inputs = |layer: usize| match layer {
            0 => self.recurrent.unwrap_or(self.inputs),
            _ => self.hidden[layer - 1],
        };
        let outputs = |layer: usize| self.hidden.get(layer).copied().unwrap_or(self.outputs);
        (0..self.hidden.len() + 1).map(move |layer| (inputs(layer), outputs(layer)))
    }

    /// Returns the places of the weights and biases, those of the first tower first.
    pub fn layout(&self) -> Layout {
        if let Some(sets) = self.sets {
            return Layout::new(blocks_over_sets(sets, &self.hidden));
        }
        let prefixes = ["", APART];
        Layout::new(prefixes.iter().zip(self.towers()).flat_map(|(prefix, tower)| tower.blocks(prefix)).collect())
    }

    /// Returns names and shapes of the weights and biases of one tower.
    fn blocks(&self, prefix: &str) -> Vec<(String, Vec<usize>)> {
        let mut blocks = Vec::new();
        if let Some(width) = self.recurrent {
            let rows = [("input_weight", self.inputs), ("state_weight", width), ("input_bias", 1), ("state_bias", 1)];
            blocks.extend(rows.map(|(name, rows)| (format!("{prefix}gru.{name}"), vec![rows, 3 * width])));
        }
        for (index, (inputs, outputs)) in self.layers().enumerate() {
            blocks.push((format!("{prefix}layers.{index}.weight"), vec![inputs, outputs]));
            blocks.push((format!("{prefix}layers.{index}.bias"), vec![1, outputs]));
        }
        blocks
    }

    /// Returns the bounds of the initial values, in order: (number of values, bound).
    ///
    /// The same as torch's `Linear` and `GRU`: U(-b, b) for weights and biases, with `b = 1 / sqrt(inputs)` for a
    /// linear layer and `1 / sqrt(width)` for a GRU.
    pub(crate) fn initial_bounds(&self) -> Vec<(usize, f32)> {
        let layer = |(inputs, outputs): (usize, usize)| ((inputs + 1) * outputs, 1.0 / (inputs as f32).sqrt());
        if let Some(sets) = self.sets {
            return sets
                .layers(&self.hidden)
                .into_iter()
                .map(|(_, [inputs, outputs])| layer((inputs, outputs)))
                .collect();
        }
        let of_tower = |tower: Shape| {
            let gru = tower.recurrent.map(|width| {
                let length = (tower.inputs + width + 2) * 3 * width;
                (length, 1.0 / (width as f32).sqrt())
            });
            gru.into_iter().chain(tower.layers().map(layer)).collect::<Vec<_>>()
        };
        self.towers().into_iter().flat_map(of_tower).collect()
    }
}

/// Returns names and shapes of the weights and biases of a network over sets.
fn blocks_over_sets(sets: Sets, hidden: &[usize]) -> Vec<(String, Vec<usize>)> {
    let layers = sets.layers(hidden);
    let of_layer = |(place, &(part, [inputs, outputs])): (usize, &(&str, [usize; 2]))| {
        let number = layers[..place].iter().filter(|(other, _)| *other == part).count();
        let name = |what: &str| format!("{part}.{number}.{what}");
        [(name("weight"), vec![inputs, outputs]), (name("bias"), vec![1, outputs])]
    };
    layers.iter().enumerate().flat_map(of_layer).collect()
}

/// Places of the named weights and biases of a network within its row of parameters.
///
/// Those of a [`Shape`] are called `gru.input_weight`, `gru.state_weight`, `gru.input_bias`, `gru.state_bias`, and
/// `layers.0.weight`, `layers.0.bias` and so on; those of a second tower begin with `critic.`. A weight is `[in, out]`, and a
/// bias `[1, out]`. The columns of a GRU's are those of its gates r, z and n.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    width: usize,
    pub(crate) blocks: Vec<Block>,
}

/// A weight or a bias.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Block {
    name: String,
    /// Shape for one network, such as `[in, out]`.
    shape: Vec<usize>,
    /// Place within a row of parameters.
    pub(crate) place: Range<usize>,
}

impl Block {
    /// Returns whether it is a weight, and not a bias.
    pub(crate) fn is_weight(&self) -> bool {
        self.name.ends_with("weight")
    }

    pub(crate) fn columns(&self) -> usize {
        *self.shape.last().expect("a weight has columns")
    }
}

impl Layout {
    /// Makes a layout of blocks with these names and shapes, in order, for rows of a table that come from elsewhere.
    pub fn new(blocks: Vec<(String, Vec<usize>)>) -> Self {
        let mut width = 0;
        let place = |(name, shape): (String, Vec<usize>)| {
            let begin = width;
            width += shape.iter().product::<usize>();
            Block { name, shape, place: begin..width }
        };
        let blocks = blocks.into_iter().map(place).collect();
        Layout { width, blocks }
    }

    /// Returns the number of parameters per network.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the names of the blocks, their shapes in a stack of `networks` (`[networks, in, out]`), and their places
    /// within a row, in order.
    pub fn blocks(&self, networks: usize) -> impl Iterator<Item = (&str, Vec<usize>, Range<usize>)> {
        self.blocks
            .iter()
            .map(move |Block { name, shape, place }| (name.as_str(), [&[networks], &shape[..]].concat(), place.clone()))
    }

    /// Returns the places of all weights within a row, without the biases.
    pub(crate) fn weights(&self) -> impl Iterator<Item = Range<usize>> {
        self.blocks.iter().filter(|block| block.is_weight()).map(|block| block.place.clone())
    }

    /// Returns the blocks of a tower of this shape, which is the network's `index`-th.
    pub(crate) fn of_tower(&self, shape: &Shape, index: usize) -> &[Block] {
        &self.blocks[index * shape.blocks_per_tower()..][..shape.blocks_per_tower()]
    }
}

/// The parameters of the networks of one stack, `[networks, width]`. A row is one network, and goes into messages and
/// files as it is. Its [`Layout`] says which weight is where.
pub struct Parameters {
    pub(crate) layout: Layout,
    pub(crate) values: Rows<f32>,
}

impl Parameters {
    /// Makes parameters of zeros.
    pub(crate) fn new(networks: usize, layout: Layout) -> Self {
        Parameters { values: Rows::new(networks, layout.width()), layout }
    }

    /// Returns the number of networks.
    pub fn networks(&self) -> usize {
        self.values.len()
    }

    /// Returns the places of weights and biases within a row.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Returns the number of parameters per network.
    pub fn width(&self) -> usize {
        self.layout.width()
    }

    /// Returns all values, `[networks, width]`.
    pub fn values(&self) -> &Rows<f32> {
        &self.values
    }

    /// Returns all values, for writing.
    pub fn values_mut(&mut self) -> &mut Rows<f32> {
        &mut self.values
    }

    /// Copies the values of `rows`, one row per network.
    ///
    /// # Panics
    /// If `rows` has a different shape.
    pub fn load(&mut self, rows: &Rows<f32>) {
        assert_eq!((rows.len(), rows.width()), (self.networks(), self.width()), "parameters of another stack");
        self.values.copy_from(rows);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_output_has_its_column_of_the_last_layer_or_a_tower_for_itself() {
        let shape = Shape { inputs: 1, recurrent: None, hidden: vec![2], outputs: 3, apart: 0, sets: None };
        // Weight and bias of the hidden layer: 4. Weight of the outputs [2, 3], bias [1, 3].
        let flags: Vec<usize> = shape.only_for_the_last_output().iter().map(|&flag| usize::from(flag)).collect();
        assert_eq!(flags, [0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 1]);
        let apart = Shape { apart: 1, ..shape };
        // First tower: 4 + 2 * 2 + 2 = 10, second: 4 + 2 + 1 = 7.
        let flags = apart.only_for_the_last_output();
        assert_eq!((flags.len(), flags.iter().position(|&flag| flag)), (17, Some(10)));
        assert!(flags[10..].iter().all(|&flag| flag));
    }
}
