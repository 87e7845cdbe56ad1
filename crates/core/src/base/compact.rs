//! Rows of numbers that are mostly bits, in an eighth of a byte each.

use serde::{Deserialize, Serialize};

/// A growing table of f32 rows. It takes one bit per entry while all entries are 0 or 1, as in the d-sets (inputs of
/// influence predictors) of both of the paper's domains. From the first other entry on, it takes four bytes per
/// entry. Either way the values are exact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WrittenRows")]
pub struct CompactRows {
    width: usize,
    len: usize,
    entries: Entries,
}

/// Rows as they are read, not yet checked.
#[derive(Deserialize)]
struct WrittenRows {
    width: usize,
    len: usize,
    entries: Entries,
}

impl TryFrom<WrittenRows> for CompactRows {
    type Error = String;

    fn try_from(WrittenRows { width, len, entries }: WrittenRows) -> Result<Self, String> {
        let (each, has) = match &entries {
            Entries::Bits(bits) => (width.div_ceil(8), bits.len()),
            Entries::Values(values) => (width, values.len()),
        };
        match each.checked_mul(len) == Some(has) && (width > 0 || len == 0) {
            true => Ok(CompactRows { width, len, entries }),
            false => Err(format!("{has} entries do not make {len} rows of {width}")),
        }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Entries {
    /// Bits; each row begins with a new byte.
    Bits(Vec<u8>),
    Values(Vec<f32>),
}

impl CompactRows {
    pub fn new(width: usize) -> Self {
        CompactRows { width, len: 0, entries: Entries::Bits(Vec::new()) }
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
        if !row.iter().all(|&entry| entry == 0.0 || entry == 1.0) {
            self.unpack();
        }
        match &mut self.entries {
            Entries::Bits(bits) => bits.extend(row.chunks(8).map(|entries| {
                entries.iter().enumerate().fold(0, |byte, (i, &entry)| byte | (u8::from(entry == 1.0) << i))
            })),
            Entries::Values(values) => values.extend_from_slice(row),
        }
        self.len += 1;
    }

    /// Copies a row to `out`, `[width]`.
    pub fn read(&self, row: usize, out: &mut [f32]) {
        assert!(row < self.len, "row {row} of {}", self.len);
        match &self.entries {
            Entries::Bits(bits) => {
                let bytes = self.width.div_ceil(8);
                for (entries, byte) in out.chunks_mut(8).zip(&bits[row * bytes..]) {
                    entries.iter_mut().enumerate().for_each(|(i, entry)| *entry = f32::from(byte >> i & 1));
                }
            }
            Entries::Values(values) => out.copy_from_slice(&values[row * self.width..(row + 1) * self.width]),
        }
    }

    pub fn extend(&mut self, other: &CompactRows) {
        assert_eq!(other.width, self.width, "rows of a different width");
        match (&mut self.entries, &other.entries) {
            (Entries::Bits(mine), Entries::Bits(theirs)) => {
                mine.extend_from_slice(theirs);
                self.len += other.len;
            }
            _ => {
                let mut row = vec![0.0; self.width];
                for i in 0..other.len {
                    other.read(i, &mut row);
                    self.push(&row);
                }
            }
        }
    }

    fn unpack(&mut self) {
        if let Entries::Bits(_) = self.entries {
            let mut values = vec![0.0; self.len * self.width];
            values.chunks_exact_mut(self.width).enumerate().for_each(|(i, row)| self.read(i, row));
            self.entries = Entries::Values(values);
        }
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

    #[test]
    fn bits_and_other_numbers_come_back_as_they_were() {
        let bits = [vec![1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0], vec![0.0; 10], vec![1.0; 10]];
        let mut rows = CompactRows::new(10);
        bits.iter().for_each(|row| rows.push(row));
        assert!(matches!(&rows.entries, Entries::Bits(bytes) if bytes.len() == 6));
        assert_eq!(rows_of(&rows), bits);

        let packed = rows.clone();
        rows.push(&[0.5; 10]);
        let with_values = [&bits[..], &[vec![0.5; 10]]].concat();
        assert_eq!(rows_of(&rows), with_values);

        let mut joined = packed.clone();
        joined.extend(&packed);
        joined.extend(&rows);
        assert_eq!(rows_of(&joined), [&bits[..], &bits[..], &with_values[..]].concat());
    }

    #[test]
    fn a_table_that_contradicts_itself_is_not_received() {
        let received = |width: usize, len: usize, entries: Entries| {
            let parts = postcard::to_stdvec(&(width, len, entries)).unwrap();
            postcard::from_bytes::<CompactRows>(&parts)
        };
        // Ten bits take two bytes per row.
        assert!(received(10, 2, Entries::Bits(vec![0; 4])).is_ok());
        for (width, len) in [(10, 3), (17, 2), (10, usize::MAX), (0, 5)] {
            assert!(received(width, len, Entries::Bits(vec![0; 4])).is_err(), "{len} rows of {width}");
        }
        assert!(received(0, 1 << 60, Entries::Values(Vec::new())).is_err());
    }
}
