//! Replaces `script` in a build without the feature `torch`: every call returns the same error.

use anyhow::{Result, bail};

use super::Net;
use crate::base::command_for_feature;

/// Returns the error that says how to build with libtorch, and what needs none.
pub fn check_script() -> Result<()> {
    bail!(
        "TorchScript is written by libtorch, and this program was built without it; build it with libtorch: {}\n  \
         policies.safetensors of every run has the same weights, and needs no libtorch: docs/files.md",
        command_for_feature("torch")
    )
}

/// Returns the error of [`check_script`].
pub fn script(_net: &Net, _name: &str) -> Result<Vec<u8>> {
    check_script().map(|()| Vec::new())
}
