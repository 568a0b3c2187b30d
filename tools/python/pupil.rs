//! Pupils as Python gives them.

use eyebox::optics::Pupil;

/// x (right), y (down), diameter, depth (nearer is positive) of a pupil, metres.
pub(crate) type Numbers = (f64, f64, f64, f64);

/// The pupil.
pub(crate) fn pupil((x, y, diameter, depth): Numbers) -> Pupil {
    Pupil { x, y, diameter, depth }
}
