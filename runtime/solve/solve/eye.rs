//! Checks whether a solve can serve the prescription of the eye (OPTICS 11).

use super::error::{SolveError, require};
use super::method::Method;
use super::problem::Problem;
use super::scene_plan::ScenePlan;
use super::settings::Settings;
use crate::optics::{Display, OpticsError, Padding};
use crate::scene::LightField;

impl Problem {
    /// Returns an error if the eye blurs over more than half of the picture through a pupil of this diameter (meters).
    ///
    /// # Errors
    /// [`OpticsError::Blur`] if the blur is too wide.
    pub fn check_blur(&self, diameter: f64) -> Result<(), OpticsError> {
        let Some(eye) = &self.eye else { return Ok(()) };
        let (high, wide) = self.optics.field_of_view();
        eye.prescription().check_blur(high.min(wide) * self.share, self.optics.focal_length, diameter)
    }

    /// Returns an error if the method cannot correct the eye, or if the eye blurs too much through the widest drawn
    /// pupil.
    pub(super) fn check_eye(&self, settings: &Settings) -> Result<(), SolveError> {
        if self.eye.is_none() {
            return Ok(());
        }
        let method = settings.method;
        let right =
            "one that simulates pupils (slfh, lf2fs, stft-exact, smooth, pupil-aware, table) for a prescription";
        require(method.looks_through_pupils(), "the method", method.name(), right)?;
        let whole = matches!(method, Method::Lf2fs | Method::Smooth | Method::PupilAware);
        Ok(self.check_blur(if whole { self.eyebox } else { settings.diameter[1] })?)
    }
}

impl ScenePlan {
    /// Returns an error for an eye that cannot be served, and otherwise records how it is corrected.
    pub(super) fn check_eye(&mut self, field: &LightField, display: &Display) -> Result<(), SolveError> {
        let views = self.left(field, display);
        Problem::outline(display, self.colors[0], Padding::default(), views)?.check_eye(&self.settings)?;
        let Some(eye) = display.prescription.as_ref().filter(|eye| !eye.is_perfect()) else { return Ok(()) };
        let blur = eye.blur(display.focal_length, self.settings.diameter[1]) / display.picture_pixel();
        let moves = display.focal_length * eye.strongest() * display.eyebox_min() / display.picture_pixel();
        let higher = if eye.has_higher_orders() { ". Higher orders are corrected only for a tracked eye" } else { "" };
        let why = format!(
            "without correction it blurs a point over {blur:.1} pixels. With correction the picture moves by \
             {moves:.1} pixels as the eye crosses the eyebox{higher}"
        );
        self.say("eye", eye.to_string(), why);
        Ok(())
    }
}
