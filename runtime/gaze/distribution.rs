//! Where the pupil will be: a distribution.

use crate::optics::Pupil;
use serde::Serialize;
use std::f64::consts::TAU;

/// Where the pupil will be at a time, how wide, and what it focuses on.
///
/// The centre is normal with standard deviation `spread` along x and y each: with probability 0.86 the pupil is within
/// two spreads, with 0.99 within three, but for the share `elsewhere` that it has left by a saccade nobody could
/// foresee, or has not arrived yet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PupilDistribution {
    /// The time that it is for, nanoseconds of the samples' clock.
    pub time_ns: u64,
    /// Centre, metres.
    pub centre: [f64; 2],
    /// Standard deviation along each axis, metres.
    pub spread: f64,
    /// Smallest and largest diameter, metres.
    pub diameter: [f64; 2],
    /// Nearest and farthest focus, metres.
    pub focus: [f64; 2],
    /// Probability that none of this holds.
    pub elsewhere: f64,
}

impl PupilDistribution {
    /// The pupil at a point of the unit cube: two numbers for the centre, one for the diameter, one for the focus.
    pub fn pupil(&self, [u, v, d, z]: [f64; 4]) -> Pupil {
        // Box and Muller; u = 1 would be infinitely far.
        let radius = self.spread * (-2.0 * (1.0 - u.clamp(0.0, 1.0 - 1e-9)).ln()).sqrt();
        let between = |[low, high]: [f64; 2], u: f64| low + (high - low) * u;
        Pupil {
            x: self.centre[0] + radius * (TAU * v).cos(),
            y: self.centre[1] + radius * (TAU * v).sin(),
            diameter: between(self.diameter, d),
            depth: between(self.focus, z),
        }
    }
}

impl std::fmt::Display for PupilDistribution {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mm = |v: f64| v * 1e3;
        write!(
            f,
            "pupil ({:.3}, {:.3}) +- {:.3} mm, {:.1}..{:.1} mm wide, focus {:.2}..{:.2} mm, elsewhere {:.0} %",
            mm(self.centre[0]),
            mm(self.centre[1]),
            mm(self.spread),
            mm(self.diameter[0]),
            mm(self.diameter[1]),
            mm(self.focus[0]),
            mm(self.focus[1]),
            self.elsewhere * 100.0
        )
    }
}
