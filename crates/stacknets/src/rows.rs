//! `Rows<T>`: tables that go into networks and come out of them.

use serde::{Deserialize, Serialize};

/// A dense table in row-major order, `[rows, width]`.
///
/// Where several rows are of one network, they are neighbours: `[networks x rows of each, width]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WrittenRows<T>")]
pub struct Rows<T> {
    data: Vec<T>,
    width: usize,
}

/// Rows as they are read, not yet checked.
#[derive(Deserialize)]
struct WrittenRows<T> {
    data: Vec<T>,
    width: usize,
}

impl<T> TryFrom<WrittenRows<T>> for Rows<T> {
    type Error = String;

    fn try_from(WrittenRows { data, width }: WrittenRows<T>) -> Result<Self, String> {
        match data.len().checked_rem(width).unwrap_or(data.len()) {
            0 => Ok(Rows { data, width }),
            _ => Err(format!("{} values do not make rows of {width}", data.len())),
        }
    }
}

impl<T: Copy + Default> Rows<T> {
    /// Makes a table of `rows` x `width` default values.
    ///
    /// # Panics
    /// If `width` is 0.
    pub fn new(rows: usize, width: usize) -> Self {
        assert!(width > 0, "a row has at least one column");
        Rows { data: vec![T::default(); rows * width], width }
    }

    /// Makes a table from values that are already in row-major order.
    ///
    /// # Panics
    /// If the values do not make whole rows.
    pub fn from_vec(data: Vec<T>, width: usize) -> Self {
        assert!(width > 0 && data.len().is_multiple_of(width), "{} values do not make rows of {width}", data.len());
        Rows { data, width }
    }

    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        self.data.len() / self.width
    }

    /// Returns whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Returns the number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns one row, `[width]`.
    pub fn row(&self, row: usize) -> &[T] {
        &self.data[row * self.width..(row + 1) * self.width]
    }

    /// Returns one row, `[width]`, for writing.
    pub fn row_mut(&mut self, row: usize) -> &mut [T] {
        &mut self.data[row * self.width..(row + 1) * self.width]
    }

    /// Returns the rows, one after another.
    pub fn iter(&self) -> std::slice::ChunksExact<'_, T> {
        self.data.chunks_exact(self.width)
    }

    /// Returns all values, row after row.
    pub fn as_slice(&self) -> &[T] {
        &self.data
    }

    /// Returns all values, row after row, for writing.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// Returns all values, row after row, and ends the table.
    pub fn into_vec(self) -> Vec<T> {
        self.data
    }

    /// Appends a row.
    ///
    /// # Panics
    /// If it has a different width.
    pub fn push(&mut self, row: &[T]) {
        assert_eq!(row.len(), self.width, "a row of a different width");
        self.data.extend_from_slice(row);
    }

    /// Appends all rows of `other`.
    ///
    /// # Panics
    /// If they have a different width.
    pub fn extend(&mut self, other: &Rows<T>) {
        assert_eq!(other.width, self.width, "rows of a different width");
        self.data.extend_from_slice(&other.data);
    }

    /// Copies the values of a table of the same shape.
    ///
    /// # Panics
    /// If it has a different shape.
    pub fn copy_from(&mut self, other: &Rows<T>) {
        assert_eq!((self.len(), self.width), (other.len(), other.width), "tables of different shapes");
        self.data.copy_from_slice(&other.data);
    }

    /// Sets all values to this one.
    pub fn fill(&mut self, value: T) {
        self.data.fill(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torn_table_is_not_received() {
        let received = |width| {
            let parts = postcard::to_stdvec(&(vec![1_u8, 2, 3, 4, 5, 6], width)).unwrap();
            postcard::from_bytes::<Rows<u8>>(&parts).map(|rows| rows.len())
        };
        assert_eq!([2, 6].map(|width: usize| received(width).unwrap()), [3, 1]);
        assert!([0, 4, usize::MAX].into_iter().all(|width| received(width).is_err()));
    }
}
