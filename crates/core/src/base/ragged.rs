//! `Ragged<T>`: a table whose rows may differ in width, one row per agent.

use serde::{Deserialize, Serialize};

use super::Rows;

/// Rows of different widths, one after another in memory.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WrittenRagged<T>")]
pub struct Ragged<T> {
    data: Vec<T>,
    /// End of each row in `data`. A row begins where the one before it ends.
    ends: Vec<usize>,
}

#[derive(Deserialize)]
struct WrittenRagged<T> {
    data: Vec<T>,
    ends: Vec<usize>,
}

impl<T> TryFrom<WrittenRagged<T>> for Ragged<T> {
    type Error = String;

    fn try_from(WrittenRagged { data, ends }: WrittenRagged<T>) -> Result<Self, String> {
        match ends.is_sorted() && ends.last().copied().unwrap_or(0) == data.len() {
            true => Ok(Ragged { data, ends }),
            false => Err(format!("the rows of a table do not fit its {} values", data.len())),
        }
    }
}

impl<T: Copy + Default> Ragged<T> {
    /// Makes a table of default values with rows of these widths.
    pub fn new(widths: impl IntoIterator<Item = usize>) -> Self {
        let mut end = 0;
        let next = |width| {
            end += width;
            end
        };
        let ends = widths.into_iter().map(next).collect();
        Ragged { data: vec![T::default(); end], ends }
    }

    /// Makes rows of these widths from values that are already in order. If their number does not fit the widths:
    /// `None`.
    pub fn from_vec(data: Vec<T>, widths: impl IntoIterator<Item = usize>) -> Option<Self> {
        let mut end = 0_usize;
        let mut ends = Vec::new();
        for width in widths {
            end = end.checked_add(width)?;
            ends.push(end);
        }
        (data.len() == end).then_some(Ragged { data, ends })
    }

    pub fn len(&self) -> usize {
        self.ends.len()
    }

    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    fn begin(&self, row: usize) -> usize {
        if row == 0 { 0 } else { self.ends[row - 1] }
    }

    pub fn row(&self, row: usize) -> &[T] {
        &self.data[self.begin(row)..self.ends[row]]
    }

    pub fn row_mut(&mut self, row: usize) -> &mut [T] {
        let begin = self.begin(row);
        &mut self.data[begin..self.ends[row]]
    }

    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[T]> + Clone {
        (0..self.len()).map(|row| self.row(row))
    }

    pub fn widths(&self) -> impl Iterator<Item = usize> {
        self.iter().map(<[T]>::len)
    }

    pub fn as_slice(&self) -> &[T] {
        &self.data
    }

    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.data
    }

    pub fn push(&mut self, row: &[T]) {
        self.data.extend_from_slice(row);
        self.ends.push(self.data.len());
    }

    pub fn extend(&mut self, other: &Ragged<T>) {
        let begin = self.data.len();
        self.data.extend_from_slice(&other.data);
        self.ends.extend(other.ends.iter().map(|end| begin + end));
    }

    /// Overwrites the rows from `first` on.
    pub fn replace(&mut self, first: usize, rows: &Ragged<T>) {
        for (index, values) in rows.iter().enumerate() {
            let row = self.row_mut(first + index);
            assert_eq!(row.len(), values.len(), "row {} has a different width", first + index);
            row.copy_from_slice(values);
        }
    }

    /// Replaces the rows from `first` on. Unlike in [`Ragged::replace`], they may have other widths.
    pub fn splice(&mut self, first: usize, rows: &Ragged<T>) {
        let after = first + rows.len();
        if rows.widths().eq((first..after).map(|row| self.row(row).len())) {
            return self.replace(first, rows);
        }
        let all = self.iter().take(first).chain(rows.iter()).chain(self.iter().skip(after));
        let mut spliced = Ragged { data: Vec::with_capacity(self.data.len() + rows.data.len()), ends: Vec::new() };
        all.for_each(|row| spliced.push(row));
        *self = spliced;
    }

    pub fn copy_from(&mut self, other: &Ragged<T>) {
        assert_eq!(self.ends, other.ends, "tables of different shapes");
        self.data.copy_from_slice(&other.data);
    }

    /// Copies some of the rows, in this order.
    pub fn pick(&self, rows: impl IntoIterator<Item = usize>) -> Ragged<T> {
        let mut picked = Ragged { data: Vec::new(), ends: Vec::new() };
        rows.into_iter().for_each(|row| picked.push(self.row(row)));
        picked
    }

    /// Copies some of the rows, in this order, into a table of the same number of rows and of their width.
    pub fn pick_into(&self, rows: impl ExactSizeIterator<Item = usize>, table: &mut Rows<T>) {
        assert_eq!(rows.len(), table.len(), "a different number of rows");
        rows.enumerate().for_each(|(to, from)| table.row_mut(to).copy_from_slice(self.row(from)));
    }

    /// Returns the same values as a table of one width. Panics if the rows differ in width.
    pub fn into_rows(self) -> Rows<T> {
        let width = self.ends.first().copied().unwrap_or(1);
        assert!(self.widths().all(|other| other == width), "rows of different widths");
        Rows::from_vec(self.data, width)
    }

    pub fn fill(&mut self, value: T) {
        self.data.fill(value);
    }
}

impl<T: Copy + Default> From<Rows<T>> for Ragged<T> {
    fn from(rows: Rows<T>) -> Self {
        let (width, len) = (rows.width(), rows.len());
        Ragged { data: rows.into_vec(), ends: (1..=len).map(|row| row * width).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes the table `[1 2] [3] [] [4 5 6]`.
    fn table() -> Ragged<i32> {
        Ragged::from_vec(vec![1, 2, 3, 4, 5, 6], [2, 1, 0, 3]).unwrap()
    }

    #[test]
    fn rows_keep_their_widths_and_are_picked_in_any_order_and_put_back() {
        let rows = table();
        assert_eq!(rows.iter().collect::<Vec<_>>(), [&[1, 2][..], &[3], &[], &[4, 5, 6]]);
        assert_eq!(Ragged::<u8>::new([2, 0, 1]), Ragged::from_vec(vec![0; 3], [2, 0, 1]).unwrap());
        assert_eq!(Ragged::from_vec(vec![0; 4], [2, 1]), None, "one value too many");
        assert_eq!(rows.pick([3, 0]).iter().collect::<Vec<_>>(), [&[4, 5, 6][..], &[1, 2]]);
        let mut joined = rows.pick([1, 2]);
        joined.extend(&rows.pick([3]));
        assert_eq!(joined, rows.pick(1..4));
        let mut replaced = Ragged::new(rows.widths());
        replaced.replace(0, &rows.pick([0]));
        replaced.replace(1, &joined);
        assert_eq!(replaced, rows);
        replaced.splice(1, &rows.pick([3]));
        assert_eq!(replaced, rows.pick([0, 3, 2, 3]));
    }

    #[test]
    fn a_table_of_one_width_goes_there_and_back() {
        let rows = Rows::from_vec(vec![1, 2, 3, 4, 5, 6], 2);
        let ragged = Ragged::from(rows.clone());
        let mut last_and_first = Rows::new(2, 2);
        ragged.pick_into([2, 0].into_iter(), &mut last_and_first);
        assert_eq!(last_and_first.as_slice(), [5, 6, 1, 2]);
        assert_eq!(ragged.into_rows(), rows);
        assert_eq!(Ragged::<u8>::default().into_rows().len(), 0);
    }

    #[test]
    fn a_table_that_is_read_has_the_values_of_its_rows() {
        let read =
            |ends: &str| serde_json::from_str::<Ragged<u8>>(&format!(r#"{{"data": [1, 2, 3], "ends": {ends}}}"#));
        assert_eq!(read("[1, 1, 3]").unwrap(), Ragged::from_vec(vec![1, 2, 3], [1, 0, 2]).unwrap());
        for ends in ["[1, 4]", "[3, 1]", "[2]", "[]", "[18446744073709551615]"] {
            assert!(read(ends).unwrap_err().to_string().contains("do not fit its 3 values"), "{ends}");
        }
    }
}
