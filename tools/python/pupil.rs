//! Pupils as Python passes them.

use eyebox::optics::Pupil;

/// The x (right), y (down), diameter and depth (positive is nearer) of a pupil, in meters.
pub(crate) type Numbers = (f64, f64, f64, f64);

/// Makes a pupil from its four numbers.
pub(crate) fn pupil((x, y, diameter, depth): Numbers) -> Pupil {
    Pupil { x, y, diameter, depth }
}
