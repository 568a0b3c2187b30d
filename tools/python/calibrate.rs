//! A model of the display as it is, fitted from pictures.

use crate::display::{Display, colors};
use crate::failure::{Answer, Failure};
use eyebox::calibrate::{Bench, Event, FEWEST};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Fits the model of one colour to what a camera's command gives, or to a folder of pictures; the calibrated display, and its report
/// as JSON. `told` hears (what is being done, share of all) and lines of the bench (line, none); `end` is called when Python raises, by
/// ctrl-C or in `told`, and has the bench give no more pictures.
#[pyfunction]
pub(crate) fn calibrate(
    py: Python<'_>,
    display: &Display,
    color_name: String,
    bench: (Option<String>, Option<PathBuf>),
    how: (usize, bool, Option<[f64; 3]>),
    told: Option<Py<PyAny>>,
    end: Option<Py<PyAny>>,
) -> PyResult<(Display, String)> {
    let ((command, folder), (most, quick, iris_mm)) = (bench, how);
    let mut raised = None;
    let mut run = || -> Answer<(Display, String)> {
        let color = colors(&display.0, std::slice::from_ref(&color_name))?[0];
        let keep = folder.as_deref();
        let bench = match (&command, keep) {
            (Some(command), keep) => Bench::Command { command, keep, limit: None, most, quick, iris_mm },
            (None, Some(folder)) => Bench::Folder { folder, iris_mm },
            (None, None) => return Err(Failure::Argument("camera and captures are both None: give one".into())),
        };
        if most < FEWEST {
            return Err(Failure::Argument(format!("most is {most}: it must be {FEWEST} or more")));
        }
        let mut observe = |event: Event| {
            let heard = Python::attach(|py| -> PyResult<()> {
                py.check_signals()?;
                let Some(told) = &told else { return Ok(()) };
                match event {
                    Event::At(what, share) => told.call1(py, (what, Some(share)))?,
                    Event::Said(line) => told.call1(py, (line, None::<f64>))?,
                    _ => return Ok(()),
                };
                Ok(())
            });
            if let Err(error) = heard
                && raised.is_none()
            {
                raised = Some(error);
                let _ = Python::attach(|py| end.as_ref().map(|end| end.call0(py)).transpose());
            }
        };
        let calibrated = eyebox::calibrate::calibrate(&display.0, color, &bench, None, &mut observe)?;
        let report = serde_json::to_string(&calibrated.report).map_err(|e| Failure::Argument(e.to_string()))?;
        Ok((Display(calibrated.display), report))
    };
    let done = py.detach(&mut run);
    // A fit cannot be ended from here: what was raised meanwhile comes after it.
    match raised {
        Some(error) => Err(error),
        None => Ok(done?),
    }
}
