//! Represents phases as wrapped numbers and as gray levels.

use std::f32::consts::PI;

/// The same phase in [-pi, pi), radians, with pi as a float32. A phase in that range keeps its bits.
#[inline]
pub fn wrap_phase(phase: f32) -> f32 {
    if (-PI..PI).contains(&phase) {
        return phase;
    }
    let turns = f64::from(phase) / std::f64::consts::TAU;
    let wrapped = ((turns - turns.round()) * std::f64::consts::TAU) as f32;
    if (-PI..PI).contains(&wrapped) { wrapped } else { -PI }
}

/// The nearest of 256 gray levels per turn, `round(phase / 2 pi * 256) mod 256`.
#[inline]
pub fn level_of_phase(phase: f32) -> u8 {
    let level = f64::from(phase) / std::f64::consts::TAU * 256.0;
    level.round().rem_euclid(256.0) as u8
}

/// The phase of a gray level, in [-pi, pi).
#[inline]
pub fn phase_of_level(level: u8) -> f32 {
    // Levels from 128 on are the negative half turn, as in two's complement.
    (f64::from(level as i8) / 256.0 * std::f64::consts::TAU) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn levels_go_round() {
        for level in 0..=255 {
            assert_eq!(level_of_phase(phase_of_level(level)), level);
        }
        assert_eq!(
            (level_of_phase(PI), level_of_phase(-PI), level_of_phase(-0.001), level_of_phase(2.0 * PI - 0.001)),
            (128, 128, 0, 0)
        );
        assert_eq!((phase_of_level(128), phase_of_level(64)), (-PI, PI / 2.0));
    }

    proptest! {
        #[test]
        fn wrapping_keeps_the_angle(phase in -1e4f32..1e4) {
            let wrapped = wrap_phase(phase);
            prop_assert!((-PI..PI).contains(&wrapped));
            let turns = (f64::from(wrapped) - f64::from(phase)) / std::f64::consts::TAU;
            prop_assert!((turns - turns.round()).abs() < 1e-6);
            prop_assert_eq!(wrap_phase(wrapped).to_bits(), wrapped.to_bits());
        }
    }
}
