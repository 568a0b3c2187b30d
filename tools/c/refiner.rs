//! The functions that refine a hologram for the tracked pupil.

use crate::arrays::{given, hand_over, put, text};
use crate::failure::{Failure, answer, free, lock};
use crate::scene::scene_of;
use crate::{EyeboxEngine, EyeboxHologram, EyeboxPupil, EyeboxScene, EyeboxStatus};
use eyebox::hologram::Hologram;
use eyebox::optics::PupilDistribution;
use eyebox::produce::{ProduceError, Refinement};
use eyebox::solve::{Flow, RefineSettings};
use std::ffi::c_char;
use std::mem::MaybeUninit;
use std::sync::Mutex;

/// A hologram under refinement, with its own engines. Calls with one refiner wait for each other.
pub struct EyeboxRefiner {
    refinement: Mutex<Refinement>,
    /// The first hologram without its phases. Its optics check each pupil.
    about: Hologram,
}

/// Makes a refiner, which refines a copy of a hologram for the position of the pupil. The scene must be loaded for the
/// hologram's display and have its colors. If `scene` is null, eyebox loads the scene from which the hologram was
/// solved, with the settings of the solve. Hologram and scene may be freed after this call. The refiner computes on the
/// device of `engine`, with engines of its own. Free it with `eyebox_refiner_free`.
///
/// Set `settings` to a TOML text, or to null for the defaults. The keys are the fields of eyebox::solve::RefineSettings
/// (docs/settings.md), such as "pupils = 2", "elsewhere = 0.5" or "seed = 1".
///
/// Fails with EYEBOX_STATUS_SOLVE if the settings are wrong. Fails with EYEBOX_STATUS_HOLOGRAM if the scene is not
/// found, is not the scene of the hologram, or has another size. Fails with EYEBOX_STATUS_DISPLAY if the scene lacks a
/// color of the hologram.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_refiner_new(
    hologram: Option<&EyeboxHologram>,
    scene: Option<&EyeboxScene>,
    settings: *const c_char,
    engine: Option<&EyeboxEngine>,
    refiner: Option<&mut MaybeUninit<*mut EyeboxRefiner>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(refiner, || {
            let hologram = given(hologram, "hologram")?;
            // SAFETY: The header requires texts that end with a zero byte.
            let settings = if settings.is_null() { "" } else { unsafe { text(settings, "settings") }? };
            let steering = RefineSettings::from_toml(settings)?;
            let backend = given(engine, "engine")?.backend.clone();
            let field = scene_of(scene, &hologram.hologram)?;
            let whole = hologram.hologram.clone();
            let refinement = whole.refine(&field, steering, || backend.engine()).map_err(|error| match error {
                ProduceError::Hologram(error) => Failure::from(error),
                error => error.into(),
            })?;
            let refinement = Mutex::new(refinement);
            let colors = hologram.hologram.colors.iter();
            let colors = colors.map(|c| eyebox::hologram::ColorHologram { phases: Vec::new(), ..c.clone() }).collect();
            Ok(EyeboxRefiner { refinement, about: Hologram { colors, ..hologram.hologram.clone() } })
        })
    })
}

/// Sets the pupil for which the next steps refine. The uncertainty of its center is `spread_m`, which is a standard
/// deviation along each axis (0 to 0.1 m). Fails with EYEBOX_STATUS_DISPLAY if the light does not reach the pupil, or
/// if no eye has such a pupil.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_refiner_aim(
    refiner: Option<&EyeboxRefiner>,
    pupil: Option<&EyeboxPupil>,
    spread_m: f64,
) -> EyeboxStatus {
    answer(|| {
        let refiner = given(refiner, "refiner")?;
        let pupil = given(pupil, "pupil")?.before(&refiner.about)?;
        if !(0.0..=0.1).contains(&spread_m) {
            return Err(Failure::argument("spread_m", spread_m, "0 to 0.1 m"));
        }
        Ok(lock(&refiner.refinement)?.set_pupil(PupilDistribution::around(&pupil, spread_m))?)
    })
}

/// Takes `steps` steps (1 to 1000000) of every color. If `loss` is not null, it receives the loss of the last step. The
/// loss is the mean squared difference in linear light over the pupils of the step. Fails with EYEBOX_STATUS_SOLVE if a
/// loss is not finite, and then this step was not taken.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_refiner_step(
    refiner: Option<&EyeboxRefiner>,
    steps: usize,
    loss: Option<&mut MaybeUninit<f64>>,
) -> EyeboxStatus {
    answer(|| {
        let refiner = given(refiner, "refiner")?;
        if !(1..=1_000_000).contains(&steps) {
            return Err(Failure::argument("steps", steps, "1 to 1000000"));
        }
        let mut refinement = lock(&refiner.refinement)?;
        let mut last = 0.0;
        for step in 1..=steps {
            last = refinement.step()?;
            if !last.is_finite() {
                return Err(Failure::NotFinite { color: "a color".into(), step });
            }
        }
        loss.map_or(Ok(()), |loss| put(Some(loss), || Ok(last)))
    })
}

/// Takes `steps` steps (1 to 1000000) like `eyebox_refiner_step`, and makes a new hologram from the best state. The
/// state after each step is scored at the pupil of `eyebox_refiner_aim`, so more steps never lower the score there.
/// Free the hologram with `eyebox_hologram_free`. Fails with EYEBOX_STATUS_SOLVE if a loss is not finite.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_refiner_best(
    refiner: Option<&EyeboxRefiner>,
    steps: usize,
    hologram: Option<&mut MaybeUninit<*mut EyeboxHologram>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(hologram, || {
            if !(1..=1_000_000).contains(&steps) {
                return Err(Failure::argument("steps", steps, "1 to 1000000"));
            }
            let mut refinement = lock(&given(refiner, "refiner")?.refinement)?;
            let (_, taken) = refinement.refine(steps, &mut |_| Flow::Continue)?;
            if taken < steps {
                return Err(Failure::NotFinite { color: "a color".into(), step: taken + 1 });
            }
            Ok(refinement.best()?.clone().into())
        })
    })
}

/// Makes a new hologram from the current state of a refiner. The program may render, encode or save it while the
/// refiner continues. Free it with `eyebox_hologram_free`.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_refiner_hologram(
    refiner: Option<&EyeboxRefiner>,
    hologram: Option<&mut MaybeUninit<*mut EyeboxHologram>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(hologram, || {
            let mut refinement = lock(&given(refiner, "refiner")?.refinement)?;
            Ok(refinement.hologram()?.clone().into())
        })
    })
}

/// Frees a refiner. Null is allowed and has no effect.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_refiner_free(refiner: Option<Box<EyeboxRefiner>>) {
    free(refiner);
}
