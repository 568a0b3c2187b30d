//! The last steps of a solve, for which a camera takes pictures of the display.

use crate::calibrate::tell;
use crate::call::run;
use crate::display::Display;
use crate::engine::Engine;
use crate::failure::Failure;
use crate::hologram::Hologram;
use crate::internals::{CameraBench, CameraCommand, CameraGain, CameraJob, Event, TakenWithCamera};
use crate::scene::Scene;
use pyo3::exceptions::PyBaseException;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// The steps, the steps behind the kept phases, the number of pictures, and the PSNR of each held-out picture before
/// and after (dB), for a color.
type Gain = (String, usize, usize, usize, Vec<f64>, Vec<f64>);

/// Takes steps of every color of a hologram of a scene on a display, with the command of a camera.
///
/// The pictures stay in the folder of `bench` if there is one. `told` receives activities and lines as for a
/// calibration. Returns the hologram with the phases that are better in pictures that no step uses, the gain of each
/// color, and the error that ended the steps early.
#[pyfunction]
pub(crate) fn camera_steps(
    py: Python<'_>,
    subject: (Py<Hologram>, Py<Scene>, Py<Display>),
    engine: Py<Engine>,
    bench: (String, Option<PathBuf>, Option<[f64; 3]>),
    steps: usize,
    told: Option<Py<PyAny>>,
) -> PyResult<(Hologram, Vec<Gain>, Option<Py<PyBaseException>>)> {
    let (on_device, told) = (engine.get().on_device, told.map(Arc::new));
    let (hologram, gains, trouble) = run(py, on_device, move |caller| {
        let ((hologram, scene, display), (command, keep, iris_mm)) = (subject, bench);
        let mut hologram = hologram.get().0.clone();
        let refused = |what: &str| Failure::Argument(format!("camera is for a hologram that {what}"));
        let settings = hologram.metadata.solve.clone().ok_or_else(|| refused("was solved"))?;
        if hologram.metadata.joint_color.is_some() {
            return Err(refused("shows one color after another, not `joint`"));
        }
        let colors = hologram.named_colors();
        let camera = CameraCommand { command: &command, keep: keep.as_deref(), limit: None, iris_mm };
        let mut say = |line: &str| tell(caller, told.clone(), Event::Said(line));
        let mut bench = CameraBench::open(&display.get().0, &colors, &camera, steps, None, &mut say)?;
        let problems = hologram.problems(&scene.get().field)?;
        let (count, mut gains) = (problems.len() as f64, Vec::<CameraGain>::new());
        engine.get().lend(|engine| {
            for (i, (problem, color)) in problems.iter().zip(colors).enumerate() {
                let of = &mut hologram.colors[i];
                let job = CameraJob { problem, color, settings: &settings, exposure: of.exposure };
                let mut observe = |event: Event| {
                    let event = match event {
                        Event::At(what, share) => Event::At(what, (i as f64 + share) / count),
                        event => event,
                    };
                    tell(caller, told.clone(), event);
                };
                gains.push(bench.improve(job, &mut of.phases, engine, &mut observe));
                if gains.last().is_some_and(|gain| gain.trouble.is_some()) {
                    return Ok(());
                }
            }
            bench.close();
            Ok(())
        })?;
        hologram.metadata.camera = gains.iter().map(record).collect();
        let trouble = gains.iter_mut().find_map(|gain| gain.trouble.take()).map(Failure::from);
        Ok((hologram, gains, trouble))
    })?;
    let row = |g: CameraGain| (g.color.to_string(), g.taken, g.kept, g.pictures, g.before, g.after);
    let trouble = trouble.map(|failure| PyErr::from(failure).into_value(py));
    Ok((Hologram(hologram), gains.into_iter().map(row).collect(), trouble))
}

fn record(gain: &CameraGain) -> TakenWithCamera {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let psnr_db = (!gain.before.is_empty()).then(|| [mean(&gain.before), mean(&gain.after)]);
    TakenWithCamera { color: gain.color, steps: gain.kept, pictures: gain.pictures, psnr_db }
}
