//! Text in lines of a limited width.

/// Columns of the narrowest terminal that messages are written for.
pub const TERMINAL_COLUMNS: usize = 80;
/// Columns by which the further lines of a broken line are indented.
const INDENT: usize = 2;

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
    fn long_labels_are_broken_at_blanks() {
        assert_eq!(wrapped("DIALS F=1M", 29), ["DIALS F=1M"]);
        assert_eq!(
            wrapped("DIALS F=1M, local_simulators.copies=1, ppo.clip=0.2", 29),
            ["DIALS F=1M,", "local_simulators.copies=1,", "ppo.clip=0.2"]
        );
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
