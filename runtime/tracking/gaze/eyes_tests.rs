//! Tests the placement of pupils for cameras that alternate and for clocks that were set.

use super::place::{Placer, Refusal};
use super::{Estimator, Eye, Phase, Settings};
use crate::trackers::{Quantity, Reading, Sample, Unit};

const START_NS: u64 = 1_000_000_000;

fn reading(position: [f64; 2]) -> Option<Reading> {
    Some(Reading::new(Quantity::Pupil, Unit::Metres, position))
}

fn sample(time_ns: u64) -> Sample {
    Sample { time_ns, ..Sample::empty(time_ns + 5_000_000) }
}

/// Left and right samples that alternate, at these places. The second camera is `lag_ns` later than the first.
fn in_turn(count: u64, rate_hz: f64, lag_ns: u64, places: [[f64; 2]; 2]) -> Vec<Sample> {
    let at = |i: u64| START_NS + (i as f64 / rate_hz * 1e9) as u64;
    (0..count)
        .flat_map(|i| {
            [
                Sample { left: reading(places[0]), ..sample(at(i)) },
                Sample { right: reading(places[1]), ..sample(at(i) + lag_ns) },
            ]
        })
        .collect()
}

/// Each sample from the second on is placed at the mean of both eyes or at the followed eye.
#[test]
fn one_eye_per_sample_in_turn_is_two_eyes() {
    let far = [[-2.2e-3, 2.0e-3], [-1.6e-3, -2.3e-3]];
    let near = [[1e-3, 0.5e-3], [1.2e-3, 0.4e-3]];
    let apart = [[-8e-3, 0.0], [8e-3, 1e-3]];
    let mut cases = 0;
    for (rate_hz, lag_ns) in [(120.0, 4_000_000), (120.0, 300_000), (30.0, 16_000_000), (200.0, 2_500_000)] {
        for places in [far, near, apart] {
            for eye in [Eye::Mean, Eye::Left, Eye::Right] {
                let settings = Settings { eye, ..Settings::default() };
                let mut estimator = Estimator::new(settings, None).unwrap();
                let [l, r] = places;
                let want = match eye {
                    Eye::Left => l,
                    Eye::Right => r,
                    Eye::Mean => [0, 1].map(|i| (l[i] + r[i]) / 2.0),
                };
                for (i, sample) in in_turn(60, rate_hz, lag_ns, places).iter().enumerate() {
                    let placed = estimator.update(sample).placed.unwrap_or_else(|e| panic!("{rate_hz} Hz, {i}: {e}"));
                    if i > 0 {
                        let off = (0..2).map(|axis| (placed.position[axis] - want[axis]).abs()).fold(0.0, f64::max);
                        assert!(off < 1e-9, "{rate_hz} Hz, {eye:?}, sample {i}: {off}");
                    }
                }
                assert_eq!((estimator.counts().placed, estimator.phase()), (120, Phase::Steady));
                let centre = estimator.predict(START_NS + 2_000_000_000).centre;
                assert!((0..2).all(|axis| (centre[axis] - want[axis]).abs() < 1e-4), "{centre:?}, not {want:?}");
                cases += 1;
            }
        }
    }
    assert_eq!(cases, 36);
}

/// An eye that moves is followed as well, and the places are on its way.
#[test]
fn eyes_in_turn_are_followed_as_they_move() {
    for (i, speed) in [0.0, 1e-3, -1e-3, 3e-3, -3e-3, 5e-3, -5e-3, 8e-3, -8e-3, 10e-3].into_iter().enumerate() {
        let mut placer = Placer::new(Settings::default(), None);
        for k in 0..240u64 {
            let since_ns = k * 4_166_667;
            let x = speed * since_ns as f64 * 1e-9;
            let offset = if k % 2 == 0 { -2e-3 } else { 2e-3 };
            let mut sample = sample(START_NS + since_ns);
            *(if k % 2 == 0 { &mut sample.left } else { &mut sample.right }) = reading([x + offset, 0.0]);
            let placed = placer.place(&sample, 1e-5).unwrap();
            // The movement of the eye from one camera's picture to the other's is the only unknown.
            assert!(k == 0 || (placed.position[0] - x).abs() <= 1e-6 + speed.abs() * 0.0042, "case {i}, sample {k}");
        }
    }
}

/// A clock that is set back costs three samples. A sample out of order costs only itself.
#[test]
fn a_clock_that_is_set_back_is_believed_after_three_samples() {
    for back_ms in [300, 400, 500, 600, 700, 800, 900, 950, 980, 999] {
        let mut estimator = Estimator::new(Settings::default(), None).unwrap();
        let (mut refused, mut after) = (Vec::new(), None);
        for i in 0..240u64 {
            let received_ns = 2 * START_NS + i * 8_333_333;
            let time_ns = received_ns - 5_000_000 - if i >= 120 { back_ms * 1_000_000 } else { 0 };
            let x = if i >= 120 { 3e-3 } else { 1e-3 };
            let sample = Sample { time_ns, combined: reading([x, 0.0]), ..Sample::empty(received_ns) };
            match estimator.update(&sample).placed {
                Ok(placed) => after = Some(placed.position[0]),
                Err(why) => refused.push((i, why)),
            }
        }
        assert_eq!(refused, [(120, Refusal::Time), (121, Refusal::Time)], "{back_ms} ms");
        assert_eq!(after, Some(3e-3));
        let counts = estimator.counts();
        assert_eq!((counts.samples(), counts.placed, counts.reasons()), (240, 238, vec![(Refusal::Time, 2)]));
    }
    let mut placer = Placer::new(Settings::default(), None);
    for (time, is_placed) in [(10, true), (20, true), (15, false), (30, true), (30, false), (40, true)] {
        let sample = Sample { combined: reading([0.0; 2]), ..sample(START_NS + time * 1_000_000) };
        assert_eq!(placer.place(&sample, 1e-5).err(), (!is_placed).then_some(Refusal::Time), "{time} ms");
    }
}
