//! Errors of files in TOML and JSON in plain words. Their readers speak of Rust's types.

/// Rust's whole numbers.
const WHOLE: [&str; 4] = ["u64", "u32", "u16", "usize"];

/// Returns the message of an error in plain words: what was found, and what is allowed.
pub fn in_plain_words(message: &str) -> String {
    let message = WHOLE.iter().fold(message.to_owned(), |message, kind| {
        message.replace(&format!("expected {kind}"), "expected a whole number such as 1000000 or 1e6")
    });
    let Some((before, rest)) = message.split_once("unknown variant ") else { return message };
    let Some((found, allowed)) = rest.split_once(", expected ") else { return message };
    let allowed = allowed.strip_prefix("one of ").unwrap_or(allowed);
    format!("{before}{found} is no allowed value; allowed: {allowed}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_value_is_told_with_those_that_are_allowed() {
        let several = "line 1\nunknown variant `c`, expected one of `a`, `b`, `d`\n";
        assert_eq!(in_plain_words(several), "line 1\n`c` is no allowed value; allowed: `a`, `b`, `d`\n");
        let two = "unknown variant `c`, expected `a` or `b`";
        assert_eq!(in_plain_words(two), "`c` is no allowed value; allowed: `a` or `b`");
        assert_eq!(in_plain_words("unknown field `c`, expected `a`"), "unknown field `c`, expected `a`");
    }
}
