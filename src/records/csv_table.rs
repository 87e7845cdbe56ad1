//! A CSV file of a run directory, read by the names of its columns.
//!
//! Files of other versions may have more columns, or fewer. What is missing is `None`.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use csv::StringRecord;

use super::columns;

pub struct CsvTable {
    path: PathBuf,
    columns: HashMap<String, usize>,
    lines: Vec<StringRecord>,
}

impl CsvTable {
    /// Reads a file; a missing file has no lines. An unfinished last line does not count: its writer was killed, or is
    /// still writing.
    pub fn read(path: &Path) -> Result<CsvTable> {
        let mut table = CsvTable { path: path.to_owned(), columns: HashMap::new(), lines: Vec::new() };
        if !path.exists() {
            return Ok(table);
        }
        let failed = || format!("{}: cannot be read", path.display());
        let text = std::fs::read_to_string(path).with_context(failed)?;
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let mut reader = csv::Reader::from_reader(&text.as_bytes()[..whole]);
        let header = reader.headers().with_context(failed)?;
        table.columns = header.iter().enumerate().map(|(index, name)| (name.to_owned(), index)).collect();
        table.lines = reader.records().collect::<csv::Result<_>>().with_context(failed)?;
        Ok(table)
    }

    pub fn lines(&self) -> impl Iterator<Item = TableLine<'_>> {
        self.lines.iter().map(|fields| TableLine { table: self, fields })
    }
}

#[derive(Clone, Copy)]
pub struct TableLine<'a> {
    table: &'a CsvTable,
    fields: &'a StringRecord,
}

impl<'a> TableLine<'a> {
    /// Returns the text in a column. If there is no such column, or nothing in it: `None`.
    pub fn text(self, column: &str) -> Option<&'a str> {
        let field = self.fields.get(*self.table.columns.get(column)?)?;
        (!field.is_empty()).then_some(field)
    }

    /// Returns [`TableLine::text`] as a number; an error if it is not a finite one.
    pub fn number(self, column: &str) -> Result<Option<f64>> {
        let Some(text) = self.text(column) else { return Ok(None) };
        let number: f64 = text.parse().with_context(|| self.bad(column, text, "not a number"))?;
        ensure!(number.is_finite(), self.bad(column, text, "not a finite number"));
        Ok(Some(number))
    }

    /// Returns a number that must be there.
    pub fn required(self, column: &str) -> Result<f64> {
        self.number(column)?.with_context(|| format!("{}: has no `{column}`", self.place()))
    }

    /// Returns the timesteps per agent, with which every line begins.
    pub fn steps(self) -> Result<u64> {
        Ok(self.required(columns::STEPS)? as u64)
    }

    fn bad(self, column: &str, text: &str, what: &str) -> String {
        format!("{}: `{column}` holds {text:?}, which is {what}", self.place())
    }

    /// Returns file and line; the header is line 1.
    fn place(self) -> String {
        let file = self.table.path.display();
        self.fields.position().map_or(file.to_string(), |position| format!("{file}: line {}", position.line()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> CsvTable {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        CsvTable::read(&path).unwrap()
    }

    #[test]
    fn columns_are_found_by_name_and_may_be_missing_or_empty() {
        let table = table("worker,steps,new\nall,10,\n");
        let line = table.lines().next().unwrap();
        assert_eq!((line.steps().unwrap(), line.text("worker"), line.text("new")), (10, Some("all"), None));
        assert_eq!(line.number("elapsed_s").unwrap(), None);
        let error = line.required("elapsed_s").unwrap_err().to_string();
        assert!(error.ends_with("t.csv: line 2: has no `elapsed_s`"), "{error}");
        let error = line.number("worker").unwrap_err().to_string();
        assert!(error.ends_with("t.csv: line 2: `worker` holds \"all\", which is not a number"), "{error}");
    }

    #[test]
    fn a_figure_that_is_no_finite_number_is_refused_with_its_line_and_its_column() {
        let table = table("steps,mean\n10,1.5\n20,NaN\n30,-inf\n40,1e999\n");
        let told: Vec<_> = table.lines().map(|line| line.required("mean").map_err(|error| error.to_string())).collect();
        assert_eq!(told[0], Ok(1.5));
        for (told, (line, text)) in told[1..].iter().zip([(3, "NaN"), (4, "-inf"), (5, "1e999")]) {
            let error = told.as_ref().unwrap_err();
            let expected = format!("t.csv: line {line}: `mean` holds {text:?}, which is not a finite number");
            assert!(error.ends_with(&expected), "{error}");
        }
    }

    #[test]
    fn a_last_line_that_does_not_end_is_none() {
        let steps = |text| table(text).lines().map(|line| line.steps().unwrap()).collect::<Vec<_>>();
        assert_eq!(steps("steps,mean\n10,1.5\n20,1"), [10], "it could be 2, 20 or 200 000");
        assert_eq!(steps("steps,mean\n10,1.5\n20,1\n"), [10, 20]);
        assert!(steps("ste").is_empty());
    }

    #[test]
    fn a_file_that_is_not_there_has_no_lines() {
        assert_eq!(CsvTable::read(Path::new("no/such.csv")).unwrap().lines().count(), 0);
    }
}
