//! The GS in the Python process itself, without a process and a channel of its own.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail, ensure};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::joint::Joint;
use crate::memory::Memory;
use crate::request::{Environment, Opened, Request};
use crate::wire::{self, Refused};

/// Whether an environment lives in this process. libsumo holds one simulation per process. A second one would wait for
/// the first one for ever, because it would hold Python's lock meanwhile.
static TAKEN: AtomicBool = AtomicBool::new(false);

/// The GS of a config in this process. It stays in its thread, as libsumo's simulation does.
#[pyclass(unsendable)]
pub struct InProcess {
    /// The environment. `None` after a panic in it, which left it in an unknown state.
    joint: Option<Joint>,
    /// What it says of itself, as JSON.
    about: String,
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
        Ok(InProcess { about: joint.describe().to_string(), joint: Some(joint), _turn })
    }
}

#[pymethods]
impl InProcess {
    /// Opens the environment. `request`: the first order. `memory`: descriptor of the shared memory.
    #[new]
    fn open(request: &[u8], memory: i32) -> PyResult<InProcess> {
        without_panic(|| InProcess::begin(request, memory)).map_err(raised)
    }

    /// Returns what the environment says of itself, as JSON.
    fn about(&self) -> &str {
        &self.about
    }

    /// Does what is ordered and returns the answer's payload.
    fn order<'py>(&mut self, py: Python<'py>, tag: u8, payload: &[u8]) -> PyResult<Bound<'py, PyBytes>> {
        let ordered = || {
            // Put back only if there was no panic.
            let mut joint = self.joint.take().context("in_process: is broken since an error in it; close it")?;
            let answer = joint.obey(tag, payload);
            self.joint = Some(joint);
            answer
        };
        without_panic(ordered).map(|answer| PyBytes::new(py, &answer)).map_err(raised)
    }
}

/// Returns the exception for an error.
fn raised(error: anyhow::Error) -> PyErr {
    let text = format!("{error:#}");
    if error.is::<Refused>() { PyValueError::new_err(text) } else { PyRuntimeError::new_err(text) }
}

/// Does `work` and makes a panic in it an error. PyO3 would raise a `PanicException`, which `except Exception` misses.
fn without_panic<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
        bail!("in_process: an error of the package: {}", text.unwrap_or("of unknown kind"))
    })
}
