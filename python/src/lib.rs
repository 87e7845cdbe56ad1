//! The native module of the Python package `dials_traffic`.
//!
//! An environment is a process of its own, because libsumo holds one simulation per process. The Python process starts
//! it as an interpreter that calls [`serve`](serve::serve). Orders and answers go over a socket; observations, rewards
//! and actions are in shared memory. The Python process itself does not load this module, because libsumo brings some
//! hundred libraries, and pip's libsumo may be there, too. Only an environment that is asked for in this process does.
//!
//! - `serve`: the loop of that process. `request`: what it is asked for. `wire`: the records on the socket. `memory`: the
//!   shared memory.
//! - `in_process`: an environment in the Python process itself.
//! - `joint`: all agents on the global simulator. `local`: local simulators with influence predictors.
//! - `datasets`: what influence predictors learn from.
//! - `roads`: what is on the roads, for functions of the user.
//! - `policies`: the trained policies of a run. `any_light`: one for any light. `agent`: what they say of an agent.

mod agent;
mod any_light;
mod datasets;
mod in_process;
mod joint;
mod local;
mod memory;
mod policies;
mod request;
mod roads;
mod serve;
mod wire;

#[pyo3::pymodule]
mod _native {
    use pyo3::exceptions::PyRuntimeError;
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::in_process::InProcess;

    /// Serves one environment to the process that started this one, until it closes the channel. For the package
    /// itself. `memory`: descriptor of the shared memory. `parent`: number of the process that started this one.
    #[pyfunction]
    fn serve(py: Python<'_>, memory: i32, parent: u32) -> PyResult<()> {
        py.detach(|| super::serve::serve(memory, parent)).map_err(|error| PyRuntimeError::new_err(format!("{error:#}")))
    }
}
