//! Holograms that are refined for where the eye is.

use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::hologram::Hologram;
use crate::pupil::{Numbers, pupil};
use crate::scene::Scene;
use crate::told::Told;
use eyebox::hologram::{ColorHologram, Refinement};
use eyebox::optics::PupilDistribution;
use eyebox::solve::{Flow, Steering};
use pyo3::prelude::*;
use std::sync::{Mutex, MutexGuard};

/// A hologram under refinement, on engines of its own. Calls with one refiner wait for each other.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Refiner {
    refinement: Mutex<Refinement>,
    /// What it began with, for its optics: without phases.
    about: eyebox::hologram::Hologram,
}

impl Refiner {
    fn lock(&self) -> Answer<MutexGuard<'_, Refinement>> {
        let broken =
            |_| Failure::Argument("an earlier call with this refiner met a fault of eyebox: make another".into());
        self.refinement.lock().map_err(broken)
    }
}

#[pymethods]
impl Refiner {
    #[new]
    fn new(py: Python<'_>, hologram: &Hologram, scene: &Scene, settings: &str, engine: &Engine) -> PyResult<Self> {
        let begin = || -> Answer<Self> {
            let hologram = &hologram.0;
            let steering = Steering::from_toml(settings)?;
            hologram.check_shows(&scene.source, &scene.field)?;
            let refinement = hologram.clone().refine(&scene.field, steering, || engine.backend.engine())?;
            let bare = |c: &ColorHologram| ColorHologram { phases: Vec::new(), ..c.clone() };
            let colors = hologram.colors.iter().map(bare).collect();
            let about = eyebox::hologram::Hologram {
                colors,
                scene: hologram.scene.clone(),
                display: hologram.display.clone(),
                version: hologram.version.clone(),
                display_wavelengths: hologram.display_wavelengths.clone(),
                metadata: hologram.metadata.clone(),
                ..*hologram
            };
            Ok(Self { refinement: Mutex::new(refinement), about })
        };
        Ok(py.detach(begin)?)
    }

    /// The pupil is there from now on, its centre known to within `spread` metres (a standard deviation along each axis).
    fn aim(&self, py: Python<'_>, at: Numbers, spread: f64) -> PyResult<()> {
        let aim = || -> Answer<()> {
            let pupil = self.about.check_pupil(pupil(at))?;
            if !(0.0..=0.1).contains(&spread) {
                return Err(Failure::Argument(format!("spread is {spread}: it must be 0 to 0.1 m")));
            }
            Ok(self.lock()?.set_pupil(PupilDistribution::around(&pupil, spread))?)
        };
        Ok(py.detach(aim)?)
    }

    /// Takes so many steps of every colour, fewer where ctrl-C or the callback ends it; the loss of the last, and how many.
    fn step(&self, py: Python<'_>, steps: usize, callback: Option<Py<PyAny>>) -> PyResult<(f64, usize)> {
        let take = || -> Answer<(f64, usize)> {
            let mut refinement = self.lock()?;
            let mut told = Told::new(callback.as_ref());
            let (mut loss, mut taken) = (f64::NAN, 0);
            while taken < steps {
                loss = refinement.step()?;
                taken += 1;
                if !loss.is_finite() {
                    return Err(Failure::NotFinite(taken));
                }
                let flow = told.step(|| (taken, loss));
                told.raised()?;
                if flow == Flow::Stop {
                    break;
                }
            }
            Ok((loss, taken))
        };
        Ok(py.detach(take)?)
    }

    /// The hologram as it is now.
    fn hologram(&self, py: Python<'_>) -> PyResult<Hologram> {
        let copy = || -> Answer<Hologram> { Ok(Hologram(self.lock()?.hologram()?.clone())) };
        Ok(py.detach(copy)?)
    }
}
