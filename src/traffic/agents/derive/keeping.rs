//! Lights that keep their program, and why.

use std::fmt;

use super::greens::MOST_GREENS;

/// A light that does not learn. It shows its own program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Keeping {
    /// SUMO's name of the light.
    pub light: String,
    pub why: Why,
}

/// Why a light keeps its program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Why {
    /// The overrides say so.
    Excluded,
    /// Its program is of this type.
    Kind(String),
    /// It controls no connection.
    NoLink,
    /// Neither passenger cars nor buses can come to it.
    NoCars,
    /// It has fewer than two greens, or too many: this number.
    Greens(usize),
}

impl Why {
    /// Returns what a person can do about it.
    pub fn way_out(&self) -> &'static str {
        match self {
            Why::Excluded => "let it learn in agents.toml",
            Why::Kind(_) => "make its program static, with netconvert --tls.default-type static --tls.rebuild",
            Why::NoLink => "control its connections in netedit",
            Why::NoCars => "allow cars on its lanes in netedit",
            Why::Greens(greens) if *greens > MOST_GREENS => "name its greens in agents.toml",
            Why::Greens(_) => "give its program a second green in netedit, or name its greens in agents.toml",
        }
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Why::Excluded => f.write_str("agents.toml says so"),
            Why::Kind(kind) => {
                write!(f, "its program is of type `{kind}`, and agents replace static and actuated ones")
            }
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
