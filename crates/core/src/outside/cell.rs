//! Names as fields of a CSV file.

use super::Printable;

/// Returns a name as the field of a CSV file: printable, and never a formula.
///
/// A spreadsheet takes a field for a formula if it begins with one of these characters. With a `'` before it, it is
/// text. Numbers are not names: they are written as they are.
pub fn csv_name(name: &str) -> String {
    let name = Printable(name).to_string();
    if name.starts_with(['=', '+', '-', '@']) { format!("'{name}") } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_looks_like_a_formula_is_marked_as_text() {
        for (name, field) in [
            ("=cmd()", "'=cmd()"),
            ("+1", "'+1"),
            ("-1", "'-1"),
            ("@SUM(A1)", "'@SUM(A1)"),
            ("\t=1", "\\t=1"),
            ("\r=1", "\\r=1"),
            ("fixed-time:green=10", "fixed-time:green=10"),
            ("DIALS F=1M", "DIALS F=1M"),
            ("", ""),
        ] {
            assert_eq!(csv_name(name), field);
        }
    }
}
