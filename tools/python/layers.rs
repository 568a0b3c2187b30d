//! Views of layers, which are pictures with opacity one in front of the other.

use crate::arrays::values;
use crate::call::{Caller, run};
use crate::failure::{Answer, Failure};
use eyebox::scene::{Layer, Places, views_of_layers};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArrayDyn};
use pyo3::prelude::*;

/// Makes views of layers, the farthest first. There is one array (layer, row, column) of linear light per color, and one
/// of the opacity at the end. The positions (x, y) of the views are `places`, in meters of the pupil plane. Content moves
/// by `per_metre` pixels per meter of depth and of the pupil plane. Returns the views of each color, one after the other.
#[pyfunction]
pub(crate) fn layer_views<'py>(
    py: Python<'py>,
    arrays: Vec<PyReadonlyArrayDyn<'_, f32>>,
    depths: Vec<f64>,
    places: Vec<[f64; 2]>,
    per_metre: f64,
) -> PyResult<Vec<Bound<'py, PyArray1<f32>>>> {
    let mut planes = Vec::with_capacity(arrays.len());
    let mut shape = [depths.len(), 0, 0];
    for array in &arrays {
        let (own, light) = values::<3>(array, "layers")?;
        if own.contains(&0) || own[0] != depths.len() || (!planes.is_empty() && own != shape) {
            let right = "(layer, row, column) with one layer per depth, the same for each color";
            return Err(Failure::Argument(format!("layers has the shape {own:?}: it must be {right}")).into());
        }
        shape = own;
        planes.push(light.to_vec());
    }
    let views = run(py, false, move |_: &Caller| -> Answer<_> {
        let [count, height, width] = shape;
        let pixels = height * width;
        let Some((opacity, colors)) = planes.split_last().filter(|(_, colors)| !colors.is_empty()) else {
            return Err(Failure::Argument("layers has no color".into()));
        };
        let layer = |at: usize| Layer {
            depth: depths[at],
            planes: colors.iter().map(|plane| &plane[at * pixels..][..pixels]).collect(),
            opacity: &opacity[at * pixels..][..pixels],
        };
        let layers: Vec<Layer<'_>> = (0..count).map(layer).collect();
        let from = Places { places: &places, per_metre, size: [height, width] };
        views_of_layers(&layers, &from).map_err(|reason| Failure::Argument(format!("layers: {reason}")))
    })?;
    Ok(views.into_iter().map(|views| views.concat().into_pyarray(py)).collect())
}
