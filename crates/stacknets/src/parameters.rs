//! The parameters of a stack in one block of memory.

use super::Rows;
use super::shape::Layout;

/// The parameters of the networks of one stack, `[agents, width]`. Each row is the network of one agent, and goes into
/// messages and files as it is.
pub struct Parameters {
    layout: Layout,
    values: Rows<f32>,
}

impl Parameters {
    /// Makes parameters of zeros.
    pub fn new(agents: usize, layout: Layout) -> Self {
        Parameters { values: Rows::new(agents, layout.width()), layout }
    }

    pub fn agents(&self) -> usize {
        self.values.len()
    }

    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Returns the number of parameters per agent.
    pub fn width(&self) -> usize {
        self.layout.width()
    }

    /// Returns all values, `[agents, width]`.
    pub fn values(&self) -> &Rows<f32> {
        &self.values
    }

    pub(super) fn layout_and_values_mut(&mut self) -> (&Layout, &mut Rows<f32>) {
        (&self.layout, &mut self.values)
    }

    /// Returns all values, for writing.
    pub fn values_mut(&mut self) -> &mut Rows<f32> {
        &mut self.values
    }

    /// Copies the values of `rows`, one row per agent.
    pub fn load(&mut self, rows: &Rows<f32>) {
        assert_eq!((rows.len(), rows.width()), (self.agents(), self.width()), "parameters of another stack");
        self.values.copy_from(rows);
    }
}
