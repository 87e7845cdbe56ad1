//! The hidden states of recurrent networks between steps.

/// One hidden state per row of the inputs: `[networks x rows of each, state_width]`, the rows of a network together.
/// Networks without a GRU have states of width 0.
#[derive(Clone, Debug, PartialEq)]
pub struct States {
    rows: usize,
    width: usize,
    values: Vec<f32>,
}

impl States {
    /// Makes states of zeros: `[rows, width]`.
    pub fn new(rows: usize, width: usize) -> Self {
        States { rows, width, values: vec![0.0; rows * width] }
    }

    /// Returns the number of states.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns one state, `[state_width]`.
    pub fn row(&self, row: usize) -> &[f32] {
        &self.values[row * self.width..(row + 1) * self.width]
    }

    /// Returns all states, one after another.
    pub fn as_slice(&self) -> &[f32] {
        &self.values
    }

    pub(crate) fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// Replaces one state.
    ///
    /// # Panics
    /// If the new one has a different width.
    pub fn set_row(&mut self, row: usize, state: &[f32]) {
        self.values[row * self.width..(row + 1) * self.width].copy_from_slice(state);
    }

    /// Sets one state to zero, because a new sequence begins in its row.
    pub fn clear(&mut self, row: usize) {
        self.values[row * self.width..(row + 1) * self.width].fill(0.0);
    }
}
