//! Lists of names and tables as plain text, for `describe` and `nets inspect`.

use std::fmt::{Display, Write};

use dials_core::base::for_terminal;

/// Writes the names of columns, a line for neighbours that differ only in the number at the end.
pub(super) fn list_columns(text: &mut String, names: &[String]) {
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
    aligned(text, rows);
}

/// Writes rows as columns of equal width.
pub(super) fn aligned<const N: usize>(text: &mut String, rows: Vec<[String; N]>) {
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; N] = std::array::from_fn(width);
    for row in &rows {
        let cells = row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}"));
        line(text, format_args!("    {}", cells.collect::<Vec<_>>().join("  ").trim_end()));
    }
}

pub(super) fn line(text: &mut String, words: impl Display) {
    writeln!(text, "{words}").expect("a text takes what is written to it");
}

/// Writes a line of words, broken where it does not fit a terminal.
pub(super) fn paragraph(text: &mut String, words: impl Display) {
    line(text, for_terminal(&words.to_string()));
}
