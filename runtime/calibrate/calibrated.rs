//! What a calibration gives.

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
    /// The display with what was fitted.
    pub display: Display,
    /// How sure that is, and what it leaves unexplained.
    pub report: Report,
    /// Pictures that were not fitted, beside what is predicted of them.
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

    /// Measures what it is worth on the built-in still life, and puts it into the report. `before`: the display as its file was.
    ///
    /// # Errors
    /// Those of a solve.
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
