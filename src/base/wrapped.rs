//! Text in lines of a limited length.

/// Breaks a text at blanks into lines of at most `characters` characters, if its words are not longer.
pub fn wrapped(text: &str, characters: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_broken_at_blanks() {
        assert_eq!(wrapped("DIALS F=1M", 29), ["DIALS F=1M"]);
        assert_eq!(
            wrapped("DIALS F=1M, local_simulators.copies=1, ppo.clip=0.2", 29),
            ["DIALS F=1M,", "local_simulators.copies=1,", "ppo.clip=0.2"]
        );
    }
}
