//! Callbacks with their arguments and answers.

use crate::call::Caller;
use eyebox::solve::Flow;
use pyo3::prelude::*;
use std::sync::Arc;

/// An optional callback, which runs after each step.
pub(crate) struct Told {
    callback: Option<Arc<Py<PyAny>>>,
    /// True if the callback ended the work.
    pub(crate) stopped: bool,
}

impl Told {
    pub(crate) fn new(callback: Option<Arc<Py<PyAny>>>) -> Self {
        Self { callback, stopped: false }
    }

    /// Calls the callback with `arguments` after a step, on the caller's thread. An answer that is false in Python ends
    /// the work, except `None`.
    pub(crate) fn step<A>(&mut self, caller: &Caller, arguments: impl FnOnce() -> A) -> Flow
    where
        A: for<'py> pyo3::call::PyCallArgs<'py> + Send + 'static,
    {
        if self.stopped || caller.is_gone() {
            return Flow::Stop;
        }
        let Some(callback) = self.callback.clone() else { return Flow::Continue };
        let arguments = arguments();
        let goes_on = caller.ask(move |py| {
            let answer = callback.bind(py).call1(arguments)?;
            Ok(answer.is_none() || answer.is_truthy()?)
        });
        self.stopped = goes_on == Some(false);
        if goes_on == Some(true) { Flow::Continue } else { Flow::Stop }
    }
}
