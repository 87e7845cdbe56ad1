//! Rows of numbers that are mostly 0 and 1, in a bit or two each.

use serde::{Deserialize, Serialize};

/// A growing table of f32 rows. An entry takes one bit while all entries are 0 or 1, as in the d-sets (inputs of influence predictors)
/// of both of the paper's domains. From the first other number on, an entry takes two bits, and each other number four bytes more:
/// most entries of a scenario's d-sets are 0. Either way the values are exact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WrittenRows")]
pub struct CompactRows {
    width: usize,
    len: usize,
    /// Which entries are 1; each row begins with a new byte.
    ones: Vec<u8>,
    /// `None`: all entries are 0 or 1.
    others: Option<Others>,
}

/// The numbers in a table that are neither 0 nor 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Others {
    /// Where they are, in the form of the ones.
    marks: Vec<u8>,
    /// Row by row.
    values: Vec<f32>,
    /// Where the values of each row end.
    ends: Vec<usize>,
}

/// Rows as they are read, not yet checked.
#[derive(Deserialize)]
struct WrittenRows {
    width: usize,
    len: usize,
    ones: Vec<u8>,
    others: Option<Others>,
}

impl TryFrom<WrittenRows> for CompactRows {
    type Error = String;

    fn try_from(WrittenRows { width, len, ones, others }: WrittenRows) -> Result<Self, String> {
        let bytes = width.div_ceil(8);
        let is_whole = bytes.checked_mul(len) == Some(ones.len()) && (width > 0 || len == 0);
        if is_whole && others.as_ref().is_none_or(|others| others.are_of(len, width)) {
            Ok(CompactRows { width, len, ones, others })
        } else {
            Err(format!("{} bytes of bits, with other numbers, do not make {len} rows of {width}", ones.len()))
        }
    }
}

impl Others {
    /// Returns whether they belong to a table of this size.
    fn are_of(&self, len: usize, width: usize) -> bool {
        let Others { marks, values, ends } = self;
        let bytes = width.div_ceil(8);
        if marks.len() != bytes * len || ends.len() != len || ends.last().copied().unwrap_or(0) != values.len() {
            return false;
        }
        let begins = [0].iter().chain(ends);
        begins.zip(ends).enumerate().all(|(row, (&begin, &end))| {
            let row = &marks[row * bytes..(row + 1) * bytes];
            let marked: usize = row.iter().map(|byte| byte.count_ones() as usize).sum();
            // Behind the last column there is nothing.
            let is_within = row.last().is_none_or(|last| last.leading_zeros() as usize >= 8 * bytes - width);
            is_within && end.checked_sub(begin) == Some(marked)
        })
    }
}

fn is_other(entry: f32) -> bool {
    entry.to_bits() != 0 && entry != 1.0
}

/// Returns a row of bits.
fn bits(row: &[f32], is_set: impl Fn(f32) -> bool) -> impl Iterator<Item = u8> {
    row.chunks(8).map(move |entries| {
        entries.iter().enumerate().fold(0, |byte, (i, &entry)| byte | (u8::from(is_set(entry)) << i))
    })
}

impl CompactRows {
    pub fn new(width: usize) -> Self {
        CompactRows { width, len: 0, ones: Vec::new(), others: None }
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
        if self.others.is_none() && row.iter().any(|&entry| is_other(entry)) {
            self.with_others();
        }
        self.ones.extend(bits(row, |entry| entry == 1.0));
        if let Some(Others { marks, values, ends }) = &mut self.others {
            marks.extend(bits(row, is_other));
            values.extend(row.iter().filter(|&&entry| is_other(entry)));
            ends.push(values.len());
        }
        self.len += 1;
    }

    /// Copies a row to `out`, `[width]`.
    pub fn read(&self, row: usize, out: &mut [f32]) {
        assert!(row < self.len, "row {row} of {}", self.len);
        let begin = row * self.width.div_ceil(8);
        for (entries, byte) in out.chunks_mut(8).zip(&self.ones[begin..]) {
            entries.iter_mut().enumerate().for_each(|(i, entry)| *entry = f32::from(byte >> i & 1));
        }
        let Some(Others { marks, values, ends }) = &self.others else { return };
        let first = if row == 0 { 0 } else { ends[row - 1] };
        let mut values = values[first..ends[row]].iter();
        for (entries, &byte) in out.chunks_mut(8).zip(&marks[begin..]).filter(|(_, byte)| **byte != 0) {
            let marked = entries.iter_mut().enumerate().filter(|(i, _)| byte >> i & 1 == 1);
            marked.zip(&mut values).for_each(|((_, entry), &value)| *entry = value);
        }
    }

    pub fn extend(&mut self, other: &CompactRows) {
        assert_eq!(other.width, self.width, "rows of a different width");
        if other.others.is_some() {
            self.with_others();
        }
        self.ones.extend_from_slice(&other.ones);
        self.len += other.len;
        if let Some(Others { marks, values, ends }) = &mut self.others {
            let begun = values.len();
            match &other.others {
                Some(theirs) => {
                    marks.extend_from_slice(&theirs.marks);
                    values.extend_from_slice(&theirs.values);
                    ends.extend(theirs.ends.iter().map(|end| begun + end));
                }
                None => {
                    marks.resize(marks.len() + other.ones.len(), 0);
                    ends.resize(ends.len() + other.len, begun);
                }
            }
        }
    }

    /// Gives the table room for other numbers.
    fn with_others(&mut self) {
        self.others.get_or_insert_with(|| Others {
            marks: vec![0; self.ones.len()],
            values: Vec::new(),
            ends: vec![0; self.len],
        });
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
        assert_eq!((packed.ones.len(), &packed.others), (6, &None));
        assert_eq!(rows_of(&packed), bits);

        // Two other numbers; a minus before a 0 is one.
        let mut mixed = vec![1.0; 10];
        (mixed[9], mixed[3]) = (0.25, -0.0);
        let with_mixed = [&bits[..], &[mixed.clone()], &bits[..]].concat();
        let rows = table(&with_mixed);
        assert_eq!(rows.others.as_ref().unwrap().values.len(), 2);
        assert_eq!(rows_of(&rows), with_mixed);
        assert!(rows_of(&rows)[3][3].is_sign_negative());

        // Whatever comes first.
        let mut joined = table(&[mixed.clone()]);
        joined.extend(&packed);
        joined.extend(&rows);
        assert_eq!(rows_of(&joined), [&[mixed.clone()], &bits[..], &with_mixed[..]].concat());
        let mut joined = packed.clone();
        joined.extend(&packed);
        joined.extend(&table(&[mixed.clone()]));
        joined.push(&[0.5; 10]);
        assert_eq!(rows_of(&joined), [&bits[..], &bits[..], &[mixed, vec![0.5; 10]]].concat());
        assert_eq!(joined, table(&rows_of(&joined)));
        let sent = postcard::to_stdvec(&joined).unwrap();
        assert_eq!(postcard::from_bytes::<CompactRows>(&sent).unwrap(), joined);
    }

    #[test]
    fn a_table_that_contradicts_itself_is_not_received() {
        let received = |width: usize, len: usize, ones: usize, others: Option<Others>| {
            let parts = (width, len, vec![0_u8; ones], others);
            postcard::from_bytes::<CompactRows>(&postcard::to_stdvec(&parts).unwrap())
        };
        // Ten bits take two bytes per row.
        assert!(received(10, 2, 4, None).is_ok());
        for (width, len) in [(10, 3), (17, 2), (10, usize::MAX), (0, 5)] {
            assert!(received(width, len, 4, None).is_err(), "{len} rows of {width}");
        }
        assert!(received(0, 1 << 60, 0, None).is_err());
        let others = |marks: &[u8], values: usize, ends: &[usize]| {
            Some(Others { marks: marks.to_vec(), values: vec![0.5; values], ends: ends.to_vec() })
        };
        assert!(received(10, 2, 4, others(&[1, 2, 0, 0], 2, &[2, 2])).is_ok());
        for wrong in [
            others(&[1, 2, 0, 0], 3, &[2, 3]),
            others(&[1, 2, 0, 0], 2, &[1, 2]),
            others(&[1, 2, 0, 0], 2, &[2, 1]),
            others(&[1, 2, 0, 0], 2, &[2]),
            others(&[1, 2, 0], 2, &[2, 2]),
            others(&[1, 4, 0, 0], 2, &[2, 2]),
        ] {
            assert!(received(10, 2, 4, wrong.clone()).is_err(), "{wrong:?}");
        }
    }
}
