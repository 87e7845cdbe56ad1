//! The GS in the Python process itself, without a process and a channel of its own.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, bail, ensure};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::joint::Joint;
use crate::memory::Memory;
use crate::request::{Environment, Opened, Request};
use crate::wire;

/// Whether an environment lives in this process. libsumo holds one simulation per process. A second one would wait for
/// the first one for ever, because it would hold Python's lock meanwhile.
static TAKEN: AtomicBool = AtomicBool::new(false);

/// The GS of a config in this process. It stays in its thread, as libsumo's simulation does.
#[pyclass(unsendable)]
pub struct InProcess {
    joint: Joint,
    _turn: Turn,
}

/// The right to be the one environment of this process.
struct Turn;

impl Turn {
    fn take() -> Result<Turn> {
        ensure!(
            !TAKEN.swap(true, Ordering::Relaxed),
            "in_process: another environment lives in this process, and libsumo has room for one; close it first, or \
             leave the option out"
        );
        Ok(Turn)
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        TAKEN.store(false, Ordering::Relaxed);
    }
}

impl InProcess {
    fn begin(request: &[u8], memory: i32) -> Result<InProcess> {
        let _turn = Turn::take()?;
        let Request { config, settings, environment } = wire::read(request)?;
        let Environment::Joint(request) = environment else { bail!("in_process: is for the global simulator only") };
        let joint = Joint::open(Opened::open(&config, &settings)?, request, Memory::open(memory)?)?;
        Ok(InProcess { joint, _turn })
    }
}

#[pymethods]
impl InProcess {
    /// Opens the environment. `request`: the first order. `memory`: descriptor of the shared memory.
    #[new]
    fn open(request: &[u8], memory: i32) -> PyResult<InProcess> {
        InProcess::begin(request, memory).map_err(raised)
    }

    /// Returns what the environment says of itself, as JSON.
    fn about(&self) -> String {
        self.joint.describe().to_string()
    }

    /// Does what is ordered and returns the answer's payload.
    fn order<'py>(&mut self, py: Python<'py>, tag: u8, payload: &[u8]) -> PyResult<Bound<'py, PyBytes>> {
        self.joint.obey(tag, payload).map(|answer| PyBytes::new(py, &answer)).map_err(raised)
    }
}

/// Returns the exception for an error.
fn raised(error: anyhow::Error) -> PyErr {
    PyRuntimeError::new_err(format!("{error:#}"))
}
