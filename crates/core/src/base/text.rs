//! Figures, lines and lists for people.

const MOST_DIGITS: f64 = 4.0;

/// Columns of the narrowest terminal that messages are written for.
pub const TERMINAL_COLUMNS: usize = 80;

/// Columns by which the further lines of a broken line are indented.
const INDENT: usize = 2;

/// Returns a number with its noun: `1 run`, `2 runs`. `noun`: one whose plural ends in `s`.
pub fn counted(number: usize, noun: &str) -> String {
    format!("{number} {noun}{}", if number == 1 { "" } else { "s" })
}

/// Returns the first item that equals an earlier one; `None` if all differ.
pub fn repeated<T: PartialEq>(items: &[T]) -> Option<&T> {
    (0..items.len()).find(|&place| items[..place].contains(&items[place])).map(|place| &items[place])
}

/// Returns the number of digits after the point of a figure and of the half-width of its interval, if that is known.
///
/// Returns of traffic on the paper's grids, from 50 on, have one. Smaller figures have two, and more if two digits of
/// the half-width would not be seen otherwise. Figures below 5 without an interval have three.
pub fn decimals(figure: f64, half_width: Option<f64>) -> usize {
    let size = figure.abs();
    match half_width {
        _ if size >= 50.0 => 1,
        Some(half_width) if half_width > 0.0 => (1.0 - half_width.log10().floor()).clamp(2.0, MOST_DIGITS) as usize,
        // Counts that are the same in all episodes need no more.
        Some(0.0) => 2,
        _ if 0.0 < size && size < 5.0 => 3,
        _ => 2,
    }
}

/// Breaks a label at blanks into lines of at most `characters` characters, if its words are not longer.
pub fn wrapped(label: &str, characters: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in label.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= characters => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Breaks a line so that it fits a terminal of 80 columns, if its words do. The further lines are indented.
pub fn for_terminal(line: &str) -> String {
    if line.chars().count() <= TERMINAL_COLUMNS {
        return line.to_owned();
    }
    let words = line.trim_start_matches(' ');
    let margin = " ".repeat(line.len() - words.len());
    let lines = wrapped(words, TERMINAL_COLUMNS - margin.len() - INDENT);
    format!("{margin}{}", lines.join(&format!("\n{margin}{}", " ".repeat(INDENT))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_figures_have_more_digits_and_those_near_200_have_one() {
        assert_eq!([217.44, -60.0, 13.09, -1.04, 0.0].map(|figure| decimals(figure, None)), [1, 1, 2, 3, 2]);
        assert_eq!(decimals(217.44, Some(0.01)), 1);
        // Two digits of the half-width: 2.3, 0.11, 0.012, 0.0012, and no more than four.
        let widths = [2.3, 0.11, 0.012, 0.0012, 0.00012];
        assert_eq!(widths.map(|width| decimals(-1.04, Some(width))), [2, 2, 3, 4, 4]);
        assert_eq!([0.0, f64::NAN, f64::INFINITY].map(|width| decimals(-1.04, Some(width))), [2, 3, 2]);
    }

    #[test]
    fn a_line_fits_a_terminal_and_keeps_its_words_and_its_margin() {
        let short = "  a b  c";
        assert_eq!(for_terminal(short), short);
        let long = format!("  {}", ["word"; 40].join(" "));
        let broken = for_terminal(&long);
        let lines: Vec<&str> = broken.lines().collect();
        assert!(lines.len() == 3 && lines.iter().all(|line| line.len() <= 80), "{broken}");
        assert!(lines[0].starts_with("  word") && lines[1].starts_with("    word"), "{broken}");
        assert_eq!(broken.split_whitespace().count(), 40);
        assert_eq!(for_terminal(&"x".repeat(100)), "x".repeat(100), "a word stays whole");
    }
}
