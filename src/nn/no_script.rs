//! Replaces `script` in a build without the feature `torch`: every call returns the same error.

use std::path::Path;

use anyhow::{Result, bail};

use super::Net;

/// Returns the error that says how to build with libtorch.
pub fn check_script() -> Result<()> {
    bail!(
        "TorchScript is written by libtorch, and this program was built without it; build it with libtorch installed \
         and the feature `torch`, which is on by default: cargo build --release"
    )
}

/// Returns the error of [`check_script`].
pub fn write_script(_net: &Net, _path: &Path) -> Result<()> {
    check_script()
}
