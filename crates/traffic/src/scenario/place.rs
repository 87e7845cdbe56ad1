//! The place of an element in a file, as errors name it.

use std::fmt::{self, Display, Formatter};
use std::path::Path;

use anyhow::{Error, anyhow};

use crate::network::roads::attributes::tag;
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// An element and the file that it stands in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place<'a> {
    pub(crate) file: &'a Path,
    pub(crate) element: &'a Element,
}

impl Display for Place<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.file.display(), tag(self.element))
    }
}

impl<'a> Place<'a> {
    pub(super) fn within(self, element: &'a Element) -> Place<'a> {
        Place { element, ..self }
    }

    /// Returns an error about the element.
    pub(super) fn fault(self, what: impl Display) -> Error {
        anyhow!("{self}: {what}")
    }

    /// Returns an error about the value of an attribute.
    pub(crate) fn fault_in(self, key: &str, what: impl Display) -> Error {
        let value = self.element.attribute(key).unwrap_or_default();
        anyhow!("{self}: {key}=\"{}\": {what}", excerpt(value))
    }
}
