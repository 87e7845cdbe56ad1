//! Functions of Python that a config names: `reward = "python:NAME"`.

use anyhow::{Context, Result, ensure};
use toml::{Table, Value};

use dials_core::domain::own::OwnFunctions;

/// Prefix of the name of a function.
const PREFIX: &str = "python:";

/// Keys that may name a function, with the keys that keep the names. The built-in rewards and observations keep their
/// own keys.
const KEYS: [(&str, &str); 2] = [("reward", "python_reward"), ("observation", "python_observation")];

/// Returns the key and the value that stand for a function, if this key names one.
pub(super) fn function(key: &str, value: &Value) -> Option<(&'static str, Value)> {
    let (_, kept) = KEYS.into_iter().find(|(given, _)| *given == key)?;
    let name = value.as_str()?.strip_prefix(PREFIX)?;
    Some((kept, Value::String(name.to_owned())))
}

/// Adds a key to a table. A function goes into its own key, which counts before the built-in reward or observation.
pub(super) fn add(table: &mut Table, key: String, value: Value) {
    match function(&key, &value) {
        Some((kept, name)) => drop(table.insert(kept.to_owned(), name)),
        None => drop(table.insert(key, value)),
    }
}

/// The names of two keys of a table.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Functions<'a> {
    pub reward: Option<&'a str>,
    pub observation: Option<&'a str>,
}

impl Functions<'_> {
    pub(super) fn check(&self) -> Result<()> {
        for (key, name) in [("reward", self.reward), ("observation", self.observation)] {
            let Some(name) = name else { continue };
            let (name, _) = split(name)?;
            let fits = |c: char| c.is_alphanumeric() || "_-.".contains(c);
            ensure!(
                !name.is_empty() && name.chars().all(fits),
                "traffic.{key} = \"{PREFIX}{name}\": a name has letters, digits, _, - and dots; register the function under such a name"
            );
        }
        Ok(())
    }

    /// Returns the functions, with the width of the observation. If it is not known yet: without the observation.
    pub(crate) fn known(&self) -> Result<OwnFunctions> {
        let observation = self.observation.map(split).transpose()?;
        Ok(OwnFunctions {
            reward: self.reward.map(str::to_owned),
            observation: observation.and_then(|(name, width)| Some((name.to_owned(), width?))),
        })
    }
}

/// Returns name and width of an observation that is written as `NAME` or `NAME[WIDTH]`.
pub fn split(text: &str) -> Result<(&str, Option<usize>)> {
    let Some((name, rest)) = text.split_once('[') else { return Ok((text, None)) };
    let width = rest.strip_suffix(']').and_then(|width| width.parse().ok()).filter(|&width| width > 0);
    let wrong = || format!("traffic.python_observation = \"{text}\": must be a name, or NAME[WIDTH]");
    Ok((name, Some(width.with_context(wrong)?)))
}

/// Returns an observation with its width as [`split`] reads it.
pub fn joined(name: &str, width: usize) -> String {
    format!("{name}[{width}]")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_observation_is_written_with_its_width_and_read_again() {
        assert_eq!(split("mine").unwrap(), ("mine", None));
        assert_eq!(split(&joined("mine", 12)).unwrap(), ("mine", Some(12)));
        assert!(split("mine[0]").is_err() && split("mine[x]").is_err());
        let wrong = Functions { reward: Some("a b"), observation: None }.check().unwrap_err().to_string();
        assert!(wrong.starts_with("traffic.reward = \"python:a b\": a name has letters"), "{wrong}");
    }
}
