//! The movement of eye and content while the sub-frames of a set are lit (OPTICS 15).

use super::error::{SolveError, require};
use crate::optics::Pupil;
use crate::plan::{Moving, Viewpoint};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Highest allowed velocity of a picture, in pixels per set. It keeps all computed values finite.
const FASTEST: f64 = 1e4;

/// The movement of eye and content while the sub-frames of a set are lit. By default nothing moves. A set is as long as
/// the sub-frames that an eye averages.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Motion {
    /// Velocity of the content, in pixels per set (x, y).
    pub content: [f64; 2],
    /// Time at which the content is where the scene shows it, in sets from the middle of the light.
    pub at: f64,
    /// Velocity of the eye's rotation, in pixels per set (x, y). If it is `None`, the eye rests in half of the draws
    /// and follows the content in the others.
    pub eye: Option<[f64; 2]>,
    /// Radius of a disc around that velocity from which velocities are drawn evenly, in pixels per set.
    pub spread: f64,
    /// Movement of the pupil as the eye turns, in meters per set (x, y).
    pub drift: [f64; 2],
    /// Time at which the sub-frames are lit, as its middle relative to the middle of the set and its length, in sets.
    pub lit: [f64; 2],
    /// Number of consecutive sub-frames that an eye averages, or `None` for all. The first sub-frame follows the last
    /// one. Each pupil is drawn with its own window, so that any window is a good set.
    pub window: Option<usize>,
    /// The sub-frame of a rolling set that is lit first. The sub-frames before it follow after the last one.
    #[serde(skip)]
    pub first: usize,
}

impl Default for Motion {
    fn default() -> Self {
        let still = [0.0; 2];
        Self { content: still, at: 0.0, eye: None, spread: 0.0, drift: still, lit: [0.0, 1.0], window: None, first: 0 }
    }
}

impl Motion {
    /// Returns true if nothing moves, so that all sub-frames could be lit at once.
    pub fn is_still(&self) -> bool {
        let rests = |v: [f64; 2]| v == [0.0; 2];
        let Self { content, eye, spread, drift, window, .. } = *self;
        rests(content) && eye.is_none_or(rests) && spread == 0.0 && rests(drift) && window.is_none()
    }

    /// Returns an error for impossible values.
    pub(super) fn check(&self, frames: usize) -> Result<(), SolveError> {
        let fits = |v: [f64; 2]| v.iter().all(|v| v.abs() <= FASTEST);
        let Self { content, eye, spread, drift, at, lit: [middle, length], window, first } = *self;
        let is_slow = fits(content) && eye.is_none_or(fits) && (0.0..=FASTEST).contains(&spread);
        let velocities = format_args!("{content:?}, {eye:?}, {spread}");
        require(is_slow, "a velocity (pixels per set)", velocities, "numbers within 1e4")?;
        let is_near = drift.iter().all(|v| v.abs() <= 1.0) && at.abs() <= FASTEST;
        let (what, right) = ("the motion of the pupil (m per set)", "numbers within 1, within 1e4 sets");
        require(is_near, what, format_args!("{drift:?} at {at}"), right)?;
        let is_within = middle.abs() <= 1.0 && length > 0.0 && length <= 1.0;
        let times = format_args!("{middle}, {length}");
        require(is_within, "the time at which sub-frames are lit (sets)", times, "within the set")?;
        let is_of_set = first < frames.max(1) && (first == 0 || window.is_none_or(|n| n >= frames));
        require(is_of_set, "the sub-frame that is lit first", first, "one of the set, 0 of a stream")?;
        let Some(window) = window else { return Ok(()) };
        let (what, right) = ("the sub-frames that an eye averages", "1 to the number of sub-frames");
        require((1..=frames).contains(&window), what, window, right)
    }

    /// Returns true if pupils drawn for `other` suit this motion as well, within a quarter of a pixel over a set.
    pub(super) fn is_served_by(&self, other: &Self) -> bool {
        let close = |a: [f64; 2], b: [f64; 2], slack: f64| (0..2).all(|i| (a[i] - b[i]).abs() <= slack);
        let speed = self.content[0].hypot(self.content[1]);
        close(self.content, other.content, 0.25)
            && (self.at - other.at).abs() * speed <= 0.25
            && self.eye.is_some() == other.eye.is_some()
            && close(self.eye.unwrap_or_default(), other.eye.unwrap_or_default(), 0.25)
            && close(self.drift, other.drift, 2e-5)
            && (self.spread - other.spread).abs() <= 0.25
            && (self.lit, self.window, self.first) == (other.lit, other.window, other.first)
    }

    /// Returns the viewpoint of a pupil on `frames` sub-frames that were refined for this motion. Its eye turns as
    /// expected, or rests if no rotation is given.
    pub fn seen_through(&self, pupil: Pupil, frames: usize) -> Viewpoint {
        let known = Self { eye: Some(self.eye.unwrap_or_default()), spread: 0.0, window: None, ..*self };
        known.viewpoint(pupil, frames, [0.0; 4])
    }

    /// Returns the viewpoint of a pupil on `frames` sub-frames, at a point of the unit cube. The point decides the
    /// rotation, the distance and direction from the expected velocity, and the window.
    pub(super) fn viewpoint(&self, pupil: Pupil, frames: usize, [turns, radius, angle, first]: [f64; 4]) -> Viewpoint {
        if self.is_still() {
            return Viewpoint::Pupil(pupil);
        }
        let (off, angle) = (self.spread * radius.sqrt(), TAU * angle);
        let around = |v: [f64; 2]| [v[0] + off * angle.cos(), v[1] + off * angle.sin()];
        let eye = match self.eye {
            Some(eye) => around(eye),
            None if turns < 0.5 => [0.0; 2],
            None => around(self.content),
        };
        let count = self.window.unwrap_or(frames);
        let first = if count < frames { ((first * frames as f64) as usize).min(frames - 1) } else { self.first };
        let Self { drift, content, at, lit: [middle, length], .. } = *self;
        // An eye that begins at another sub-frame counts from the time at which the set would have begun with number 0.
        let lit = [middle - length * self.first as f64 / frames.max(1) as f64, length];
        Viewpoint::Moving(Moving { pupil, drift, eye, content, at, lit, first, count })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(motion: Motion, point: [f64; 4]) -> Moving {
        match motion.viewpoint(Pupil::from_mm([0.0, 0.0, 4.0, 0.0]), 16, point) {
            Viewpoint::Moving(moving) => moving,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn eyes_rest_or_follow_and_windows_go_round() {
        let motion = Motion { content: [10.0, 0.0], spread: 2.0, window: Some(8), ..Motion::default() };
        assert_eq!(drawn(motion, [0.2, 1.0, 0.0, 0.0]).eye, [0.0, 0.0]);
        assert_eq!(drawn(motion, [0.7, 1.0, 0.0, 0.0]).eye, [12.0, 0.0]);
        assert_eq!([0.0, 0.5, 0.999].map(|u| drawn(motion, [0.0, 0.0, 0.0, u]).first), [0, 8, 15]);
        // A known rotation is used in every draw.
        let known = Motion { eye: Some([3.0, -1.0]), ..motion };
        assert_eq!(drawn(known, [0.2, 0.0, 0.0, 0.0]).eye, [3.0, -1.0]);
        let pupil = Pupil::from_mm([1.0, 2.0, 3.0, 0.0]);
        assert_eq!(Motion::default().viewpoint(pupil, 8, [0.7; 4]), Viewpoint::Pupil(pupil));
    }

    /// For every first sub-frame, the following ones are lit one after the other, a sixteenth of a set apart.
    #[test]
    fn a_set_that_rolls_begins_with_any_of_its_sub_frames() {
        for first in 0..16 {
            let motion = Motion { content: [16.0, 0.0], first, lit: [15.0 / 32.0, 1.0], ..Motion::default() };
            let moments = drawn(motion, [0.0; 4]).moments(16);
            for (i, moment) in moments.iter().enumerate() {
                let after = (i + 16 - first) % 16;
                assert!(moment.seen && (moment.content[0] - after as f64).abs() < 1e-12, "{first}, {i}: {moment:?}");
            }
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let still = Motion::default();
        assert!(still.check(8).is_ok());
        for wrong in [
            Motion { content: [f64::NAN, 0.0], ..still },
            Motion { spread: -1.0, ..still },
            Motion { eye: Some([0.0, f64::INFINITY]), ..still },
            Motion { drift: [2.0, 0.0], ..still },
            Motion { at: f64::NAN, ..still },
            Motion { lit: [0.0, 0.0], ..still },
            Motion { window: Some(0), ..still },
            Motion { window: Some(9), ..still },
            Motion { first: 8, ..still },
            Motion { window: Some(4), first: 1, ..still },
        ] {
            assert!(wrong.check(8).is_err(), "{wrong:?}");
        }
    }
}
