//! Texts with units as numbers.

use crate::failure::Failure;
pub(crate) use crate::internals::QuantityError;
use crate::internals::{Quantity, Unit, read_size};
use eyebox::optics::Depth;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Reads a text with a unit as a number in another unit of the same dimension.
#[pyfunction]
pub(crate) fn quantity(text: &str, unit: &str) -> PyResult<f64> {
    let unit = Unit::named(unit).ok_or_else(|| PyValueError::new_err(format!("{unit}: no unit")))?;
    Ok(Quantity::read_with_unit(text, unit, &[]).map_err(Failure::Quantity)?.value_in(unit))
}

/// Reads a depth from a text, in meters behind a lens of this focal length [m].
#[pyfunction]
pub(crate) fn depth(text: &str, focal_length: f64) -> PyResult<f64> {
    Ok(Depth::read_with_unit(text).map_err(Failure::Quantity)?.metres(focal_length))
}

/// Reads rows and columns from a text such as `1080p`.
#[pyfunction]
pub(crate) fn size(text: &str) -> PyResult<[usize; 2]> {
    Ok(read_size(text).map_err(Failure::Quantity)?)
}
