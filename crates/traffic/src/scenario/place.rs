//! The place of an element in a file, as errors name it.

use std::fmt::{self, Display, Formatter};
use std::path::Path;

use anyhow::{Context, Error, Result, anyhow, ensure};

use crate::config::sumo_time::seconds;
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// An element and the file that it stands in.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    pub file: &'a Path,
    pub element: &'a Element,
}

impl Display for Place<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}: <{}", self.file.display(), excerpt(&self.element.name))?;
        match self.element.attribute("id") {
            Some(id) => write!(f, " id=\"{}\">", excerpt(id)),
            None => f.write_str(">"),
        }
    }
}

impl<'a> Place<'a> {
    pub fn new(file: &'a Path, element: &'a Element) -> Place<'a> {
        Place { file, element }
    }

    pub fn within(self, element: &'a Element) -> Place<'a> {
        Place { element, ..self }
    }

    /// Returns an error about the element.
    pub fn fault(self, what: impl Display) -> Error {
        anyhow!("{self}: {what}")
    }

    /// Returns an error about the value of an attribute.
    pub fn fault_in(self, key: &str, what: impl Display) -> Error {
        let value = self.element.attribute(key).unwrap_or_default();
        anyhow!("{self}: {key}=\"{}\": {what}", excerpt(value))
    }

    /// Returns an attribute that must be there.
    pub fn needed(self, key: &str) -> Result<&'a str> {
        let value = self.element.attribute(key).filter(|value| !value.is_empty());
        value.with_context(|| format!("{self}: has no {key}; add the attribute"))
    }

    /// Returns a number within limits, if the attribute is there.
    pub fn number(self, key: &str, least: f64, most: f64) -> Result<Option<f64>> {
        let Some(text) = self.element.attribute(key) else { return Ok(None) };
        let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let number = number.ok_or_else(|| self.fault_in(key, "is no number"))?;
        ensure!(
            (least..=most).contains(&number),
            self.fault_in(key, format!("must be from {least} to {most}; correct it"))
        );
        Ok(Some(number))
    }

    /// Returns a time in seconds that is not negative, if the attribute is there.
    pub fn time(self, key: &str) -> Result<Option<f64>> {
        let Some(text) = self.element.attribute(key) else { return Ok(None) };
        let time = seconds(text).map_err(|error| self.fault(format!("{key}: {error}")))?;
        ensure!(time >= 0.0, self.fault_in(key, "must not be negative"));
        Ok(Some(time))
    }
}
