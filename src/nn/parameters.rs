//! The parameters of a stack in one block of memory.

use super::shape::Layout;
use crate::base::Rows;

/// The parameters of `agents` networks of one shape, `[agents, width]`: the network of an agent is one row, so a row is
/// what goes into a message or a file.
pub struct Parameters {
    layout: Layout,
    values: Rows<f32>,
}

impl Parameters {
    /// Zeroed parameters.
    pub fn new(agents: usize, layout: Layout) -> Self {
        Parameters { values: Rows::new(agents, layout.width()), layout }
    }

    pub fn agents(&self) -> usize {
        self.values.len()
    }

    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Parameters per agent.
    pub fn width(&self) -> usize {
        self.layout.width()
    }

    /// All values, `[agents, width]`.
    pub fn values(&self) -> &Rows<f32> {
        &self.values
    }

    pub(super) fn layout_and_values_mut(&mut self) -> (&Layout, &mut Rows<f32>) {
        (&self.layout, &mut self.values)
    }

    /// All values, to be written.
    pub fn values_mut(&mut self) -> &mut Rows<f32> {
        &mut self.values
    }

    /// Takes over the values of `rows`, one row per agent.
    pub fn load(&mut self, rows: &Rows<f32>) {
        assert_eq!((rows.len(), rows.width()), (self.agents(), self.width()), "parameters of another stack");
        self.values.copy_from(rows);
    }
}
