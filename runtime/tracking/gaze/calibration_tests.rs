//! Tests fits of a calibration, for trackers that follow the eye and for others.

use super::*;
use crate::trackers::Unit;

pub(super) fn off(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

pub(super) fn targets() -> Vec<Pair> {
    let map = Affine { x: [2e-5, 3e-6, -1e-3], y: [-1e-6, 1.5e-5, 2e-3] };
    (0..9)
        .map(|i| {
            let tracker = [f64::from(i % 3) * 100.0 + 300.0, f64::from(i / 3) * 80.0 - 50.0];
            Pair { tracker, pupil: map.apply(tracker) }
        })
        .collect()
}

#[test]
fn a_calibration_finds_the_map_and_gives_up_outliers() {
    let mut pairs = targets();
    let fit = Fit::new(&pairs, Unit::Counts).unwrap();
    assert!(fit.residual < 1e-12 && fit.used == [9, 0]);
    assert!(
        off(fit.map.apply([123.0, 45.0]), [2e-5 * 123.0 + 3e-6 * 45.0 - 1e-3, -1e-6 * 123.0 + 1.5e-5 * 45.0 + 2e-3])
            < 1e-12
    );
    // Noise is added, and one fixation is on the wrong target, in a corner where it has most weight.
    for (i, pair) in pairs.iter_mut().enumerate() {
        pair.pupil[i % 2] += if i % 3 == 0 { 0.1e-3 } else { -0.05e-3 };
    }
    pairs[8].pupil = pairs[0].pupil;
    let fit = Fit::new(&pairs, Unit::Counts).unwrap();
    assert_eq!(fit.used, [8, 1]);
    assert!(fit.residual < 0.15e-3, "{}", fit.residual);
    for pair in targets() {
        assert!(off(fit.map.apply(pair.tracker), pair.pupil) < 0.3e-3);
    }
    pairs[3].pupil[0] = f64::NAN;
    assert_eq!(Fit::new(&pairs, Unit::Counts).unwrap().used, [7, 2]);
}

#[test]
fn a_calibration_that_cannot_be_is_refused() {
    let pairs = targets();
    assert!(matches!(Fit::new(&pairs[..2], Unit::Counts), Err(GazeError::TooFew(_))));
    assert!(matches!(Fit::new(&pairs[..3], Unit::Counts), Err(GazeError::TooFew(_))), "on a line");
    let corners = [pairs[0], pairs[2], pairs[6]];
    assert!(matches!(Fit::new(&corners, Unit::Counts), Err(GazeError::TooFew(_))), "they fit anything");
    let mut mixed = targets();
    for (i, pair) in mixed.iter_mut().enumerate() {
        pair.pupil = [(i * 7 % 9) as f64 * 1e-3, (i * 5 % 9) as f64 * 1e-3];
    }
    assert!(matches!(Fit::new(&mixed, Unit::Counts), Err(GazeError::Disagree { .. })));
}

/// A tracker that does not follow the eye has no calibration, even if the targets are near each other.
#[test]
fn a_tracker_that_shows_nothing_of_the_eye_is_refused() {
    for apart in [0.3, 1.0, 3.0] {
        let near: Vec<Pair> =
            targets().iter().map(|p| Pair { pupil: p.pupil.map(|v| v * apart / 3.0), ..*p }).collect();
        assert!(Fit::new(&near, Unit::Counts).is_ok());
        for seed in 0..20 {
            let mut random = fastrand::Rng::with_seed(seed);
            let blind = near.iter().map(|p| Pair { tracker: [random.f64() * 400.0, random.f64() * 300.0], ..*p });
            let answer = Fit::new(&blind.collect::<Vec<_>>(), Unit::Counts);
            assert!(matches!(answer, Err(GazeError::Disagree { .. })), "{apart} mm, {seed}: {answer:?}");
        }
    }
}
