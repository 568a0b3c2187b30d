//! Describes the expected pupil by a probability distribution.

use super::Pupil;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// The distribution of the position, diameter and focus of the pupil, now or at a later time.
///
/// The center is normal with standard deviation `spread` along x and y each. The pupil is within two spreads with
/// probability 0.86, and within three with probability 0.99. The exception is the share `elsewhere`, in which a saccade
/// that could not be predicted has moved the pupil away, or a predicted one has not arrived yet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PupilDistribution {
    /// Center (x, y) in meters.
    pub centre: [f64; 2],
    /// Standard deviation along each axis in meters.
    pub spread: f64,
    /// Smallest and largest diameter in meters.
    pub diameter: [f64; 2],
    /// Nearest and farthest focus in meters.
    pub focus: [f64; 2],
    /// Probability that the distribution does not apply and the pupil is anywhere in the eyebox.
    pub elsewhere: f64,
}

/// Pupils are drawn within this many standard deviations.
const FARTHEST: f64 = 3.0;

impl PupilDistribution {
    /// A distribution with the center accurate to `spread` meters (a standard deviation), and the diameter accurate to within half
    /// a millimeter.
    pub fn around(pupil: &Pupil, spread: f64) -> Self {
        let Pupil { x, y, diameter, depth } = *pupil;
        let half = 0.5e-3f64.min(diameter / 2.0);
        let diameter = [diameter - half, diameter + half];
        Self { centre: [x, y], spread, diameter, focus: [depth; 2], elsewhere: 0.0 }
    }

    /// The pupil in the middle of the distribution.
    pub fn middle(&self) -> Pupil {
        self.pupil([0.0, 0.0, 0.5, 0.5])
    }

    /// The pupil at a point of the unit cube. Two numbers give the center (Box and Muller), one the diameter, and one
    /// the focus. No center is farther out than three spreads.
    pub fn pupil(&self, [u, v, d, z]: [f64; 4]) -> Pupil {
        // u = 1 would be infinitely far.
        let radius = self.spread * (-2.0 * (1.0 - u).max(1e-9).ln()).sqrt().min(FARTHEST);
        let between = |[low, high]: [f64; 2], u: f64| low + (high - low) * u;
        Pupil {
            x: self.centre[0] + radius * (TAU * v).cos(),
            y: self.centre[1] + radius * (TAU * v).sin(),
            diameter: between(self.diameter, d),
            depth: between(self.focus, z),
        }
    }

    /// Largest distance in meters from the center to a drawn pupil's edge.
    pub fn reach(&self) -> f64 {
        FARTHEST * self.spread + self.diameter[1] / 2.0
    }

    /// Distance in meters between the centers of two distributions.
    pub fn distance(&self, other: &Self) -> f64 {
        (self.centre[0] - other.centre[0]).hypot(self.centre[1] - other.centre[1])
    }

    /// True if pupils drawn from another distribution serve this one as well. The allowed difference is the motion of
    /// an eye during a fixation.
    pub fn is_served_by(&self, other: &Self) -> bool {
        let slack = 0.5 * self.spread.max(other.spread);
        let close = |a: [f64; 2], b: [f64; 2], slack: f64| (0..2).all(|i| (a[i] - b[i]).abs() <= slack);
        self.distance(other) <= slack
            && close(self.diameter, other.diameter, 0.05 * self.diameter[1])
            && close(self.focus, other.focus, 0.0)
            && self.spread >= 0.5 * other.spread
            && other.spread >= 0.5 * self.spread
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
