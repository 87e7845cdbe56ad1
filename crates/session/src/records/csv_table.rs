//! A CSV file of a run directory, read by the names of its columns.
//!
//! A file may have more columns than a reader needs. A value that is missing is `None`. Everything else that this program
//! never writes is an error that names the file, the line and the column: NaN and infinity, numbers that are no figures
//! of a run, and an empty field in a column that must have a number.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use csv::StringRecord;

use super::columns::{self, ALL};
use dials_core::outside::{excerpt, read_text};

/// Largest file. That of a run with 100 agents and 40 000 evaluations is smaller.
pub(crate) const LARGEST_FILE: u64 = 256 << 20;
/// Longest line in bytes. A line has a few dozen numbers.
const LONGEST_LINE: usize = 64 << 10;
/// Largest figure of a run, without its sign. Nothing that is measured is larger, and its square is a number still.
pub(crate) const LARGEST: f64 = 1e15;
const WAY_OUT: &str = "the file is damaged: copy it again, or train again";

pub(crate) struct CsvTable {
    path: PathBuf,
    columns: BTreeMap<String, usize>,
    lines: Vec<StringRecord>,
}

impl CsvTable {
    /// Reads a file; a missing one has no lines. An unfinished last line does not count: it may still be written.
    pub(crate) fn read(path: &Path) -> Result<CsvTable> {
        let text = match read_text(path, LARGEST_FILE) {
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            text => text.with_context(|| format!("{}: cannot be read", path.display()))?,
        };
        let table = CsvTable::from_text(path, &text)?;
        let is_ours = table.columns.is_empty() || table.columns.contains_key(columns::STEPS);
        ensure!(is_ours, "{}: has no column `{}`; {WAY_OUT}", path.display(), columns::STEPS);
        Ok(table)
    }

    /// Reads a text. `path`: the file that errors name.
    fn from_text(path: &Path, text: &str) -> Result<CsvTable> {
        let failed = || format!("{}: cannot be read", path.display());
        let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
        if let Some(long) = whole.split('\n').position(|line| line.len() > LONGEST_LINE) {
            bail!("{}: line {} has more than {LONGEST_LINE} bytes; {WAY_OUT}", path.display(), long + 1);
        }
        let mut reader = csv::Reader::from_reader(whole.as_bytes());
        let mut columns = BTreeMap::new();
        for (index, name) in reader.headers().with_context(failed)?.iter().enumerate() {
            let before = columns.insert(name.to_owned(), index);
            ensure!(before.is_none(), "{}: has two columns `{}`; {WAY_OUT}", path.display(), excerpt(name));
        }
        let lines = reader.records().collect::<Result<_, _>>().with_context(failed)?;
        Ok(CsvTable { path: path.to_owned(), columns, lines })
    }

    #[cfg(test)]
    pub(super) fn of(text: &str) -> CsvTable {
        CsvTable::from_text(Path::new("t.csv"), text).expect("a test knows what it makes up")
    }

    pub(crate) fn lines(&self) -> impl Iterator<Item = TableLine<'_>> {
        self.lines.iter().map(|fields| TableLine { table: self, fields })
    }

    /// Returns the lines in blocks: each the line with `all` in `column`, and those of single agents or workers.
    pub(crate) fn blocks(&self, column: &str) -> Vec<Vec<TableLine<'_>>> {
        let lines: Vec<TableLine<'_>> = self.lines().collect();
        lines.chunk_by(|_, next| next.text(column) != Some(ALL)).map(<[_]>::to_vec).collect()
    }
}

#[derive(Clone, Copy)]
pub(crate) struct TableLine<'a> {
    table: &'a CsvTable,
    fields: &'a StringRecord,
}

impl<'a> TableLine<'a> {
    /// Returns the text in a column. If there is no such column, or nothing in it: `None`.
    pub(crate) fn text(self, column: &str) -> Option<&'a str> {
        self.fields.get(*self.table.columns.get(column)?).filter(|text| !text.is_empty())
    }

    /// Returns whether the line is of all agents, workers or processes: `all` is in `column`.
    pub(crate) fn is_of_all(self, column: &str) -> bool {
        self.text(column) == Some(ALL)
    }

    /// Returns [`TableLine::text`] as a figure; an error if it is none.
    pub(crate) fn number(self, column: &str) -> Result<Option<f64>> {
        let Some(text) = self.text(column) else { return Ok(None) };
        let number: f64 = text.parse().ok().with_context(|| self.bad(column, text, "not a number"))?;
        ensure!(number.is_finite(), self.bad(column, text, "not a finite number"));
        ensure!(number.abs() <= LARGEST, self.bad(column, text, "too large for a figure of a run"));
        Ok(Some(number))
    }

    pub(crate) fn required(self, column: &str) -> Result<f64> {
        self.number(column)?.with_context(|| self.nothing(column))
    }

    /// Returns [`TableLine::text`] as a whole number; an error if it is none, or too large to count anything.
    pub(crate) fn whole(self, column: &str) -> Result<Option<u64>> {
        let Some(text) = self.text(column) else { return Ok(None) };
        let number = text.parse().ok().filter(|&number: &u64| number as f64 <= LARGEST);
        let what = || self.bad(column, text, &format!("not a whole number from 0 to {LARGEST}"));
        number.map(Some).with_context(what)
    }

    pub(crate) fn required_whole(self, column: &str) -> Result<u64> {
        self.whole(column)?.with_context(|| self.nothing(column))
    }

    /// Returns the timesteps per agent, with which every line begins.
    pub(crate) fn steps(self) -> Result<u64> {
        self.required_whole(columns::STEPS)
    }

    /// Returns an error about the value in a column. `what`: what it is.
    pub(crate) fn bad(self, column: &str, text: &str, what: &str) -> String {
        format!("{}: `{column}` holds \"{}\", which is {what}; {WAY_OUT}", self.place(), excerpt(text))
    }

    fn nothing(self, column: &str) -> String {
        format!("{}: has no `{column}`; {WAY_OUT}", self.place())
    }

    /// Returns file and line; the header is line 1.
    fn place(self) -> String {
        let number = self.fields.position().map_or(0, |position| position.line());
        format!("{}: line {number}", self.table.path.display())
    }
}

/// The order of steps in a file: they never go back.
#[derive(Default)]
pub(crate) struct Order(Option<u64>);

impl Order {
    /// Returns the steps of the next line. They may be those of the line before.
    pub(crate) fn next(&mut self, line: TableLine) -> Result<u64> {
        self.after(line, |last, steps| last <= steps)
    }

    /// Returns the steps of the next line, which must be later than those of the line before.
    pub(crate) fn later(&mut self, line: TableLine) -> Result<u64> {
        self.after(line, |last, steps| last < steps)
    }

    fn after(&mut self, line: TableLine, in_order: fn(u64, u64) -> bool) -> Result<u64> {
        let steps = line.steps()?;
        if let Some(last) = self.0.replace(steps) {
            let what = format!("not later than {last} before it");
            ensure!(in_order(last, steps), line.bad(columns::STEPS, &steps.to_string(), &what));
        }
        Ok(steps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_counts_is_whole_and_not_absurd() {
        for text in ["-1", "1.5", "1e3", "18446744073709551615", "NaN"] {
            let table = CsvTable::of(&format!("steps,mean\n10,{text}\n"));
            let error = table.lines().next().unwrap().whole("mean").unwrap_err().to_string();
            let what = "not a whole number from 0 to 1000000000000000";
            assert!(error.starts_with(&format!("t.csv: line 2: `mean` holds \"{text}\", which is {what};")), "{error}");
        }
    }

    #[test]
    fn a_last_line_that_does_not_end_is_none() {
        let steps = |text| CsvTable::of(text).lines().map(|line| line.steps().unwrap()).collect::<Vec<_>>();
        assert_eq!(steps("steps,mean\n10,1.5\n20,1"), [10], "it could be 2, 20 or 200 000");
        assert_eq!(steps("steps,mean\n10,1.5\n20,1\n"), [10, 20]);
        assert!(steps("ste").is_empty());
    }

    #[test]
    fn what_is_no_table_is_refused_in_a_few_words() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        for (text, message) in [
            ("steps,steps\n1,2\n", "has two columns `steps`"),
            ("steps,mean\n1,2\n1\n", "found record with 1 fields"),
            ("{\n", "has no column `steps`; the file is damaged: copy it again, or train again"),
        ] {
            std::fs::write(&path, text).unwrap();
            let error = format!("{:#}", CsvTable::read(&path).err().unwrap());
            assert!(error.contains(message), "{error}");
        }
        let table = CsvTable::of(&format!("steps,mean\n1,{}x\n", "9".repeat(1000)));
        let error = table.lines().next().unwrap().required("mean").unwrap_err().to_string();
        assert!(error.contains("999...\", which is not a number") && error.len() < 300, "{error}");
    }
}
