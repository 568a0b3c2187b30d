//! Scores of holograms against their scenes.

use crate::call::run;
use crate::engine::Engine;
use crate::hologram::{Hologram, check_scene, seen_past};
use crate::pupil::{Numbers, pupil};
use crate::scene::Scene;
use eyebox::optics::Display;
use eyebox::reconstruction::{JodSettings, PupilScore, SceneSource};
use pyo3::prelude::*;

/// The PSNR and its ceiling (dB), the SSIM, the PSNR against a clear pupil (dB), and the JOD.
type Score = (Option<f64>, Option<f64>, Option<f64>, Option<f64>, Option<f64>);

/// The highest number of judged pupils, the luminance of white and black (cd/m2), the pixels per degree, and the
/// sub-frames per second.
type Judging = (usize, [Option<f64>; 3], Option<f64>);

/// Compares reconstructions through pupils with the target images of the scene. All pupils share one exposure per
/// color. With `judging`, some of the pupils are also judged in JOD.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "Python passes each argument of the method of its own")]
pub(crate) fn score(
    py: Python<'_>,
    hologram: Py<Hologram>,
    scene: Py<Scene>,
    at: Vec<Numbers>,
    obstructed: Option<String>,
    engine: Py<Engine>,
    other_scene: bool,
    judging: Option<Judging>,
) -> PyResult<Vec<Score>> {
    run(py, engine.get().on_device, move |_| {
        let (hologram, scene) = (&hologram.get().0, scene.get());
        let pupils = at.into_iter().map(|at| hologram.check_pupil(pupil(at))).collect::<Result<Vec<_>, _>>()?;
        check_scene(hologram, scene, other_scene)?;
        let source = seen_past(hologram, obstructed.as_deref())?;
        let scene = SceneSource::from(hologram.problems(&scene.field)?);
        let mut scores = engine.get().lend(|engine| Ok(source.score(&scene, &pupils, engine)?))?;
        if let Some((most, [luminance, black, pixels_per_degree], sub_frame_rate_hz)) = judging {
            let made_for = hologram.made_for()?;
            let viewing = made_for.viewing.with(luminance, black, pixels_per_degree)?;
            let pixels_per_degree = Display { viewing, ..made_for }.pixels_per_degree();
            let settings = JodSettings { viewing, pixels_per_degree, most, sub_frame_rate_hz, gaze: None, maps: None };
            engine.get().lend(|engine| Ok(source.judge(&scene, &mut scores, &settings, engine, &mut |_| ())?))?;
        }
        let row = |score: &PupilScore| (score.psnr, score.ceiling, score.ssim, score.against_clear, score.jod);
        Ok(scores.pupils.iter().map(row).collect())
    })
}
