//! The conversion of arrays between NumPy and Rust.

use crate::failure::{Answer, Failure};
use eyebox::reconstruction::Plane;
use eyebox::scene::srgb_to_linear;
use numpy::{IntoPyArray, PyArray1, PyArray3, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;

/// Returns the linear light of each level of an sRGB picture with `levels` levels (IEC 61966-2-1), as float32 from 0 to
/// 1.
#[pyfunction]
pub(crate) fn linear_light(py: Python<'_>, levels: usize) -> PyResult<Bound<'_, PyArray1<f32>>> {
    if !(2..=65536).contains(&levels) {
        return Err(Failure::Argument(format!("levels is {levels}: it must be 2 to 65536")).into());
    }
    let top = (levels - 1) as f64;
    let table: Vec<f32> = (0..levels).map(|level| srgb_to_linear(level as f64 / top) as f32).collect();
    Ok(table.into_pyarray(py))
}

/// Encodes linear light (color, row, column) of red, green and blue as an 8-bit sRGB PNG.
#[pyfunction]
pub(crate) fn png(light: PyReadonlyArrayDyn<'_, f32>) -> PyResult<Vec<u8>> {
    let ([_, rows, columns], light) = values::<3>(&light, "light")?;
    let planes: Vec<&[f32]> = light.chunks_exact((rows * columns).max(1)).collect();
    if planes.len() != 3 {
        let count = planes.len();
        return Err(Failure::Argument(format!("light has {count} planes, but red, green and blue are 3")).into());
    }
    Ok(encoded(rows, columns, &planes)?)
}

/// Encodes one or three planes of linear light as a PNG.
pub(crate) fn encoded(rows: usize, columns: usize, planes: &[&[f32]]) -> Answer<Vec<u8>> {
    let mut png = Vec::new();
    let drawn = eyebox::files::encode_png(&mut png, rows, columns, planes);
    drawn.map_err(|e| Failure::Argument(format!("the picture could not be made: {e}")))?;
    Ok(png)
}

/// Returns the shape and the values of an array with `AXES` axes. The Python side has made it contiguous and float32.
pub(crate) fn values<'a, const AXES: usize>(
    array: &'a PyReadonlyArrayDyn<'_, f32>,
    what: &str,
) -> Answer<([usize; AXES], &'a [f32])> {
    let shape = array.as_array().shape().to_vec();
    let axes = <[usize; AXES]>::try_from(&shape[..]);
    let axes =
        axes.map_err(|_| Failure::Argument(format!("{what} has the shape {shape:?}: it must have {AXES} axes")))?;
    let values = array.as_slice().map_err(|_| Failure::Argument(format!("{what} has gaps: it must be contiguous")))?;
    Ok((axes, values))
}

/// Makes an array (row, column, channel) from bytes. The array takes over their memory.
pub(crate) fn bytes(py: Python<'_>, bytes: Vec<u8>, shape: [usize; 3]) -> PyResult<Bound<'_, PyArray3<u8>>> {
    bytes.into_pyarray(py).reshape(shape)
}

/// Makes an image (row, column, color) from one plane per color.
pub(crate) fn picture<'py>(py: Python<'py>, planes: &[Plane]) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (rows, columns) = planes.first().map_or((0, 0), |plane| (plane.rows, plane.columns));
    let at = |pixel: usize| planes.iter().map(move |plane| plane.values[pixel]);
    let values: Vec<f32> = (0..rows * columns).flat_map(at).collect();
    values.into_pyarray(py).reshape([rows, columns, planes.len()])
}
