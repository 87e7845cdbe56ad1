//! The parameters of a stack in one block of memory.

use super::Rows;
use super::shape::Layout;

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
