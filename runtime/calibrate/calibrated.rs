//! Holds the result of a calibration.

use super::error::CalibrateError;
use super::figures::Figures;
use super::gain;
use super::report::Report;
use super::residual::HoldoutPicture;
use eyebox_compute::engine::Engine;
use eyebox_optics::{Color, Display};

/// A display that was calibrated.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The display with its fitted model.
    pub display: Display,
    /// Uncertainty of the model, and the share of the pictures that it leaves unexplained.
    pub report: Report,
    /// Pictures that were not fitted, each with its prediction.
    pub shown: Vec<HoldoutPicture>,
}

impl Calibration {
    pub(super) fn new(
        display: Display,
        color: Color,
        mut report: Report,
        shown: Vec<HoldoutPicture>,
    ) -> Result<Self, CalibrateError> {
        report.figures = Some(Figures::new(&display, color, &report.pictures)?);
        Ok(Self { display, report, shown })
    }

    /// Measures the gain of the calibration on the built-in still life and puts it into the report. `before` is the
    /// display as its file was.
    ///
    /// # Errors
    /// The errors of a solve.
    pub fn measure_gain(
        &mut self,
        before: &Display,
        color: Color,
        engine: &mut dyn Engine,
    ) -> Result<(), CalibrateError> {
        self.report.gain = Some(gain::measure([before, &self.display], color, self.report.calibrated, engine)?);
        Ok(())
    }
}
