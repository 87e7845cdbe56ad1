//! What recurrent networks remember between steps.

/// One hidden state per row; rows ordered agent-major, as inputs. Networks without memory have states of width 0.
#[derive(Clone, Debug, PartialEq)]
pub struct States {
    rows: usize,
    width: usize,
    values: Vec<f32>,
}

impl States {
    /// Cleared states.
    pub fn new(rows: usize, width: usize) -> Self {
        States { rows, width, values: vec![0.0; rows * width] }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    pub fn row(&self, row: usize) -> &[f32] {
        &self.values[row * self.width..(row + 1) * self.width]
    }

    /// All of them, one after another.
    pub fn as_slice(&self) -> &[f32] {
        &self.values
    }

    pub(super) fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.values
    }

    pub fn set_row(&mut self, row: usize, state: &[f32]) {
        self.values[row * self.width..(row + 1) * self.width].copy_from_slice(state);
    }

    /// An episode begins in this row.
    pub fn clear(&mut self, row: usize) {
        self.values[row * self.width..(row + 1) * self.width].fill(0.0);
    }
}
