//! Reports the result of each stage for a sample.

use super::one_euro::OneEuro;
use super::place::{Placed, Refusal};
use super::saccade::Flight;
use serde::Serialize;

/// The current movement of the eye.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// No sample was seen yet.
    Unseen,
    /// The eye rests or follows something.
    Steady,
    /// The eye makes a saccade.
    Saccade,
    /// The eye is not seen, because of a blink or a loss of the tracker.
    Lost,
    /// The eye is seen again while the lid still moves.
    Returning,
}

/// The result of each stage for a sample.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stages {
    /// The place in the pupil plane, or the reason for the refusal of the sample.
    pub placed: Result<Placed, Refusal>,
    /// The state of the filter, if the eye is steady.
    pub filtered: Option<OneEuro>,
    /// The saccade, if there is one.
    pub saccade: Option<Flight>,
    /// The current movement of the eye.
    pub phase: Phase,
    /// Measured standard deviation of the tracker's coordinates, meters.
    pub noise: f64,
}

impl std::fmt::Display for Stages {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mm = |p: &[f64; 2]| format!("({:.3}, {:.3}) mm", p[0] * 1e3, p[1] * 1e3);
        match &self.placed {
            Ok(placed) => write!(f, "placed {}", mm(&placed.position))?,
            Err(refusal) => write!(f, "refused: {refusal}")?,
        }
        write!(f, "; noise {:.3} mm; {:?}", self.noise * 1e3, self.phase)?;
        if let Some(filter) = &self.filtered {
            let speed = filter.velocity[0].hypot(filter.velocity[1]);
            write!(f, " at {}, {:.1} mm/s, {:.1} ms late", mm(&filter.position), speed * 1e3, filter.lag * 1e3)?;
        }
        if let Some(jump) = &self.saccade {
            write!(f, " to {} +- {:.2} mm", mm(&jump.landing), jump.spread * 1e3)?;
        }
        Ok(())
    }
}
