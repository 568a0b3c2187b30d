//! What a static mask in front of the SLM asks of a solve (OPTICS 12): which methods know of it, and what it costs.

use super::error::{SolveError, require};
use super::method::Method;
use super::scene_plan::ScenePlan;
use crate::optics::Display;

/// Refuses a mask that the method knows nothing of.
pub(super) fn check(has_mask: bool, method: Method) -> Result<(), SolveError> {
    let right =
        "one that looks through pupils (slfh, lf2fs, stft-exact, smooth, pupil-aware) for a mask in front of the SLM";
    require(!has_mask || method.looks_through_pupils(), "the method", method.name(), right)
}

impl ScenePlan {
    /// Says what the display's mask makes of its eyebox, and of the work.
    pub(super) fn say_mask(&mut self, display: &Display) -> Result<(), SolveError> {
        let Some(mask) = &display.mask else { return Ok(()) };
        check(true, self.settings.method)?;
        let (k, eyebox) = (mask.factor, display.eyebox_min() * 1e3);
        let plain = eyebox / k as f64;
        let mut why = format!(
            "an eyebox of {eyebox:.1} mm instead of {plain:.1} from as many phases: fields and spectra have {} times the points, of \
             which only columns that pupils pass are transformed along y; windows stay as they are",
            k * k
        );
        if mask.distance_mm > 0.0 {
            why += &format!("; {} mm behind the SLM: two more transforms of the grid each way", mask.distance_mm);
        }
        self.say("mask", format!("{k} x {k} pixels on each of the SLM's"), why);
        Ok(())
    }
}
