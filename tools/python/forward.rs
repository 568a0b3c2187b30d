//! The forward model, with images of phases and gradients of functions of these images.

use crate::arrays::values;
use crate::call::run;
use crate::display::{Display, colors};
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::pupil::{Numbers, pupil};
use eyebox::optics::Pupil;
use numpy::{IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;

/// The images of the phases of one color of a display. A model never changes.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct ForwardModel(eyebox::reconstruction::ForwardModel);

impl ForwardModel {
    /// Returns a copy of the phases, which the computing thread needs.
    fn phases(&self, array: &PyReadonlyArrayDyn<'_, f32>) -> Answer<Vec<f32>> {
        let (shape, phases) = values::<3>(array, "phases")?;
        check(shape, self.0.shape(), "phases")?;
        Ok(phases.to_vec())
    }
}

/// Refuses an array of another shape.
fn check(shape: [usize; 3], expected: [usize; 3], what: &str) -> Answer<()> {
    match shape == expected {
        true => Ok(()),
        false => Err(Failure::Argument(format!("{what} must have the shape {expected:?} instead of {shape:?}"))),
    }
}

fn pupils(at: Vec<Numbers>) -> Vec<Pupil> {
    at.into_iter().map(pupil).collect()
}

#[pymethods]
impl ForwardModel {
    #[new]
    fn new(display: &Display, color_name: String, frames: usize) -> PyResult<Self> {
        let color = colors(&display.0, &[color_name])?.remove(0);
        let model = eyebox::reconstruction::ForwardModel::new(&display.0, color, frames).map_err(Failure::from)?;
        Ok(Self(model))
    }

    /// The numbers of rows and columns of an image.
    #[getter]
    fn image_size(&self) -> [usize; 2] {
        self.0.image_size()
    }

    /// Computes the images of phases (sub-frame, row, column) through pupils, as (pupil, row, column), without exposure.
    fn images<'py>(
        slf: Py<Self>,
        py: Python<'py>,
        phases: PyReadonlyArrayDyn<'py, f32>,
        at: Vec<Numbers>,
        engine: Py<Engine>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let (phases, pupils) = (slf.get().phases(&phases)?, pupils(at));
        let ([rows, columns], count) = (slf.get().0.image_size(), pupils.len());
        let images = run(py, engine.get().on_device, move |_| {
            engine.get().lend(|engine| Ok(slf.get().0.images(&phases, &pupils, engine)?))
        })?;
        images.into_pyarray(py).reshape([count, rows, columns])
    }

    /// Computes the gradient with respect to the phases (sub-frame, row, column) from the gradient with respect to the
    /// images (pupil, row, column).
    fn adjoint<'py>(
        slf: Py<Self>,
        py: Python<'py>,
        phases: PyReadonlyArrayDyn<'py, f32>,
        at: Vec<Numbers>,
        gradients: PyReadonlyArrayDyn<'py, f32>,
        engine: Py<Engine>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let (phases, pupils) = (slf.get().phases(&phases)?, pupils(at));
        let (shape, [rows, columns]) = (slf.get().0.shape(), slf.get().0.image_size());
        let (of_images, gradients) = values::<3>(&gradients, "gradients")?;
        check(of_images, [pupils.len(), rows, columns], "gradients")?;
        let gradients = gradients.to_vec();
        let gradient = run(py, engine.get().on_device, move |_| {
            engine.get().lend(|engine| Ok(slf.get().0.adjoint(&phases, &pupils, &gradients, engine)?))
        })?;
        gradient.into_pyarray(py).reshape(shape)
    }
}
