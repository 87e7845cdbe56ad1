//! Names that a mistyped name may have meant.

use super::Printable;

/// Largest number of names that are returned.
const MOST: usize = 3;

/// Returns the known names that are most like `name`: those with few other letters, and those that hold it. The most
/// alike comes first; there may be none.
fn alike<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let small = name.to_lowercase();
    let far = 1 + name.chars().count() / 4;
    let rated = known.into_iter().map(|other| {
        let other_small = other.to_lowercase();
        let holds = !small.is_empty() && other_small.contains(&small);
        (distance(&small, &other_small), holds, other)
    });
    let mut near: Vec<(usize, bool, &str)> = rated.filter(|(distance, holds, _)| *holds || *distance <= far).collect();
    near.sort();
    near.into_iter().map(|(_, _, other)| other).take(MOST).collect()
}

/// Returns what an error about an unknown name adds: the names that it may have meant, such as ` (did you mean `a` or
/// `b`?)`; or nothing.
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let near: Vec<String> = alike(name, known).iter().map(|other| format!("`{}`", Printable(other))).collect();
    if near.is_empty() { String::new() } else { format!(" (did you mean {}?)", near.join(" or ")) }
}

/// Returns the number of letters to insert, remove or replace that make one text of another.
fn distance(one: &str, other: &str) -> usize {
    let other: Vec<char> = other.chars().collect();
    let mut row: Vec<usize> = (0..=other.len()).collect();
    for (before, letter) in one.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = before + 1;
        for (place, &known) in other.iter().enumerate() {
            let replaced = diagonal + usize::from(letter != known);
            diagonal = row[place + 1];
            row[place + 1] = replaced.min(diagonal + 1).min(row[place] + 1);
        }
    }
    row[other.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_with_few_other_letters_are_alike_and_so_are_those_that_hold_it() {
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(alike("B2", ["b2", "a1", "b22", "gneJ207"]), ["b2", "b22"]);
        assert_eq!(alike("207", ["gneJ207", "gneJ143"]), ["gneJ207"]);
        assert_eq!(alike("x", ["a2", "a4"]), [""; 0]);
        assert_eq!(alike("", ["a", "bc"]), ["a"]);
        assert_eq!(did_you_mean("B2", ["b2", "b22"]), " (did you mean `b2` or `b22`?)");
        assert_eq!(did_you_mean("x", ["a2"]), "");
    }
}
