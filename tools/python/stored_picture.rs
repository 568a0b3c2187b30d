//! Pictures of files as arrays of their stored values.

use crate::call::{Caller, run};
use crate::failure::Answer;
use crate::internals::{Samples, Wanted, read_pixels};
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use std::path::PathBuf;

/// The largest picture that is read, in pixels.
const MOST: u64 = 1 << 27;

/// Reads the stored values (row, column, channel) of a picture, as uint8, uint16 or float32.
#[pyfunction]
pub(crate) fn read_picture(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyAny>> {
    let pixels = run(py, false, move |_: &Caller| -> Answer<_> { Ok(read_pixels(&path, Wanted::Scene, MOST)?) })?;
    let shape = [pixels.height, pixels.width, pixels.channels];
    Ok(match pixels.samples {
        Samples::U8(values) => values.into_pyarray(py).reshape(shape)?.into_any(),
        Samples::U16(values) => values.into_pyarray(py).reshape(shape)?.into_any(),
        Samples::F32(values) => values.into_pyarray(py).reshape(shape)?.into_any(),
    })
}
