//! Holograms that are refined for where the eye is.

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

/// A hologram under refinement, on engines of its own. Calls with one refiner wait for each other.
pub struct EyeboxRefiner {
    refinement: Mutex<Refinement>,
    /// What it began with, for its optics.
    about: Hologram,
}

/// Begins to refine a hologram for where the pupil is: a copy, the hologram stays as it is. The scene was loaded for the hologram's
/// display, has its colours, and may be freed afterwards; null takes the one that the hologram was solved from, read as it was
/// then. `settings` is TOML, or null for the defaults: the fields of
/// eyebox::solve::RefineSettings by their names, such as "pupils = 2", "elsewhere = 0.5", "seed = 1". It computes where `engine` does,
/// beside it.
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
            // SAFETY: the header asks callers for texts that end with zero.
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

/// The pupil is there from now on, its centre known to within `spread_m` (a standard deviation along each axis, metres).
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

/// Takes so many steps of every colour. `loss` is that of the last, the mean squared difference in linear light over its pupils; it may be
/// null. A loss that is no finite number is an error: the step was not taken.
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
                return Err(Failure::NotFinite { color: "a colour".into(), step });
            }
        }
        loss.map_or(Ok(()), |loss| put(Some(loss), || Ok(last)))
    })
}

/// Takes at most so many steps as `eyebox_refiner_step` does and hands over the hologram in the best state that they reached, as a
/// new one. The state after each step is judged at the pupil that was aimed at, as a score is: more steps are never worse there.
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
                return Err(Failure::NotFinite { color: "a colour".into(), step: taken + 1 });
            }
            Ok(refinement.best()?.clone().into())
        })
    })
}

/// The hologram as it is now, as a new one: to be looked at, encoded or saved while the refiner goes on.
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

/// Frees a refiner.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_refiner_free(refiner: Option<Box<EyeboxRefiner>>) {
    free(refiner);
}
