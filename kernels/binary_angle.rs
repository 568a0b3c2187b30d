//! Stores phases as binary angles, 16 bits per turn, and velocities as halves. This is the CPU twin of
//! `binary_angle.glsl`.
//!
//! One unit is 2 pi / 65536 = 9.6e-5 rad. A phase moves by whole units. The movement is rounded up as often as its
//! fraction says, otherwise down. With rounding to the nearest unit, steps of less than half a unit would have no
//! effect, however many there are. Velocities are rounded in the same way. A threshold of each pixel and step
//! determines the direction. The thresholds of a pixel are spread evenly over the steps by the golden ratio, and they
//! are random from pixel to pixel. The twin keeps the float32 values that the angles of a device represent.

use crate::half::{LARGEST, rounded as half_rounded};
use crate::trig::PER_TURN;

/// Number of units per turn.
const UNITS: f32 = 65536.0;
/// Number of radians per unit.
pub(crate) const UNIT: f32 = std::f32::consts::TAU / UNITS;
/// Resolution of a threshold as a fraction of a unit: 2^-24.
pub(crate) const PART: f32 = 1.0 / 16_777_216.0;

/// Returns the angle nearest to a phase.
#[inline(always)]
fn bits(phase: f32) -> u16 {
    let turns = phase * PER_TURN;
    ((turns - turns.round_ties_even()) * UNITS).round_ties_even() as i32 as u16
}

/// Returns the phase of an angle, -pi .. pi.
#[inline(always)]
pub(crate) fn value(bits: u16) -> f32 {
    f32::from(bits as i16) * UNIT
}

/// Returns the angles nearest to these phases.
pub fn pack(phases: &[f32]) -> Vec<u16> {
    phases.iter().map(|phase| bits(*phase)).collect()
}

/// Returns the phases of these angles.
pub fn unpack(angles: &[u16]) -> Vec<f32> {
    angles.iter().map(|angle| value(*angle)).collect()
}

/// Replaces each phase by the phase of its nearest angle.
pub fn round(phases: &mut [f32]) {
    phases.iter_mut().for_each(|phase| *phase = value(bits(*phase)));
}

/// Returns the threshold of a pixel in a step. The mixer of 32 bits is written out because the shaders (project.glsl)
/// compute the same.
#[inline(always)]
pub(crate) fn threshold(pixel: u32, step: u32) -> u32 {
    let mut x = pixel;
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    (x ^ (x >> 16)).wrapping_add(step.wrapping_mul(0x9e37_79b9))
}

/// Turns the phase of an angle by `by` radians and returns the phase of an angle. `phase` must be the phase of an
/// angle. The result wraps by whole turns. If `bound` is not 0, it stays within 0 .. `bound` radians of the drive.
#[inline(always)]
pub(crate) fn turned(phase: f32, by: f32, bound: f32, threshold: u32) -> f32 {
    let turns = by * PER_TURN;
    if bound > 0.0 {
        let most = (bound * PER_TURN * UNITS).round_ties_even();
        let to = f32::from(bits(phase)) + (turns * UNITS + (threshold >> 8) as f32 * PART).floor();
        return value(to.max(0.0).min(most) as u16);
    }
    let turns = turns - turns.round_ties_even();
    let units = (turns * UNITS + (threshold >> 8) as f32 * PART).floor();
    value(bits(phase).wrapping_add(units as i32 as u16))
}

/// Returns `x`, rounded up or down to a half as the threshold decides.
#[inline(always)]
pub(crate) fn velocity(x: f32, threshold: u32) -> f32 {
    let x = x.clamp(-LARGEST, LARGEST);
    let size = x.abs();
    // Halves below 2^-14 are 6e-8 rad apart.
    if size < 6.103_515_6e-5 {
        return half_rounded(x);
    }
    f32::from_bits(((size.to_bits() + (threshold & 0x1fff)) & !0x1fff).min(LARGEST.to_bits())).copysign(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURN: f32 = std::f32::consts::TAU;

    #[test]
    fn angles_come_back() {
        let all: Vec<u16> = (0..=u16::MAX).collect();
        assert_eq!(pack(&unpack(&all)), all);
        for phase in [0.0, 1e-5, 3.1, -3.15, 7.0, -100.0, 5000.0] {
            let off = f64::from(value(bits(phase))) - f64::from(phase);
            assert!(off.sin().abs() < 0.51 * f64::from(UNIT) + 3e-7 * f64::from(phase.abs()), "{phase}: {off}");
        }
    }

    /// Two hundred steps of a fraction of a unit add up to the float32 result within three units.
    #[test]
    fn small_steps_are_not_lost() {
        for part in [0.004f32, 0.02, 0.3, 0.5, 1.7, -0.01, -0.6] {
            let mut mean = 0.0;
            for pixel in 0..1000 {
                let (mut phase, mut velocity_) = (value(bits(3.1)), 0.0);
                let mut exact = 0.0;
                for step in 0..200 {
                    let (by, threshold) = (part * UNIT, threshold(pixel, step));
                    exact += f64::from(part);
                    phase = turned(phase, by, 0.0, threshold);
                    velocity_ = velocity(0.9 * velocity_ + by, threshold);
                }
                let moved = f64::from(bits(phase).wrapping_sub(bits(3.1)) as i16);
                assert!((moved - exact).abs() < 3.0, "{part}: {moved} units of {exact}");
                mean += (moved - exact) / 1000.0;
                let settled = f64::from(velocity_) / (10.0 * f64::from(part * UNIT));
                assert!((settled - 1.0).abs() < 0.1, "{part}: {settled}");
            }
            assert!(mean.abs() < 0.05, "{part}: {mean}");
        }
    }

    /// Angles within a range of the drive reach its ends, do not pass them, and lose no small step.
    #[test]
    fn bounded_angles_cross_no_wrap() {
        let bound = TURN * 255.0 / 256.0;
        let drive = |phase: f32| if phase < 0.0 { phase + TURN } else { phase };
        for (start, by, want) in [
            (0.1f32, -0.2f32, 0.0),
            (6.1, 0.4, bound),
            (3.0, 0.5, 3.5),
            (-0.5, 0.2, TURN - 0.3),
            (1.0, 100.0, bound),
            (1.0, -100.0, 0.0),
        ] {
            for step in 0..20 {
                let got = drive(turned(value(bits(start)), by, bound, threshold(7, step)));
                assert!(
                    (got - want).abs() < 2.5 * UNIT && got <= bound + 0.1 * UNIT,
                    "{start} by {by}: {got}, not {want}"
                );
            }
        }
        let mut phase = value(bits(3.0));
        (0..1000).for_each(|step| phase = turned(phase, 0.3 * UNIT, bound, threshold(5, step)));
        assert!((drive(phase) - 3.0 - 300.0 * UNIT).abs() < 3.0 * UNIT, "{phase}");
    }

    #[test]
    fn velocities_are_halves() {
        for (i, x) in [0.0f32, 1e-7, 3e-5, 7e-5, 0.1, -2.3, 900.0, 1e9, -1e9].into_iter().enumerate() {
            for step in 0..100 {
                let got = velocity(x, threshold(i as u32, step));
                assert_eq!(half_rounded(got), got);
                let x = x.clamp(-LARGEST, LARGEST);
                assert!((got - x).abs() <= 6e-8 + x.abs() / 1024.0 && got * x >= 0.0, "{x}: {got}");
            }
        }
    }
}
