//! Text for a terminal, line by line: for `describe` and `nets inspect`.

use std::fmt::{Display, Write};

use dials_core::base::for_terminal;

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

    pub(super) fn table<const N: usize>(&mut self, rows: Vec<[String; N]>) {
        let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: [usize; N] = std::array::from_fn(width);
        for row in &rows {
            let cells = row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}"));
            self.line(format_args!("    {}", cells.collect::<Vec<_>>().join("  ").trim_end()));
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
