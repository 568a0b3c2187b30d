//! Engines.

use crate::failure::{Answer, Failure};
use eyebox::engine::{Backend, Choice};
use eyebox::gpu::Options;
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Where is computed, and the engines there that nobody uses at the moment: each call takes one, so that threads compute side by
/// side and repeated calls find their buffers.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Engine {
    pub(crate) backend: Backend,
    idle: Mutex<Vec<Box<dyn eyebox::engine::Engine>>>,
}

impl Engine {
    /// Runs something on an engine, which is kept for the next call unless it panics.
    pub(crate) fn lend<T>(&self, run: impl FnOnce(&mut dyn eyebox::engine::Engine) -> Answer<T>) -> Answer<T> {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = idle().pop();
        let mut engine = match kept {
            Some(engine) => engine,
            None => self.backend.engine()?,
        };
        let result = run(engine.as_mut());
        idle().push(engine);
        result
    }
}

#[pymethods]
impl Engine {
    #[new]
    fn new(py: Python<'_>, choice: &str) -> PyResult<Self> {
        let choice = match choice {
            "auto" => Choice::Auto,
            "cpu" => Choice::Cpu,
            "vulkan" => Choice::Vulkan,
            other => {
                return Err(Failure::Argument(format!("engine is {other:?}: it must be auto, cpu or vulkan")).into());
            }
        };
        let backend = py.detach(|| Backend::open(choice, &Options::default())).map_err(Failure::from)?;
        Ok(Self { backend, idle: Mutex::default() })
    }

    /// What computes, and why that and nothing else.
    #[getter]
    fn reason(&self) -> &str {
        self.backend.reason()
    }
}
