//! Errors of files in TOML and JSON in plain words. Their readers speak of Rust's types.

use super::did_you_mean;

/// Rust's types, and what a person writes for one.
const NEEDED: [(&str, &str); 10] = [
    ("u64", WHOLE),
    ("u32", WHOLE),
    ("u16", WHOLE),
    ("usize", WHOLE),
    ("f64", "a number"),
    ("f32", "a number"),
    ("a boolean", "`true` or `false`"),
    ("a string", "a text in quotes"),
    ("a sequence", "a list such as [1, 2]"),
    ("a map", "a table"),
];
const WHOLE: &str = "a whole number such as 1000000";

/// The readers' words before a value, and ours.
const GIVEN: [(&str, &str); 6] = [
    ("string ", ""),
    ("integer ", ""),
    ("floating point ", ""),
    ("boolean ", ""),
    ("sequence", "a list"),
    ("map", "a table"),
];

/// Returns the message of an error in plain words: what was found, and what is allowed.
pub fn in_plain_words(message: &str) -> String {
    let found = |begin: &str| {
        let (before, rest) = message.split_once(begin)?;
        let (given, expected) = rest.split_once(", expected ")?;
        Some((before, given, expected))
    };
    if let Some((before, given, allowed)) = found("unknown variant ") {
        let allowed = allowed.strip_prefix("one of ").unwrap_or(allowed);
        return format!("{before}{given} is no allowed value; allowed: {allowed}");
    }
    if let Some((before, given, known)) = found("unknown field ") {
        // Every second piece is a name in backquotes. What follows the names says where it is.
        let names = known.lines().next().unwrap_or_default().split('`').skip(1).step_by(2);
        let near = did_you_mean(given.trim_matches('`'), names);
        return format!("{before}unknown field {given}{near}, expected {known}");
    }
    let Some((before, given, expected)) = found("invalid type: ").or_else(|| found("invalid value: ")) else {
        return message.to_owned();
    };
    // What follows says where it is.
    let (needed, place) = expected.split_at(expected.find('\n').unwrap_or(expected.len()));
    let plain = NEEDED.iter().find(|(kind, _)| *kind == needed).map(|&(_, plain)| plain);
    let needed = plain.unwrap_or(if needed.starts_with("struct ") { "a table" } else { needed });
    let without = |&(word, plain): &(&str, &str)| Some(format!("{plain}{}", given.strip_prefix(word)?));
    let given = GIVEN.iter().find_map(without).unwrap_or_else(|| given.to_owned());
    format!("{before}{given} is given, but {needed} is needed{place}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_stands_beside_what_is_needed() {
        for (message, plain) in [
            ("unknown variant `c`, expected `a` or `b`", "`c` is no allowed value; allowed: `a` or `b`"),
            ("unknown field `c`, expected `ab`", "unknown field `c`, expected `ab`"),
            (
                "unknown field `mingreen_s`, expected one of `seed`, `min_green_s`\nin `traffic`",
                "unknown field `mingreen_s` (did you mean `min_green_s`?), expected one of `seed`, `min_green_s`\nin `traffic`",
            ),
            (
                "invalid type: string \"a\", expected f64\nin `ppo.gamma`",
                "\"a\" is given, but a number is needed\nin `ppo.gamma`",
            ),
            (
                "invalid value: integer `-1`, expected u64",
                "`-1` is given, but a whole number such as 1000000 is needed",
            ),
            ("invalid type: sequence, expected a string\n", "a list is given, but a text in quotes is needed\n"),
            ("invalid type: map, expected a reward", "a table is given, but a reward is needed"),
            ("invalid type: integer `3`, expected struct PpoConfig", "`3` is given, but a table is needed"),
        ] {
            assert_eq!(in_plain_words(message), plain);
        }
    }
}
