//! Text for a terminal, line by line: for `describe` and `nets inspect`.

use std::fmt::{Display, Write};

use dials_core::base::for_terminal;

/// Letters of a first cell that stands in the line of its row. The id of a light of a real map may have 170.
const LONGEST_FIRST: usize = 40;

#[derive(Default)]
pub(super) struct Listing(String);

impl Listing {
    pub(super) fn line(&mut self, words: impl Display) {
        writeln!(self.0, "{words}").expect("a text takes what is written to it");
    }

    /// Writes a line of words, broken where it does not fit a terminal.
    pub(super) fn paragraph(&mut self, words: impl Display) {
        self.line(for_terminal(&words.to_string()));
    }

    /// Writes rows as a table. A first cell that is longer than [`LONGEST_FIRST`] has a line of its own.
    pub(super) fn table<const N: usize>(&mut self, rows: Vec<[String; N]>) {
        let letters = |row: &[String; N], column: usize| row[column].chars().count();
        let is_long = |row: &[String; N]| letters(row, 0) > LONGEST_FIRST;
        let width = |column: usize| {
            let rows = rows.iter().filter(|row| column > 0 || !is_long(row));
            rows.map(|row| letters(row, column)).max().unwrap_or(0)
        };
        let widths: [usize; N] = std::array::from_fn(width);
        for row in &rows {
            if is_long(row) {
                self.line(format_args!("    {}", row[0]));
            }
            let cells = row.iter().enumerate().zip(widths).map(|((column, cell), width)| {
                let cell = if column == 0 && is_long(row) { "" } else { cell };
                format!("{cell:width$}")
            });
            let line = cells.collect::<Vec<_>>().join("  ");
            if !line.trim().is_empty() {
                self.line(format_args!("    {}", line.trim_end()));
            }
        }
    }

    /// Writes the names of columns, a line for neighbours that differ only in the number at the end.
    pub(super) fn columns(&mut self, names: &[String]) {
        let stem = |name: &str| name.rsplit_once('[').map_or(name.to_owned(), |(stem, _)| stem.to_owned());
        let mut first = 0;
        let mut rows = Vec::new();
        for group in names.chunk_by(|one, other| stem(one) == stem(other)) {
            let last = first + group.len() - 1;
            let [begin, end] = [&group[0], &group[group.len() - 1]];
            rows.push(match group.len() {
                1 => [first.to_string(), begin.clone()],
                _ => [format!("{first}-{last}"), format!("{begin} to {}", &end[stem(end).len()..])],
            });
            first = last + 1;
        }
        self.table(rows);
    }

    pub(super) fn finish(self) -> String {
        self.0.trim_end().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_name_does_not_make_all_lines_long() {
        let long = "cluster_".repeat(9);
        let mut text = Listing::default();
        text.table([["light", "greens"], [&long, "4"], ["J", "12"]].map(|row| row.map(str::to_owned)).to_vec());
        assert_eq!(text.finish(), format!("    light  greens\n    {long}\n           4\n    J      12"));
    }
}
