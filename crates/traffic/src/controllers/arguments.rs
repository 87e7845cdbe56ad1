//! The text that names a controller: `name:key=value,key=value`.

use std::ops::RangeInclusive;
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};

use super::clock::Leeway;

/// Possible lengths of a green, in steps.
pub(super) const GREENS: RangeInclusive<u32> = 1..=3600;

/// A controller's name with its parameters. The controller takes the parameters one by one.
pub(crate) struct Arguments<'a> {
    text: &'a str,
    name: &'a str,
    /// Parameters that are not taken yet, as they were written.
    left: Vec<&'a str>,
    known: Vec<&'static str>,
}

impl<'a> Arguments<'a> {
    pub(crate) fn of(text: &'a str) -> Self {
        let (name, parameters) = text.split_once(':').unwrap_or((text, ""));
        let left = parameters.split(',').filter(|parameter| !parameter.is_empty()).collect();
        Arguments { text, name, left, known: Vec::new() }
    }

    pub(crate) fn name(&self) -> &'a str {
        self.name
    }

    /// Returns the value of a parameter; `None` if it was not given.
    pub(crate) fn take(&mut self, key: &'static str) -> Result<Option<&'a str>> {
        self.known.push(key);
        let value = |parameter: &&'a str| parameter.split_once('=').filter(|&(name, _)| name == key);
        let values: Vec<&str> = self.left.iter().filter_map(value).map(|(_, value)| value).collect();
        ensure!(values.len() <= 1, "controller `{}`: {key} is given twice", self.text);
        self.left.retain(|parameter| value(parameter).is_none());
        Ok(values.first().copied())
    }

    /// Returns a number of steps within [`GREENS`], or `default` if it was not given.
    pub(crate) fn steps(&mut self, key: &'static str, default: u32) -> Result<u32> {
        Ok(self.steps_if_given(key)?.unwrap_or(default))
    }

    /// Returns a number of steps within [`GREENS`]; `None` if it was not given.
    pub(crate) fn steps_if_given(&mut self, key: &'static str) -> Result<Option<u32>> {
        self.number(key, "a whole number from 1 to 3600", |steps| GREENS.contains(steps))
    }

    /// Returns a number of steps by which a light may leave its clock; `None` if it was not given.
    pub(crate) fn leeway(&mut self, key: &'static str) -> Result<Option<u32>> {
        self.number(key, "a whole number from 0 to 60", |&steps| steps <= Leeway::MOST)
    }

    /// Returns a number that is `good`; `what` says in the error which numbers are.
    pub(crate) fn number<T: FromStr>(
        &mut self,
        key: &'static str,
        what: &str,
        good: impl Fn(&T) -> bool,
    ) -> Result<Option<T>> {
        let Some(text) = self.take(key)? else { return Ok(None) };
        let number = text.parse().ok().filter(good);
        number.map(Some).with_context(|| format!("controller `{}`: {key} = {text}: must be {what}", self.text))
    }

    /// Returns an error about one of the parameters.
    pub(crate) fn refuse(&self, why: impl std::fmt::Display) -> anyhow::Error {
        anyhow::anyhow!("controller `{}`: {why}", self.text)
    }

    /// Returns an error if some parameter was not taken.
    pub(crate) fn all_taken(&self) -> Result<()> {
        let Some(parameter) = self.left.first() else { return Ok(()) };
        let known = if self.known.is_empty() { "none".to_owned() } else { self.known.join(", ") };
        match parameter.split_once('=') {
            Some((key, _)) => bail!(self.refuse(format!("has no parameter `{key}`; it takes {known}"))),
            None => bail!(self.refuse(format!("`{parameter}` is not a parameter; write key=value"))),
        }
    }
}
