//! What `dials-traffic-torch` does for this program: the program beside this one that is linked with libtorch.
//!
//! A build without the feature `torch` has no such program. Then every call returns the same error.

use std::io::Write;
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};

use crate::program::command_for_feature;

/// Its name; it is built and installed together with this one.
const PROGRAM: &str = "dials-traffic-torch";

/// Returns an error if this build cannot write TorchScript: that takes the feature `torch`.
pub(crate) fn check() -> Result<()> {
    ensure!(
        cfg!(feature = "torch"),
        "TorchScript is written by libtorch, and this program was built without it; build it with libtorch: {}\n  \
         policies.safetensors of every run has the same weights, and needs no libtorch: docs/files.md",
        command_for_feature("torch")
    );
    Ok(())
}

/// Returns networks as a TorchScript module: the bytes of a file that PyTorch and libtorch open. The archive in it gets the name
/// `name`. `networks`: bytes of a safetensors file, with the names of [`stacknets::Layout`].
///
/// `forward(inputs)` takes `[networks, batch, in]`, for any batch, and returns the outputs, `[networks, batch, out]`. With
/// a GRU it is one step. `forward(inputs, states)` also takes the states before it, `[networks, batch, hidden]`. It
/// returns the outputs and then the states after it in one table, `[networks, batch, out + hidden]`, because a traced
/// function has a single result.
pub(crate) fn script(networks: &[u8], name: &str) -> Result<Vec<u8>> {
    call(&["script", name], networks)
}

/// Returns the operations per second of libtorch's matrix products on one thread, at best. Without it: `None`.
pub(crate) fn peak(time: Duration) -> Result<Option<f64>> {
    if check().is_err() {
        return Ok(None);
    }
    let said = call(&["peak", &time.as_secs_f64().to_string()], &[])?;
    Ok(Some(String::from_utf8_lossy(&said).parse()?))
}

/// Returns what /proc says of the memory of a process with libtorch.
pub(crate) fn maps() -> Result<String> {
    Ok(String::from_utf8_lossy(&call(&["maps"], &[])?).into_owned())
}

fn call(words: &[&str], input: &[u8]) -> Result<Vec<u8>> {
    check()?;
    let program = std::env::current_exe().context("where is this program?")?.with_file_name(PROGRAM);
    let failed = || format!("{} failed", program.display());
    let mut child = Command::new(&program)
        .args(words)
        // One thread: BLAS reads this when it is loaded.
        .envs(["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"].map(|name| (name, "1")))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("{}: cannot be started; install this program again", program.display()))?;
    // It reads all before it answers. If it ends early, its last words say why.
    let sent = child.stdin.take().expect("it was asked for").write_all(input);
    let output = child.wait_with_output().with_context(failed)?;
    if !output.status.success() {
        match String::from_utf8_lossy(&output.stderr).trim() {
            "" => bail!("{}: {}", failed(), output.status),
            words => bail!("{words}"),
        }
    }
    sent.with_context(failed)?;
    Ok(output.stdout)
}
