//! Replaces `script` in a build without the feature `torch`: every call returns the same error.

use anyhow::{Result, bail};

use super::Net;

/// Returns the error that says what is missing.
pub fn check_script() -> Result<()> {
    bail!("TorchScript is written by libtorch, and this program was built without it")
}

/// Returns the error of [`check_script`].
pub fn script(_net: &Net, _name: &str) -> Result<Vec<u8>> {
    check_script().map(|()| Vec::new())
}
