//! The hidden states of recurrent networks between steps.

/// One hidden state per row. Rows are ordered by agent, then by copy, as inputs are. Networks without memory have
/// states of width 0.
#[derive(Clone, Debug, PartialEq)]
pub struct States {
    rows: usize,
    width: usize,
    values: Vec<f32>,
}

impl States {
    /// Makes states of zeros.
    pub fn new(rows: usize, width: usize) -> Self {
        States { rows, width, values: vec![0.0; rows * width] }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    pub fn row(&self, row: usize) -> &[f32] {
        &self.values[row * self.width..(row + 1) * self.width]
    }

    /// Returns all states, one after another.
    pub fn as_slice(&self) -> &[f32] {
        &self.values
    }

    pub(super) fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.values
    }

    pub fn set_row(&mut self, row: usize, state: &[f32]) {
        self.values[row * self.width..(row + 1) * self.width].copy_from_slice(state);
    }

    /// Sets a row to zero, because an episode begins in it.
    pub fn clear(&mut self, row: usize) {
        self.values[row * self.width..(row + 1) * self.width].fill(0.0);
    }
}
