//! Blocks of lines of CSV files.

use anyhow::{Context, Result};

/// Returns lines as the text of a CSV file, after the header if the file is `new`.
pub fn block(header: &[String], lines: &[Vec<String>], new: bool) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    if new {
        writer.write_record(header)?;
    }
    lines.iter().try_for_each(|line| writer.write_record(line))?;
    writer.into_inner().context("a CSV block in memory")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_first_block_has_the_header() {
        let line = |text: &str| vec![text.to_owned(), "b,c".to_owned()];
        let text = |new| String::from_utf8(block(&line("x"), &[line("1"), line("2")], new).unwrap()).unwrap();
        assert_eq!(text(true), "x,\"b,c\"\n1,\"b,c\"\n2,\"b,c\"\n");
        assert_eq!(text(false), "1,\"b,c\"\n2,\"b,c\"\n");
    }
}
