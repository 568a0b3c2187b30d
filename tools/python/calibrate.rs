//! The calibration of a display, which fits a model of the real device to pictures.

use crate::call::{Caller, run};
use crate::display::{Display, colors};
use crate::failure::Failure;
use eyebox::calibrate::{Bench, CameraCommand, Event, FEWEST};
use pyo3::prelude::*;
use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::Arc;

/// Fits the model of one color to pictures from the command of a camera, or to a folder of pictures. Returns the
/// calibrated display and its report as JSON. `told` receives each activity (text, share of all work) and each line of
/// the bench (line, None).
#[pyfunction]
pub(crate) fn calibrate(
    py: Python<'_>,
    display: Py<Display>,
    color_name: String,
    bench: (Option<String>, Option<PathBuf>),
    how: (usize, bool, Option<[f64; 3]>),
    told: Option<Py<PyAny>>,
) -> PyResult<(Display, String)> {
    let ((command, folder), (most, quick, iris_mm)) = (bench, how);
    let told = told.map(Arc::new);
    run(py, false, move |caller| {
        let display = &display.get().0;
        let color = colors(display, std::slice::from_ref(&color_name))?[0];
        let keep = folder.as_deref();
        let bench = match (&command, keep) {
            (Some(command), keep) => {
                Bench::Command { camera: CameraCommand { command, keep, limit: None, iris_mm }, most, quick }
            }
            (None, Some(folder)) => Bench::Folder { folder, iris_mm },
            (None, None) => return Err(Failure::Argument("camera and captures are both None: give one".into())),
        };
        if most < FEWEST {
            return Err(Failure::Argument(format!("most is {most}: it must be {FEWEST} or more")));
        }
        let mut observe = |event: Event| tell(caller, told.clone(), event);
        let calibrated = eyebox::calibrate::calibrate(display, color, &bench, None, &mut observe)?;
        let report = serde_json::to_string(&calibrated.report).map_err(|e| Failure::Argument(e.to_string()))?;
        Ok((Display(calibrated.display), report))
    })
}

/// Calls the callback. If the caller is gone, it unwinds the stack, because the fit itself has no check for an early
/// end.
pub(crate) fn tell(caller: &Caller, told: Option<Arc<Py<PyAny>>>, event: Event) {
    let (line, share) = match event {
        Event::At(what, share) => (what.to_string(), Some(share)),
        Event::Said(line) => (line.to_string(), None),
        _ => return,
    };
    if let Some(told) = told {
        caller.ask(move |py| told.call1(py, (line, share)).map(drop));
    }
    if caller.is_gone() {
        resume_unwind(Box::new("the caller is gone"));
    }
}
