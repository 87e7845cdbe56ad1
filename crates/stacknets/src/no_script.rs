//! Replaces `script` in a build without the feature `torch`: every call returns the same error.

use anyhow::{Result, bail};

use super::Stack;

/// Returns an error if this build cannot write TorchScript: that takes the feature `torch`.
pub fn check_script() -> Result<()> {
    bail!("TorchScript is written by libtorch, and this program was built without it")
}

/// Takes the feature `torch`: see [`check_script`].
pub fn script(_net: &Stack, _name: &str) -> Result<Vec<u8>> {
    check_script().map(|()| Vec::new())
}
