//! Finds lengths that are probably given in a wrong unit.

use super::OpticsError;
use eyebox_base::error::Reason;
use eyebox_base::reason;

/// A quantity with its plausible range and the range accepted without confirmation, both in its unit.
pub(super) struct Usual {
    what: &'static str,
    unit: &'static str,
    /// The range in which a guess must lie.
    common: [f64; 2],
    taken: [f64; 2],
}

pub(super) const PITCH: Usual = Usual { what: "the pitch", unit: "um", common: [1.0, 40.0], taken: [0.2, 100.0] };
pub(super) const WAVELENGTH: Usual =
    Usual { what: "the wavelength", unit: "nm", common: [380.0, 1100.0], taken: [200.0, 2500.0] };
pub(super) const FOCAL_LENGTH: Usual =
    Usual { what: "the focal length", unit: "mm", common: [10.0, 2000.0], taken: [2.0, 5000.0] };
pub(super) const DIAMETER: Usual =
    Usual { what: "the pupil's diameter", unit: "mm", common: [1.0, 30.0], taken: [0.1, f64::INFINITY] };
pub(super) const APERTURE: Usual =
    Usual { what: "the aperture", unit: "mm", common: [1.0, 200.0], taken: [0.1, 10000.0] };
pub(super) const VIEW_PITCH: Usual =
    Usual { what: "the view pitch", unit: "mm", common: [0.05, 20.0], taken: [0.01, 100.0] };
/// Common depths in mm, for guesses. The accepted depths depend on the focal length.
pub(super) const COMMON_DEPTH: [f64; 2] = [0.05, 50.0];

impl Usual {
    /// Accepts a value, in the unit of the quantity, if it is in the range accepted without confirmation.
    pub(super) fn check(&self, value: f64) -> Result<(), OpticsError> {
        if (self.taken[0]..=self.taken[1]).contains(&value) {
            return Ok(());
        }
        let (unit, given) = (self.unit, format!("{} is {} {}", self.what, in_words(value), self.unit));
        let probably = match meant(value, self.common) {
            Some(meant) => format!("probably {} {unit} is meant", in_words(meant)),
            None => format!("usual are {} to {} {unit}", self.common[0], self.common[1]),
        };
        Err(OpticsError::Unusual { given, probably })
    }
}

/// The value in another unit of length, if it is common in that unit.
pub(super) fn meant(value: f64, [low, high]: [f64; 2]) -> Option<f64> {
    let units = [1e3, 1e6, 1e9, 1e-3, 1e-6, 1e-9];
    units.into_iter().map(|factor| value * factor).find(|v| (low * 0.999..=high * 1.001).contains(v))
}

/// Formats a value with up to four decimals and without trailing zeros.
pub(super) fn in_words(value: f64) -> String {
    if (1e-3..1e6).contains(&value.abs()) { format!("{}", (value * 1e4).round() / 1e4) } else { format!("{value:e}") }
}

/// The probable meaning of an impossible length, with its unit, for messages. It is empty if no unit fits.
pub(super) fn guess(what: &str, value: f64) -> String {
    let all = [PITCH, WAVELENGTH, FOCAL_LENGTH];
    let known = all.into_iter().find(|usual| what.starts_with(usual.what));
    known
        .and_then(|u| meant(value, u.common))
        .map_or_else(String::new, |v| format!("; probably {} is meant", in_words(v)))
}

/// Rejects a number of a file that is out of its range. `name` is the quantity with its unit.
pub(super) fn within(name: &str, value: f64, low: f64, high: f64) -> Result<(), Reason> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(reason!("range", "{name} is {value}: it must be {low} to {high}"))
    }
}
