//! Holograms that are refined for the tracked pupil.

use crate::call::run;
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::forked::OfProcess;
use crate::hologram::{Hologram, check_scene};
use crate::pupil::{Numbers, pupil};
use crate::scene::Scene;
use crate::told::Told;
use eyebox::hologram::ColorHologram;
use eyebox::optics::PupilDistribution;
use eyebox::produce::{ProduceError, Refinement};
use eyebox::solve::{Flow, RefineSettings};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, MutexGuard};

/// A hologram under refinement, on its own engines. Calls with one refiner wait for each other.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Refiner {
    refinement: OfProcess<Mutex<Refinement>>,
    on_device: bool,
    /// The first hologram without its phases, which describes the optics.
    about: eyebox::hologram::Hologram,
}

impl Refiner {
    fn lock(&self) -> Answer<MutexGuard<'_, Refinement>> {
        let broken =
            |_| Failure::Argument("an earlier call with this refiner met a fault of eyebox: make another".into());
        self.refinement.get()?.lock().map_err(broken)
    }
}

#[pymethods]
impl Refiner {
    #[new]
    fn new(
        py: Python<'_>,
        hologram: Py<Hologram>,
        scene: Py<Scene>,
        settings: String,
        engine: Py<Engine>,
        other_scene: bool,
    ) -> PyResult<Self> {
        let on_device = engine.get().on_device;
        run(py, on_device, move |_| {
            let (hologram, scene) = (&hologram.get().0, scene.get());
            let steering = RefineSettings::from_toml(&settings)?;
            check_scene(hologram, scene, other_scene)?;
            let backend = engine.get().backend()?;
            let refined = hologram.clone().refine(&scene.field, steering, || backend.engine());
            let refinement = refined.map_err(|error| match error {
                ProduceError::Hologram(error) => Failure::from(error),
                error => error.into(),
            })?;
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
            let remedy = "Make another in this process, with engine=\"cpu\"";
            Ok(Self { refinement: OfProcess::new(Mutex::new(refinement), "the refiner", remedy), on_device, about })
        })
    }

    /// Sets the pupil of the next steps. `spread` is the standard deviation of its center along each axis, in meters.
    fn aim(slf: Py<Self>, py: Python<'_>, at: Numbers, spread: f64) -> PyResult<()> {
        let on_device = slf.get().on_device;
        run(py, on_device, move |_| {
            let refiner = slf.get();
            let pupil = refiner.about.check_pupil(pupil(at))?;
            if !(0.0..=0.1).contains(&spread) {
                return Err(Failure::Argument(format!("spread is {spread}: it must be 0 to 0.1 m")));
            }
            Ok(refiner.lock()?.set_pupil(PupilDistribution::around(&pupil, spread))?)
        })
    }

    /// Takes `steps` steps of every color, or fewer if the callback ends the work. Returns the loss of the last step
    /// and the number of steps.
    fn step(slf: Py<Self>, py: Python<'_>, steps: usize, callback: Option<Py<PyAny>>) -> PyResult<(f64, usize)> {
        let on_device = slf.get().on_device;
        let callback = callback.map(Arc::new);
        run(py, on_device, move |caller| {
            let mut refinement = slf.get().lock()?;
            let mut told = Told::new(callback);
            let (mut loss, mut taken) = (f64::NAN, 0);
            while taken < steps {
                loss = refinement.step()?;
                taken += 1;
                if !loss.is_finite() {
                    return Err(Failure::NotFinite(taken));
                }
                if told.step(caller, || (taken, loss)) == Flow::Stop {
                    break;
                }
            }
            Ok((loss, taken))
        })
    }

    /// Takes steps as `step` does and measures each state at the pupil, so that `best` can return the best one. Returns
    /// the loss of the last step and the number of steps.
    fn refine(slf: Py<Self>, py: Python<'_>, steps: usize, callback: Option<Py<PyAny>>) -> PyResult<(f64, usize)> {
        let on_device = slf.get().on_device;
        let callback = callback.map(Arc::new);
        run(py, on_device, move |caller| {
            let mut refinement = slf.get().lock()?;
            let (mut told, mut ended) = (Told::new(callback), false);
            let mut taken_here = 0;
            let (loss, taken) = refinement.refine(steps, &mut |at| {
                taken_here += 1;
                let flow = told.step(caller, || (taken_here, at.loss));
                ended |= flow == Flow::Stop;
                flow
            })?;
            if taken < steps && !ended {
                return Err(Failure::NotFinite(taken + 1));
            }
            Ok((loss, taken))
        })
    }

    /// Returns the hologram in the best state that `refine` found for the pupil.
    fn best(slf: Py<Self>, py: Python<'_>) -> PyResult<Hologram> {
        let on_device = slf.get().on_device;
        run(py, on_device, move |_| Ok(Hologram(slf.get().lock()?.best()?.clone())))
    }

    /// Returns the hologram in its current state.
    fn hologram(slf: Py<Self>, py: Python<'_>) -> PyResult<Hologram> {
        let on_device = slf.get().on_device;
        run(py, on_device, move |_| Ok(Hologram(slf.get().lock()?.hologram()?.clone())))
    }
}
