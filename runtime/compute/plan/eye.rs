//! Prepares the imperfect eye of the viewer for its kernel (OPTICS 11).

use crate::optics::{Optics, Prescription, Pupil, Window};
use eyebox_kernels::eye::Terms;
use std::sync::Arc;

/// An eye with an error.
#[derive(Debug, Clone, PartialEq)]
pub struct EyeTables {
    prescription: Prescription,
    /// Optical path in meters, as coefficients of x^i y^j, with x and y in meters from the center of the pupil.
    path: Vec<Vec<f64>>,
}

impl EyeTables {
    /// Returns the tables of this eye, or none if it is perfect.
    pub fn new(prescription: Option<&Prescription>) -> Option<Arc<Self>> {
        let prescription = prescription.filter(|p| !p.is_perfect())?.clone();
        Some(Arc::new(Self { path: prescription.path(), prescription }))
    }

    /// Returns the errors of this eye.
    pub fn prescription(&self) -> &Prescription {
        &self.prescription
    }

    /// Returns the terms of the error over the bins of a window, with the polynomial in units of the pupil's radius.
    /// `over` lends its list of coefficients.
    pub(super) fn terms(&self, grid: &Optics, pupil: &Pupil, window: &Window, over: Option<Terms>) -> Terms {
        let ((bin_y, bin_x), r) = (grid.bin_size(), 0.5 * pupil.diameter);
        let first = [window.x0 as f64 * bin_x - pupil.x, window.y0 as f64 * bin_y - pupil.y].map(|at| at / r);
        let degree = self.path.len() - 1;
        let term = |i: usize, j: usize| self.path[i][j] * r.powi((i + j) as i32) / grid.wavelength;
        let mut coefficients = over.map_or_else(Vec::new, |terms| terms.coefficients);
        coefficients.clear();
        coefficients.extend((0..=degree).flat_map(|i| (0..=degree - i).map(move |j| term(i, j))));
        Terms { first, step: [bin_x / r, bin_y / r], degree: degree as u32, coefficients }
    }
}
