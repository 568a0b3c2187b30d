//! Whether the eye that looks can be served, and what is done for it (OPTICS 11).

use super::error::{SolveError, require};
use super::method::Method;
use super::problem::Problem;
use super::scene_plan::ScenePlan;
use super::settings::Settings;
use crate::optics::{Display, OpticsError, Padding};
use crate::scene::LightField;

impl Problem {
    /// Refuses an eye that blurs over more than half of the picture through a pupil of this diameter (metres).
    ///
    /// # Errors
    /// [`OpticsError::Blur`].
    pub fn check_blur(&self, diameter: f64) -> Result<(), OpticsError> {
        let Some(eye) = &self.eye else { return Ok(()) };
        let (high, wide) = self.optics.field_of_view();
        eye.prescription().check_blur(high.min(wide) * self.share, self.optics.focal_length, diameter)
    }

    /// Refuses an eye that the method knows nothing of, or that the widest pupil that is drawn serves badly.
    pub(super) fn check_eye(&self, settings: &Settings) -> Result<(), SolveError> {
        if self.eye.is_none() {
            return Ok(());
        }
        let method = settings.method;
        let right = "one that looks through pupils (slfh, lf2fs, stft-exact, smooth, pupil-aware, table) to serve a prescription";
        require(method.looks_through_pupils(), "the method", method.name(), right)?;
        let whole = matches!(method, Method::Lf2fs | Method::Smooth | Method::PupilAware);
        Ok(self.check_blur(if whole { self.eyebox } else { settings.diameter[1] })?)
    }
}

impl ScenePlan {
    /// Refuses an eye that cannot be served; says what is done for one that can.
    pub(super) fn check_eye(&mut self, field: &LightField, display: &Display) -> Result<(), SolveError> {
        let views = self.left(field, display);
        Problem::outline(display, self.colors[0], Padding::default(), views)?.check_eye(&self.settings)?;
        let Some(eye) = display.prescription.as_ref().filter(|eye| !eye.is_perfect()) else { return Ok(()) };
        let blur = eye.blur(display.focal_length, self.settings.diameter[1]) / display.picture_pixel();
        let moves = display.focal_length * eye.strongest() * display.eyebox_min() / display.picture_pixel();
        let higher =
            if eye.has_higher_orders() { "; higher orders are corrected only where an eye is followed" } else { "" };
        let why = format!(
            "uncorrected it blurs a point over {blur:.1} pixels; corrected, the picture moves by {moves:.1} as the eye goes \
             across the eyebox{higher}"
        );
        self.say("eye", eye.to_string(), why);
        Ok(())
    }
}
