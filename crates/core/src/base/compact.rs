//! Rows of numbers that are mostly bits, in an eighth of a byte each.

use serde::{Deserialize, Serialize};

/// A growing table of f32 rows. A column takes one bit per entry while all of its entries are 0 or 1, as those of the d-sets (inputs
/// of influence predictors) of both of the paper's domains. From its first other entry on, a column takes four bytes per entry.
/// Either way the values are exact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WrittenRows")]
pub struct CompactRows {
    width: usize,
    len: usize,
    /// All columns; each row begins with a new byte. Bits of the columns in `others` are 0.
    bits: Vec<u8>,
    /// Columns with other numbers, in ascending order.
    others: Vec<usize>,
    /// `[len, others]`
    values: Vec<f32>,
}

/// Rows as they are read, not yet checked.
#[derive(Deserialize)]
struct WrittenRows {
    width: usize,
    len: usize,
    bits: Vec<u8>,
    others: Vec<usize>,
    values: Vec<f32>,
}

impl TryFrom<WrittenRows> for CompactRows {
    type Error = String;

    fn try_from(WrittenRows { width, len, bits, others, values }: WrittenRows) -> Result<Self, String> {
        let is_whole = |each: usize, has: usize| each.checked_mul(len) == Some(has);
        let ascend = others.is_sorted_by(|one, next| one < next) && others.last().is_none_or(|&last| last < width);
        let fits = is_whole(width.div_ceil(8), bits.len()) && is_whole(others.len(), values.len());
        match ascend && fits && (width > 0 || len == 0) {
            true => Ok(CompactRows { width, len, bits, others, values }),
            false => {
                let (has, columns) = (bits.len(), others.len());
                Err(format!("{has} bytes of bits and {columns} other columns do not make {len} rows of {width}"))
            }
        }
    }
}

fn is_bit(entry: f32) -> bool {
    [0.0_f32, 1.0].map(f32::to_bits).contains(&entry.to_bits())
}

impl CompactRows {
    pub fn new(width: usize) -> Self {
        CompactRows { width, len: 0, bits: Vec::new(), others: Vec::new(), values: Vec::new() }
    }

    pub fn width(&self) -> usize {
        self.width
    }

    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub fn push(&mut self, row: &[f32]) {
        assert_eq!(row.len(), self.width, "a row of a different width");
        self.widen((0..self.width).filter(|&column| !is_bit(row[column])));
        let begin = self.bits.len();
        self.bits.extend(row.chunks(8).map(|entries| {
            entries.iter().enumerate().fold(0, |byte, (i, &entry)| byte | (u8::from(entry == 1.0) << i))
        }));
        for &column in &self.others {
            self.values.push(row[column]);
            self.bits[begin + column / 8] &= !(1 << (column % 8));
        }
        self.len += 1;
    }

    /// Copies a row to `out`, `[width]`.
    pub fn read(&self, row: usize, out: &mut [f32]) {
        assert!(row < self.len, "row {row} of {}", self.len);
        let bytes = self.width.div_ceil(8);
        for (entries, byte) in out.chunks_mut(8).zip(&self.bits[row * bytes..]) {
            entries.iter_mut().enumerate().for_each(|(i, entry)| *entry = f32::from(byte >> i & 1));
        }
        let values = &self.values[row * self.others.len()..];
        self.others.iter().zip(values).for_each(|(&column, &value)| out[column] = value);
    }

    pub fn extend(&mut self, other: &CompactRows) {
        assert_eq!(other.width, self.width, "rows of a different width");
        self.widen(other.others.iter().copied());
        if self.others == other.others {
            self.bits.extend_from_slice(&other.bits);
            self.values.extend_from_slice(&other.values);
            self.len += other.len;
            return;
        }
        let mut row = vec![0.0; self.width];
        for i in 0..other.len {
            other.read(i, &mut row);
            self.push(&row);
        }
    }

    /// Makes these columns, which ascend, some of those with other numbers. If these are half of all, all others follow: each time costs
    /// as much as the whole table.
    fn widen(&mut self, columns: impl Iterator<Item = usize>) {
        let mut new: Vec<usize> = columns.filter(|column| self.others.binary_search(column).is_err()).collect();
        if new.is_empty() {
            return;
        }
        if 2 * (self.others.len() + new.len()) > self.width {
            new = (0..self.width).filter(|column| self.others.binary_search(column).is_err()).collect();
        }
        let mut others = [&self.others[..], &new].concat();
        others.sort_unstable();
        let mut row = vec![0.0; self.width];
        let mut values = Vec::with_capacity(self.len * others.len());
        for i in 0..self.len {
            self.read(i, &mut row);
            values.extend(others.iter().map(|&column| row[column]));
        }
        let bytes = self.width.div_ceil(8);
        for bits in self.bits.chunks_exact_mut(bytes) {
            new.iter().for_each(|column| bits[column / 8] &= !(1 << (column % 8)));
        }
        (self.others, self.values) = (others, values);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows_of(rows: &CompactRows) -> Vec<Vec<f32>> {
        let row = |i| {
            let mut row = vec![9.0; rows.width()];
            rows.read(i, &mut row);
            row
        };
        (0..rows.len()).map(row).collect()
    }

    fn table(rows: &[Vec<f32>]) -> CompactRows {
        let mut table = CompactRows::new(rows[0].len());
        rows.iter().for_each(|row| table.push(row));
        table
    }

    #[test]
    fn bits_and_other_numbers_come_back_as_they_were() {
        let bits = [vec![1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0], vec![0.0; 10], vec![1.0; 10]];
        let packed = table(&bits);
        assert_eq!((packed.bits.len(), packed.values.len()), (6, 0));
        assert_eq!(rows_of(&packed), bits);

        // Two columns with other numbers; a minus before a 0 is one.
        let mut mixed = vec![1.0; 10];
        (mixed[9], mixed[3]) = (0.25, -0.0);
        let with_mixed = [&bits[..], &[mixed.clone()], &bits[..]].concat();
        let rows = table(&with_mixed);
        assert_eq!((&rows.others[..], rows.values.len()), (&[3, 9][..], 14));
        assert_eq!(rows_of(&rows), with_mixed);
        assert!(rows_of(&rows)[3][3].is_sign_negative());

        // Of which columns there are more is for the whole table, whatever came first.
        let mut other_way = table(&[mixed.clone()]);
        other_way.extend(&packed);
        let mut joined = packed.clone();
        joined.extend(&packed);
        joined.extend(&other_way);
        assert_eq!(rows_of(&joined), [&bits[..], &bits[..], &[mixed], &bits[..]].concat());

        let mut all = packed.clone();
        all.push(&[0.5; 10]);
        assert_eq!((rows_of(&all), all.others.len()), ([&bits[..], &[vec![0.5; 10]]].concat(), 10));
        all.extend(&rows);
        assert_eq!(rows_of(&all)[4..], with_mixed);
    }

    #[test]
    fn a_table_that_contradicts_itself_is_not_received() {
        let received = |width: usize, len: usize, bits: usize, others: &[usize], values: usize| {
            let parts = (width, len, vec![0_u8; bits], others.to_vec(), vec![0.0_f32; values]);
            postcard::from_bytes::<CompactRows>(&postcard::to_stdvec(&parts).unwrap())
        };
        // Ten bits take two bytes per row.
        assert!(received(10, 2, 4, &[], 0).is_ok());
        assert!(received(10, 2, 4, &[0, 9], 4).is_ok());
        for (width, len) in [(10, 3), (17, 2), (10, usize::MAX), (0, 5)] {
            assert!(received(width, len, 4, &[], 0).is_err(), "{len} rows of {width}");
        }
        assert!(received(0, 1 << 60, 0, &[], 0).is_err());
        for (others, values) in [(&[10][..], 2), (&[9, 0], 4), (&[4, 4], 4), (&[4], 3)] {
            assert!(received(10, 2, 4, others, values).is_err(), "{others:?}");
        }
    }
}
