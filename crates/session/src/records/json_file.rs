//! Reads the JSON files of a report that are not in a run directory: plans and baselines.

use std::path::Path;

use anyhow::{Context, Result};
use serde::de::DeserializeOwned;

use dials_core::outside::read_text;

/// Largest plan or baseline. A plan of 100 000 runs has eight mebibytes.
const LARGEST_FILE: u64 = 16 << 20;

/// Reads a plan or a baseline.
pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = read_text(path, LARGEST_FILE).with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{}: is not a file of this program", path.display()))
}
