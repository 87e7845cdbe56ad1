//! The state of a traffic light.

use std::fmt;
use std::str::FromStr;

use super::error::{Error, Result};

/// Letters of a state. Source: SUMO documentation, "Simulation/Traffic Lights", section "Signal state definitions".
const ALPHABET: &str = "rRyYgGuoOs";

/// The state of one light: a letter per link, in the order of SUMO's link indices.
///
/// Only SUMO's letters are accepted. SUMO itself takes any letter without a warning, and no car then sees it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct SignalState(String);

impl SignalState {
    /// Makes a state of these letters, such as `GGrr`.
    ///
    /// # Errors
    /// [`Error::State`] if there is none, or one that SUMO does not know.
    pub fn new(letters: impl Into<String>) -> Result<Self> {
        let letters = letters.into();
        check(&letters)?;
        Ok(SignalState(letters))
    }

    /// Returns the letters.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Returns the number of links of its light; never 0.
    pub fn links(&self) -> usize {
        self.0.len()
    }

    /// Changes to another state without giving up its memory.
    pub(crate) fn overwrite(&mut self, letters: &str) -> Result<()> {
        check(letters)?;
        self.0.clear();
        self.0.push_str(letters);
        Ok(())
    }
}

fn check(letters: &str) -> Result<()> {
    let reason = match letters.chars().find(|&letter| !ALPHABET.contains(letter)) {
        Some(letter) => format!("`{letter}` is not a signal"),
        None if letters.is_empty() => "a light has at least one link".to_owned(),
        None => return Ok(()),
    };
    Err(Error::State { state: letters.into(), reason, alphabet: ALPHABET })
}

impl FromStr for SignalState {
    type Err = Error;

    fn from_str(letters: &str) -> Result<Self> {
        SignalState::new(letters)
    }
}

impl fmt::Display for SignalState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}
