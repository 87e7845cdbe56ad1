//! Names that a mistyped name may have meant.

use strsim::levenshtein;

use super::Printable;

const MOST: usize = 3;

/// Returns what an error about an unknown name adds: the known names that are most like it, such as ` (did you mean `a`
/// or `b`?)`. These are the names with few other letters, and those that hold it. If there are none: nothing.
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let small = name.to_lowercase();
    let far = 1 + name.chars().count() / 4;
    let rated = known.into_iter().map(|other| {
        let other_small = other.to_lowercase();
        let holds = !small.is_empty() && other_small.contains(&small);
        (levenshtein(&small, &other_small), holds, other)
    });
    let mut near: Vec<(usize, bool, &str)> = rated.filter(|(distance, holds, _)| *holds || *distance <= far).collect();
    near.sort();
    let words: Vec<String> = near.iter().take(MOST).map(|(_, _, other)| format!("`{}`", Printable(other))).collect();
    if words.is_empty() { String::new() } else { format!(" (did you mean {}?)", words.join(" or ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_with_few_other_letters_are_alike_and_so_are_those_that_hold_it() {
        for (name, known, words) in [
            ("B2", &["b2", "a1", "b22", "gneJ207"][..], " (did you mean `b2` or `b22`?)"),
            ("207", &["gneJ207", "gneJ143"], " (did you mean `gneJ207`?)"),
            ("", &["a", "bc"], " (did you mean `a`?)"),
            ("x", &["a2", "a4"], ""),
        ] {
            assert_eq!(did_you_mean(name, known.iter().copied()), words);
        }
    }
}
