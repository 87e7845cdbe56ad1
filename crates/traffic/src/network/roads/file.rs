//! The roads of a file.

use std::path::Path;

use anyhow::{Result, anyhow};

use super::Roads;
use crate::network::contents::Content;

/// Reads the roads of a `.net.xml`. An error names file, element, id and attribute.
pub fn read(net: &Path) -> Result<Roads> {
    let content = Content::read(net)?;
    Roads::read(&content.root).map_err(|error| anyhow!("{}: {error:#}", net.display()))
}
