//! What Python is told while something is computed, and what it answers: callbacks, and signals such as ctrl-C.

use crate::failure::Failure;
use eyebox::solve::Flow;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyBool;
use std::time::{Duration, Instant};

/// Signals are looked for no more often: each time the interpreter's lock is taken.
const OFTEN: Duration = Duration::from_millis(50);

/// Who is told.
pub(crate) struct Told<'a> {
    callback: Option<&'a Py<PyAny>>,
    looked: Instant,
    /// What Python raised: the computation ends with it.
    raised: Option<PyErr>,
    /// Whether ctrl-C, or the callback, ended it.
    pub(crate) stopped: Option<&'static str>,
}

impl<'a> Told<'a> {
    pub(crate) fn new(callback: Option<&'a Py<PyAny>>) -> Self {
        Self { callback, looked: Instant::now(), raised: None, stopped: None }
    }

    /// After a step, with the lock released: `arguments` are the callback's.
    pub(crate) fn step<A>(&mut self, arguments: impl FnOnce() -> A) -> Flow
    where
        A: for<'py> pyo3::call::PyCallArgs<'py>,
    {
        if self.raised.is_some() || self.stopped.is_some() {
            return Flow::Stop;
        }
        if self.callback.is_none() && self.looked.elapsed() < OFTEN {
            return Flow::Continue;
        }
        self.looked = Instant::now();
        let answer = Python::attach(|py| -> PyResult<bool> {
            py.check_signals()?;
            let Some(callback) = self.callback else { return Ok(true) };
            let answer = callback.bind(py).call1(arguments())?;
            Ok(!answer.cast::<PyBool>().is_ok_and(|answer| !answer.is_true()))
        });
        match answer {
            Ok(true) => return Flow::Continue,
            Ok(false) => self.stopped = Some("callback"),
            Err(error) if Python::attach(|py| error.is_instance_of::<PyKeyboardInterrupt>(py)) => {
                self.stopped = Some("interrupt");
            }
            Err(error) => self.raised = Some(error),
        }
        Flow::Stop
    }

    /// What was raised, if anything.
    pub(crate) fn raised(&mut self) -> Result<(), Failure> {
        self.raised.take().map_or(Ok(()), |error| Err(error.into()))
    }
}
