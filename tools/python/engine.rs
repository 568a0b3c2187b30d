//! The class `Engine`, which computes on the CPU or on a Vulkan device.

use crate::call::run;
use crate::failure::{Answer, Failure};
use crate::forked::{OfProcess, is_after_vulkan};
use eyebox::engine::{Backend, Choice};
use eyebox::gpu::Options;
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};

const USE_CPU: &str = "Use engine=\"cpu\" in this process";

/// A backend and its idle engines. Each call takes one engine, so threads compute in parallel and repeated calls reuse
/// the buffers of an engine.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Engine {
    own: OfProcess<Own>,
    reason: String,
    pub(crate) on_device: bool,
}

struct Own {
    backend: Backend,
    idle: Mutex<Vec<Box<dyn eyebox::engine::Engine>>>,
}

impl Engine {
    /// Returns the backend. A forked child can use the CPU, but no device of its parent.
    pub(crate) fn backend(&self) -> Answer<Backend> {
        match self.own.get() {
            Ok(own) => Ok(own.backend.clone()),
            Err(_) if !self.on_device => Ok(Backend::open(Choice::Cpu, &Options::default())?),
            Err(error) => Err(error),
        }
    }

    /// Runs a function on an engine, and keeps the engine for the next call unless the function panics.
    pub(crate) fn lend<T>(&self, run: impl FnOnce(&mut dyn eyebox::engine::Engine) -> Answer<T>) -> Answer<T> {
        let idle = || self.own.get().map(|own| own.idle.lock().unwrap_or_else(PoisonError::into_inner));
        let kept = idle().ok().and_then(|mut idle| idle.pop());
        let mut engine = match kept {
            Some(engine) => engine,
            None => self.backend()?.engine()?,
        };
        let result = run(engine.as_mut());
        if let Ok(mut idle) = idle() {
            idle.push(engine);
        }
        result
    }
}

#[pymethods]
impl Engine {
    #[new]
    fn new(py: Python<'_>, choice: &str) -> PyResult<Self> {
        let mut choice = match choice {
            "auto" => Choice::Auto,
            "cpu" => Choice::Cpu,
            "vulkan" => Choice::Vulkan,
            other => {
                return Err(Failure::Argument(format!("engine is {other:?}: it must be auto, cpu or vulkan")).into());
            }
        };
        let mut forked = None;
        if choice != Choice::Cpu && is_after_vulkan() {
            if choice == Choice::Vulkan {
                return Err(Failure::Forked { what: "Vulkan", remedy: USE_CPU }.into());
            }
            choice = Choice::Cpu;
            forked = Some("the CPU: this process was forked after Vulkan had been opened".to_string());
        }
        run(py, choice != Choice::Cpu, move |_| {
            let backend = Backend::open(choice, &Options::default())?;
            let on_device = backend.gpu()?.is_some();
            let reason = forked.unwrap_or_else(|| backend.reason().into());
            let own = OfProcess::new(Own { backend, idle: Mutex::default() }, "the engine", USE_CPU);
            Ok(Self { own, reason, on_device })
        })
    }

    /// The engine that computes and the reason for this choice, in a sentence.
    #[getter]
    fn reason(&self) -> &str {
        &self.reason
    }
}
