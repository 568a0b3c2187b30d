//! The solve of a scene, which makes a hologram.

use crate::call::{Caller, Outcome, Rest, start};
use crate::display::Display;
use crate::engine::Engine;
use crate::failure::Answer;
use crate::hologram::Hologram;
use crate::scene::Scene;
use crate::told::Told;
use eyebox::produce::{SceneEvent, solve_light_field};
use eyebox::solve::{Flow, Progress, Stop};
use pyo3::exceptions::PyBaseException;
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// The color, step, steps, pilot step and pilot steps, seconds, loss and PSNR (dB).
type Step = (String, usize, usize, Option<[usize; 2]>, f64, f64, Option<f64>);

fn step(color: eyebox::optics::Color, progress: &Progress) -> Step {
    let Progress { step, steps, pilot, seconds, loss, .. } = *progress;
    (
        color.to_string(),
        step,
        steps,
        pilot,
        seconds,
        loss,
        progress.validation.and_then(|score| score.quality()).map(|[mean, _]| mean),
    )
}

/// A hologram and the cause that ended its solve, which is "steps", "seconds", "quality", "callback" or "interrupt".
type Solved = (Hologram, &'static str);

/// A solve that ended because a signal handler or a callback raised an exception.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Unfinished {
    /// The exception that ended the solve.
    #[pyo3(get)]
    error: Py<PyBaseException>,
    rest: Mutex<Option<Rest<Solved>>>,
}

#[pymethods]
impl Unfinished {
    /// Waits for the current step and returns the best hologram, or `None` if an earlier call returned it.
    fn finish(&self, py: Python<'_>) -> PyResult<Option<Solved>> {
        let rest = self.rest.lock().unwrap_or_else(PoisonError::into_inner).take();
        rest.map(|rest| rest.finish(py)).transpose()
    }
}

/// Solves a scene for a display with settings from a TOML text.
#[pyfunction]
pub(crate) fn solve(
    py: Python<'_>,
    scene: Py<Scene>,
    display: Py<Display>,
    settings: String,
    engine: Py<Engine>,
    callback: Option<Py<PyAny>>,
) -> PyResult<(Option<Solved>, Option<Unfinished>)> {
    let on_device = engine.get().on_device;
    let callback = callback.map(Arc::new);
    let run = move |caller: &Caller| -> Answer<Solved> {
        let (scene, display) = (scene.get(), display.get());
        engine.get().lend(|engine| {
            let mut job = scene.job(&display.0);
            let depth = job.reading.depth;
            job.take_settings(&settings, engine)?;
            job.reading.depth = job.reading.depth.or(depth);
            let mut told = Told::new(callback);
            let mut observe = |event: &SceneEvent| match event {
                SceneEvent::Step { color, progress, .. } => told.step(caller, || step(*color, progress)),
                _ => Flow::Continue,
            };
            let solved = solve_light_field(&job, scene.field.clone(), engine, &mut observe)?;
            let stop = solved.solutions.last().map(|(_, solution)| &solution.stop);
            let why = match stop {
                _ if caller.is_gone() => "interrupt",
                _ if told.stopped => "callback",
                Some(Stop::Seconds) => "seconds",
                Some(Stop::Quality) => "quality",
                _ => "steps",
            };
            Ok((Hologram(solved.into_finite()?), why))
        })
    };
    match start(py, on_device, run)? {
        Outcome::Done(solved) => Ok((Some(solved), None)),
        Outcome::Raised(error, rest) => {
            let error = error.into_value(py);
            Ok((None, Some(Unfinished { error, rest: Mutex::new(Some(rest)) })))
        }
    }
}
