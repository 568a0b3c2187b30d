//! Tests trackers that report the velocity of the eye.

use super::*;
use crate::trackers::{Quantity, Reading, Sample, Unit};
use proptest::prelude::*;

const RADIUS: f64 = 11e-3;

/// Sample number `index` of 120 per second from time 0 on, of a pupil or a direction, with its position and the
/// velocity that the tracker reports.
fn sample(index: u64, quantity: Quantity, unit: Unit, position: [f64; 2], velocity: Option<[f64; 2]>) -> Sample {
    let reading = Reading { velocity, ..Reading::new(quantity, unit, position) }.checked();
    let time_ns = 1_000_000_000 + index * 1_000_000_000 / 120;
    Sample { time_ns, combined: Some(reading), ..Sample::empty(time_ns) }
}

/// The velocity of a pupil that rests, then moves to the right at 5 mm/s, with or without reported velocities.
fn followed(samples: u64, tells: bool) -> EyeVelocity {
    let mut estimator = Estimator::new(Settings::default(), None).unwrap();
    for i in 0..60 + samples {
        let (since, speed) = (i.saturating_sub(60) as f64 / 120.0, if i < 60 { 0.0 } else { 5e-3 });
        let velocity = tells.then_some([speed, 0.0]);
        estimator.update(&sample(i, Quantity::Pupil, Unit::Metres, [speed * since, 0.0], velocity));
    }
    estimator.velocity()
}

/// A reported velocity counts from its first sample on, while a slope takes a good part of half a second.
#[test]
fn what_is_told_is_known_at_once() {
    let speed = 5e-3;
    let [told, found] = [true, false].map(|tells| followed(6, tells));
    assert!((told.pupil[0] - speed).abs() < 1e-12 && told.pupil[1] == 0.0, "{told:?}");
    let (turning, spread) = told.turning.unwrap();
    assert!((turning[0] - speed / RADIUS).abs() < 1e-9 && turning[1] == 0.0 && spread < 0.3, "{told:?}");
    let (slope, _) = found.turning.unwrap();
    assert!(slope[0] < 0.6 * turning[0], "{found:?} knows as well");
    let late = followed(120, false).turning.unwrap();
    assert!((late.0[0] - speed / RADIUS).abs() < 0.05, "{late:?}");
}

/// The spread of the velocity is the difference between consecutive velocities.
#[test]
fn what_changes_from_sample_to_sample_is_not_sure() {
    let mut noise = fastrand::Rng::with_seed(1);
    let mut estimator = Estimator::new(Settings::default(), None).unwrap();
    for i in 0..240 {
        let velocity = [0, 1].map(|_| 1e-3 * (2.0 * noise.f64() - 1.0));
        estimator.update(&sample(i, Quantity::Pupil, Unit::Metres, [0.0; 2], Some(velocity)));
    }
    let (_, spread) = estimator.velocity().turning.unwrap();
    // A uniform distribution between -1 and 1 mm/s has a standard deviation of 0.58 mm/s.
    let is = spread * RADIUS;
    assert!((0.4e-3..0.8e-3).contains(&is), "{is}");
}

#[test]
fn an_eye_that_jumps_or_is_closed_has_no_velocity() {
    let mut estimator = Estimator::new(Settings::default(), None).unwrap();
    let at = |x: f64| (Quantity::Pupil, Unit::Metres, [x, 0.0]);
    for i in 0..120 {
        let (quantity, unit, position) = at(0.0);
        estimator.update(&sample(i, quantity, unit, position, Some([1e-3, 0.0])));
    }
    assert!(estimator.velocity().turning.is_some());
    for i in 120..123 {
        let (quantity, unit, position) = at(1e-3 * (i - 119) as f64);
        estimator.update(&sample(i, quantity, unit, position, Some([0.12, 0.0])));
    }
    assert_eq!((estimator.phase(), estimator.velocity()), (Phase::Saccade, EyeVelocity::default()));
    for i in 123..180 {
        estimator.update(&sample(i, Quantity::Pupil, Unit::Metres, [f64::NAN, 0.0], Some([0.12, 0.0])));
    }
    assert_eq!((estimator.phase(), estimator.velocity()), (Phase::Lost, EyeVelocity::default()));
}

proptest! {
    /// A velocity is mapped like the difference of two places, in any unit, by rotation and by calibration. A velocity
    /// that no eye reaches is dropped.
    #[test]
    fn velocities_are_placed_as_positions_are(
        kind in 0usize..4, calibrated: bool, x in -0.2f64..0.2, y in -0.2f64..0.2, vx in -2.0f64..2.0, vy in -2.0f64..2.0,
    ) {
        let (quantity, unit, scale) = [
            (Quantity::Pupil, Unit::Metres, 1e-2),
            (Quantity::Gaze, Unit::Radians, 1.0),
            (Quantity::Pupil, Unit::Normalized, 0.3),
            (Quantity::Gaze, Unit::Metres, 0.5),
        ][kind];
        let calibration = Calibration {
            user: "u".into(),
            tracker: None,
            left: None,
            right: None,
            combined: Some(Fit {
                unit,
                map: Affine { x: [8e-3 / scale, 1e-3 / scale, 1e-4], y: [-1e-3 / scale, 9e-3 / scale, -2e-4] },
                residual: 1e-4,
                used: [5, 0],
            }),
        };
        let place = |position: [f64; 2], velocity| {
            let mut placer = place::Placer::new(Settings::default(), calibrated.then(|| calibration.clone()));
            placer.place(&sample(0, quantity, unit, position, velocity), 1e-4).unwrap()
        };
        let (at, velocity) = ([x, y].map(|v| v * scale), [vx, vy].map(|v| v * scale));
        let is = place(at, Some(velocity)).velocity.expect("an eye's");
        let soon = |t: f64| place([0, 1].map(|i| at[i] + t * velocity[i]), None).position;
        let (before, after) = (soon(-1e-3), soon(1e-3));
        for i in 0..2 {
            let way = (after[i] - before[i]) / 2e-3;
            prop_assert!((is[i] - way).abs() <= 1e-3 * way.abs() + 1e-5, "{is:?}, not {way}");
        }
        prop_assert!(place(at, None).velocity.is_none());
        prop_assert!(place(at, Some([f64::NAN, 0.0])).velocity.is_none());
        prop_assert!(place(at, Some([1e5 * scale, 0.0])).velocity.is_none());
    }
}
