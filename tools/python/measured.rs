//! The properties of a scene that its views show, such as its depths.

use crate::arrays::picture;
use crate::call::{Caller, run};
use crate::display::Display;
use crate::failure::Answer;
use crate::internals::{DepthSource, central_depth, contact_sheet};
use crate::scene::Scene;
use eyebox::reconstruction::Plane;
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

/// The farthest and nearest depth (m), the trust in them with its share of the detail, the aliasing (pixels), the views
/// per axis without aliasing, and the brightest and mean light of each color.
type Numbers = ([f64; 2], &'static str, Option<f64>, f64, usize, Vec<(f64, f64)>);

/// Measures the views of a scene. Also returns the depth of each pixel of the central view (row, column) in meters.
#[pyfunction]
pub(crate) fn measured(
    py: Python<'_>,
    scene: Py<Scene>,
    display: Py<Display>,
) -> PyResult<(Numbers, Bound<'_, PyArray2<f32>>)> {
    let (numbers, size, depths) = run(py, false, move |_: &Caller| -> Answer<_> {
        let (field, display) = (&scene.get().field, &display.get().0);
        let (depth, source) = field.reach(display);
        let share = |percent: u8| Some(f64::from(percent) / 100.0);
        let (trust, share) = match source {
            DepthSource::Stated => ("stated", None),
            DepthSource::Measured => ("measured", None),
            DepthSource::Plausible(percent) => ("plausible", share(percent)),
            DepthSource::Doubtful(percent) => ("doubtful", share(percent)),
            _ => ("unknown", None),
        };
        let aliasing = field.aliasing(display, depth);
        let views = field.views_without_aliasing(display, depth, display.eyebox_min());
        let light = field.light().iter().map(|light| (light.brightest, light.mean)).collect();
        let numbers: Numbers = (depth, trust, share, aliasing, views, light);
        Ok((numbers, [field.height, field.width], central_depth(field, display)))
    })?;
    Ok((numbers, depths.into_pyarray(py).reshape(size)?))
}

/// Draws all views of a scene next to each other (row, column, color), in at most `most` pixels along each axis.
#[pyfunction]
pub(crate) fn contact(py: Python<'_>, scene: Py<Scene>, most: usize) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let planes = run(py, false, move |_: &Caller| -> Answer<Vec<Plane>> {
        let ([rows, columns], sheets) = contact_sheet(&scene.get().field, most);
        Ok(sheets.into_iter().map(|values| Plane { rows, columns, values }).collect())
    })?;
    picture(py, &planes)
}
