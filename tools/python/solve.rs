//! From a scene to a hologram.

use crate::display::Display;
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::hologram::Hologram;
use crate::scene::Scene;
use crate::told::Told;
use eyebox::produce::{SceneEvent, solve_light_field};
use eyebox::solve::{Flow, Progress, Stop};
use pyo3::prelude::*;

/// Colour, step, steps, [pilot step, steps], seconds, loss, PSNR (dB).
type Step = (String, usize, usize, Option<[usize; 2]>, f64, f64, Option<f64>);

fn step(color: eyebox::optics::Color, progress: &Progress) -> Step {
    let Progress { step, steps, pilot, seconds, loss, .. } = *progress;
    (color.to_string(), step, steps, pilot, seconds, loss, progress.validation.map(|score| score.mean()))
}

/// Solves a scene for a display with the settings that a TOML text says. The second result is why it ended: "steps",
/// "seconds", "quality", "callback" or "interrupt".
#[pyfunction]
pub(crate) fn solve(
    py: Python<'_>,
    scene: &Scene,
    display: &Display,
    settings: &str,
    engine: &Engine,
    callback: Option<Py<PyAny>>,
) -> PyResult<(Hologram, &'static str)> {
    let run = || -> Answer<_> {
        engine.lend(|engine| {
            let mut job = scene.job(&display.0);
            let depth = job.depth;
            job.take_settings(settings, engine)?;
            job.depth = job.depth.or(depth);
            let mut told = Told::new(callback.as_ref());
            let mut observe = |event: &SceneEvent| match event {
                SceneEvent::Step { color, progress, .. } => told.step(|| step(*color, progress)),
                _ => Flow::Continue,
            };
            let solved = solve_light_field(&job, scene.field.clone(), engine, &mut observe).map_err(Failure::from);
            told.raised()?;
            let solved = solved?;
            let stop = solved.solutions.last().map(|(_, solution)| &solution.stop);
            let why = told.stopped.unwrap_or(match stop {
                Some(Stop::Seconds) => "seconds",
                Some(Stop::Quality) => "quality",
                _ => "steps",
            });
            Ok((Hologram(solved.into_finite()?), why))
        })
    };
    Ok(py.detach(run)?)
}
