//! The function that solves a scene for a hologram.

use crate::arrays::{given, hand_over, text};
use crate::display::bit;
use crate::failure::{answer, lock};
use crate::{EyeboxDisplay, EyeboxEngine, EyeboxHologram, EyeboxScene, EyeboxStatus};
use eyebox::produce::{SceneEvent, SceneJob, solve_light_field};
use eyebox::solve::{Flow, Progress};
use std::ffi::{c_char, c_void};
use std::mem::MaybeUninit;

/// The progress of a solve. Colors are solved one after the other.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxStep {
    /// The present color, which is EYEBOX_RED, EYEBOX_GREEN or EYEBOX_BLUE.
    pub color: u32,
    /// Number of steps taken for this color.
    pub step: usize,
    /// Number of requested steps per color.
    pub steps: usize,
    /// Number of steps taken by the short solves that choose the exposure. These run before the first step. It is 0
    /// while they do not run.
    pub pilot_step: usize,
    /// Total number of steps of these short solves. It is 0 while they do not run.
    pub pilot_steps: usize,
    /// Time since the start of this color (s).
    pub seconds: f64,
    /// Mean squared difference from the target images over the pupils of this step, in linear light. It is NaN before
    /// any step, including the steps of the short solves.
    pub loss: f64,
    /// Mean PSNR of the best state until now over validation pupils (dB). It is NaN before the first validation, and
    /// for a black scene.
    pub psnr_db: f64,
}

impl EyeboxStep {
    fn new(color: eyebox::optics::Color, progress: &Progress) -> Self {
        let [pilot_step, pilot_steps] = progress.pilot.unwrap_or_default();
        let Progress { step, steps, seconds, loss, .. } = *progress;
        let psnr_db = progress.validation.and_then(|score| score.quality()).map_or(f64::NAN, |[mean, _]| mean);
        Self { color: bit(color), step, steps, pilot_step, pilot_steps, seconds, loss, psnr_db }
    }
}

/// A function of the caller that `eyebox_solve` calls before the first step and after every step, on the thread that
/// called `eyebox_solve`. Before the first step, the number of the step is 0 and the loss may be NaN. The argument
/// `step` is valid during the call, and `user` is the pointer that `eyebox_solve` received. Return 0 to continue. Any
/// other value ends the solve with the best result until then, and each remaining color gets one step.
/// The function must not throw, and must not call eyebox with the engine of the solve.
pub type EyeboxProgress = Option<extern "C" fn(step: *const EyeboxStep, user: *mut c_void) -> i32>;

/// Solves a scene for a display as one hologram with all colors of the scene. Free the hologram with
/// `eyebox_hologram_free`. The argument `progress` may be null, and so may `user`.
///
/// Set `settings` to a TOML text, or to null for the defaults. The keys are the fields of eyebox::solve::Settings
/// (docs/settings.md), such as "steps = 60", "pupils = 16", "frames = 8", "seed = 1", "seconds = 2.5" or "psnr = 30.0".
/// Depths and diameters are in meters, as in "depth = [-1e-3, 2e-3]". The keys "quality" ("fast", "balanced",
/// "accurate"), "contrast" and "force" have the same meaning as in the command.
///
/// The same scene, display, settings and seed give the same phases as the command, bit for bit on the CPU engine.
///
/// Fails with EYEBOX_STATUS_SOLVE if a key is unknown, if a value is wrong, or if a loss is not finite.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_solve(
    scene: Option<&EyeboxScene>,
    display: Option<&EyeboxDisplay>,
    settings: *const c_char,
    engine: Option<&EyeboxEngine>,
    progress: EyeboxProgress,
    user: *mut c_void,
    hologram: Option<&mut MaybeUninit<*mut EyeboxHologram>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(hologram, || {
            let (scene, display) = (given(scene, "scene")?, &given(display, "display")?.0);
            let mut engine = lock(&given(engine, "engine")?.engine)?;
            let (colors, record) = (scene.field.colors.clone(), Some(scene.record.clone()));
            let mut job = SceneJob { colors, record, ..SceneJob::new(&scene.name, display) };
            // SAFETY: The header requires texts that end with a zero byte.
            let settings = if settings.is_null() { "" } else { unsafe { text(settings, "settings") }? };
            job.take_settings(settings, engine.as_ref())?;
            let mut observe = |event: &SceneEvent| match (event, progress) {
                (SceneEvent::Step { color, progress: now, .. }, Some(progress)) => {
                    match progress(&EyeboxStep::new(*color, now), user) {
                        0 => Flow::Continue,
                        _ => Flow::Stop,
                    }
                }
                _ => Flow::Continue,
            };
            let solved = solve_light_field(&job, scene.field.clone(), engine.as_mut(), &mut observe)?;
            Ok(EyeboxHologram::from(solved.into_finite()?))
        })
    })
}
