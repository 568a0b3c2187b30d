//! What became of a sample at each stage on its way to the pupil.

use super::one_euro::OneEuro;
use super::place::{Placed, Refusal};
use super::saccade::Flight;
use serde::Serialize;

/// What the eye does, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Nothing has been seen yet.
    Unseen,
    /// It rests, or follows something.
    Steady,
    /// It jumps.
    Saccade,
    /// It is not seen: a blink, or the tracker has lost it.
    Lost,
    /// It is seen again, the lid still moving.
    Returning,
}

/// What each stage made of a sample.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stages {
    /// The place in the pupil plane, or why the sample is not believed.
    pub placed: Result<Placed, Refusal>,
    /// The filter, where the eye is steady.
    pub filtered: Option<OneEuro>,
    /// The saccade, where there is one.
    pub saccade: Option<Flight>,
    /// What the eye does.
    pub phase: Phase,
    /// Standard deviation of the tracker's coordinates, measured, metres.
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
