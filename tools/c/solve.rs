//! From a scene to a hologram.

use crate::arrays::{given, hand_over, text};
use crate::display::bit;
use crate::failure::{answer, lock};
use crate::{EyeboxDisplay, EyeboxEngine, EyeboxHologram, EyeboxScene, EyeboxStatus};
use eyebox::produce::{SceneEvent, SceneJob, solve_light_field};
use eyebox::solve::{Flow, Progress};
use std::ffi::{c_char, c_void};
use std::mem::MaybeUninit;

/// How far a solve is. Colours are solved one after the other.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxStep {
    /// The colour: EYEBOX_RED, EYEBOX_GREEN or EYEBOX_BLUE.
    pub color: u32,
    /// Steps taken of this colour.
    pub step: usize,
    /// Steps asked for.
    pub steps: usize,
    /// Steps of the short solves that choose the exposure, taken and in all, while they run before the first step; else 0.
    pub pilot_step: usize,
    /// All of them.
    pub pilot_steps: usize,
    /// Seconds since this colour began.
    pub seconds: f64,
    /// Mean squared difference from the photographs over this step's pupils, in linear light.
    pub loss: f64,
    /// Mean PSNR of the best state so far over validation pupils, dB; NaN before there is one, and for a black scene.
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

/// Called after every step, on the thread that called `eyebox_solve`, with the pointer that was given there. What it answers: 0 to
/// go on; anything else ends the solve with the best so far, colours that are left get one step each. It must not throw, nor
/// call eyebox with the engine of the solve.
pub type EyeboxProgress = Option<extern "C" fn(step: *const EyeboxStep, user: *mut c_void) -> i32>;

/// Solves a scene for a display: one hologram, in all of the scene's colours. `settings` is TOML, or null for the defaults: the fields
/// of eyebox::solve::Settings by their names, such as "steps = 60", "pupils = 16", "frames = 8", "seed = 1", "seconds = 2.5",
/// "psnr = 30.0", depths and diameters in metres ("depth = [-1e-3, 2e-3]"), and "quality" ("fast", "balanced", "accurate"),
/// "contrast" and "force" as in the command. A key that is not known is refused. The same scene, display, settings and seed give the same
/// phases as the command, bit for bit on the CPU engine. `progress` may be null.
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
            // SAFETY: the header asks callers for texts that end with zero.
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
