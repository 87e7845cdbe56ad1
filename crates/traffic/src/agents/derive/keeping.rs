//! Lights that keep their program, and why.

use std::fmt;

use super::greens::MOST_GREENS;
use dials_core::base::counted;

const MOST_NAMES: usize = 5;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Keeping {
    pub light: String,
    pub why: Why,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Why {
    Excluded,
    Kind(String),
    /// A `<WAUT>` switches its programs at set times, whatever an agent does.
    Switched,
    NoLink,
    /// Neither passenger cars nor buses can come to it.
    NoCars,
    /// It has fewer than two greens, or too many: this number.
    Greens(usize),
}

/// Returns a sentence for each reason why lights keep their program, with the reason. Of many lights it names some.
pub fn sentences(keeping: &[Keeping]) -> Vec<(String, &Why)> {
    let mut groups: Vec<(&Why, Vec<&str>)> = Vec::new();
    for Keeping { light, why } in keeping {
        match groups.iter_mut().find(|(known, _)| *known == why) {
            Some((_, lights)) => lights.push(light),
            None => groups.push((why, vec![light])),
        }
    }
    let sentence = |(why, lights): (_, Vec<&str>)| match lights[..] {
        [light] => (format!("light `{light}` keeps its program: {why}"), why),
        _ => (format!("{} lights keep their program ({}), each because {why}", lights.len(), names(&lights)), why),
    };
    groups.into_iter().map(sentence).collect()
}

pub(super) fn names(lights: &[&str]) -> String {
    let named: Vec<String> = lights.iter().take(MOST_NAMES).map(|light| format!("`{light}`")).collect();
    let more = match lights.len().saturating_sub(MOST_NAMES) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    format!("{}{more}", named.join(", "))
}

impl Why {
    /// Returns the reason in a few words, for tables.
    pub fn short(&self) -> String {
        match self {
            Why::Excluded => "agents.toml".to_owned(),
            Why::Kind(_) => "type of program".to_owned(),
            Why::Switched => "WAUT".to_owned(),
            Why::NoLink => "no connection".to_owned(),
            Why::NoCars => "no cars".to_owned(),
            Why::Greens(greens) => counted(*greens, "green"),
        }
    }

    pub fn way_out(&self) -> &'static str {
        match self {
            Why::Excluded => "let it learn in agents.toml",
            Why::Kind(_) => "make its program static, with netconvert --tls.default-type static --tls.rebuild",
            Why::Switched => "choose one of its programs with --program, or remove its <wautJunction>",
            Why::NoLink => "control its connections in netedit",
            Why::NoCars => "allow cars on its lanes in netedit",
            Why::Greens(greens) if *greens > MOST_GREENS => "name its greens in agents.toml",
            Why::Greens(_) => {
                "give its program a second green in netedit, or name its greens in agents.toml; a dead \
                 end needs none"
            }
        }
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Why::Excluded => f.write_str("agents.toml says so"),
            Why::Kind(kind) => {
                write!(f, "its program is of type `{kind}`, which no agent can replace")
            }
            Why::Switched => f.write_str("a <WAUT> switches its programs at set times"),
            Why::NoLink => f.write_str("it controls no connection"),
            Why::NoCars => f.write_str("no lane for passenger cars or buses leads to it"),
            Why::Greens(0) => f.write_str("its program has no green"),
            Why::Greens(greens) if *greens > MOST_GREENS => {
                write!(f, "its program has more than {MOST_GREENS} greens, the limit")
            }
            Why::Greens(_) => f.write_str("its program has one green only, so there is nothing to choose"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_with_the_same_reason_share_a_sentence_and_at_most_five_are_named() {
        let keeping = |light: &str, why| Keeping { light: light.to_owned(), why };
        let mut all: Vec<Keeping> =
            ["a", "b", "c", "d", "e", "f", "g"].map(|light| keeping(light, Why::Greens(1))).into();
        all.insert(1, keeping("x", Why::NoCars));
        let message: Vec<String> = sentences(&all).into_iter().map(|(sentence, _)| sentence).collect();
        assert_eq!(
            message,
            [
                "7 lights keep their program (`a`, `b`, `c`, `d`, `e` and 2 more), each because its program has one \
                 green only, so there is nothing to choose",
                "light `x` keeps its program: no lane for passenger cars or buses leads to it",
            ]
        );
    }
}
