//! Tests the estimator with a simulated eye of known truth and with trackers that send wrong samples.

use super::calibration_tests::{off, targets};
use super::*;
use crate::trackers::simulated::{self, Doing, SimulatedSource, Truth};
use crate::trackers::{Event, Quantity, Reading, Sample, Source, Unit};
use eyebox_base::error::ErrorData;
use eyebox_optics::PupilDistribution;
use proptest::prelude::*;
use std::time::Duration;

/// Time from the arrival of a sample to the light of the set that is refined for it, nanoseconds.
const TO_LIGHT_NS: u64 = 20_000_000;
const START_NS: u64 = 1_000_000_000;

struct Run {
    source: SimulatedSource,
    estimator: Estimator,
    name: String,
    rate_hz: f64,
}

struct Look {
    stages: Stages,
    sample: Sample,
    predicted: PupilDistribution,
    /// The true eye at the time of light.
    truth: Truth,
    /// True if the eye was steady and open from 40 ms before the sample (a saccade that just landed is still being
    /// processed) to the light.
    calm: bool,
}

impl Run {
    fn new(settings: simulated::Settings) -> Self {
        let name = format!("{} Hz, {} ms, seed {}", settings.rate_hz, settings.delay * 1e3, settings.seed);
        let rate_hz = settings.rate_hz;
        let source = SimulatedSource::starting(settings, false, START_NS).unwrap();
        Self { source, estimator: Estimator::new(Settings::default(), None).unwrap(), name, rate_hz }
    }

    fn next(&mut self) -> Look {
        let Ok(Event::Sample(sample, _)) = self.source.next(Duration::ZERO) else { panic!("a sample") };
        let stages = self.estimator.update(&sample);
        let light = sample.received_ns + TO_LIGHT_NS;
        let calm = self.calm(sample.time_ns - 40_000_000, light);
        let predicted = self.estimator.predict(light);
        let look = Look { stages, sample, predicted, truth: self.source.truth(light), calm };
        let p = &look.predicted;
        let numbers = [p.centre[0], p.centre[1], p.spread, p.diameter[0], p.diameter[1], p.elsewhere];
        assert!(numbers.iter().all(|v| v.is_finite()) && p.spread > 0.0 && p.diameter[0] > 0.0, "{p}");
        look
    }

    /// The predictions of this many seconds, after half a second for the estimator to settle.
    fn looks(&mut self, seconds: f64) -> Vec<Look> {
        for _ in 0..(0.5 * self.rate_hz) as usize {
            self.next();
        }
        (0..(seconds * self.rate_hz) as usize).map(|_| self.next()).collect()
    }

    /// True if the eye was steady and open all the time. The caller has to ask early, because the simulated eye forgets
    /// its past.
    fn calm(&mut self, from: u64, to: u64) -> bool {
        (0..=20u64).all(|i| {
            let truth = self.source.truth(from + (to - from) * i / 20);
            truth.lid == 1.0 && !matches!(truth.doing, Doing::Saccade { .. })
        })
    }
}

/// The rates and delays of real trackers.
fn trackers() -> Vec<simulated::Settings> {
    let mut all = Vec::new();
    for rate_hz in [120.0, 500.0, 1000.0] {
        for delay in [5e-3, 15e-3, 30e-3] {
            all.push(simulated::Settings {
                rate_hz,
                delay,
                seed: all.len() as u64 + 1,
                ..simulated::Settings::default()
            });
        }
    }
    all
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn the_pupil_is_known_in_fixation_and_pursuit() {
    for settings in trackers() {
        let mut run = Run::new(settings);
        let looks = run.looks(40.0);
        let (mut fixation, mut pursuit) = (Vec::new(), Vec::new());
        for look in looks {
            if look.calm {
                let error = off(look.predicted.centre, look.truth.position);
                if look.truth.doing == Doing::Pursuit { pursuit.push(error) } else { fixation.push(error) }
            }
        }
        let (f, p) = (rms(&fixation) * 1e3, rms(&pursuit) * 1e3);
        println!("{}: {f:.3} mm in fixation, {p:.3} mm in pursuit", run.name);
        assert!(fixation.len() > 500 && pursuit.len() > 500);
        assert!(f < 0.25 && p < 0.25, "{}: {f:.3} mm in fixation, {p:.3} mm in pursuit", run.name);
    }
}

/// A fixating eye turns by less than two spreads. An eye that has followed something for half a second turns at the
/// reported speed.
#[test]
fn the_velocity_is_known_as_well_as_it_says() {
    for noise in [0.02e-3, 0.1e-3] {
        let mut run = Run::new(simulated::Settings { noise, seed: 4, ..simulated::Settings::default() });
        let (mut rests, mut errors, mut spreads) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..6000 {
            let look = run.next();
            let Some((turning, spread)) = run.estimator.velocity().turning.filter(|_| look.calm) else { continue };
            let all = [500, 250, 0].map(|ms| run.source.truth(look.sample.time_ns - ms * 1_000_000_u64));
            // Tremor is not motion over the time of the estimate.
            let velocity = [0, 1].map(|i| (all[2].position[i] - all[0].position[i]) / 0.5 / 11e-3);
            if all.iter().all(|t| t.doing == Doing::Fixation) {
                rests.push(f64::from(turning[0].hypot(turning[1]) > 2.0 * spread));
                spreads.push(spread);
            } else if all.iter().all(|t| t.doing == Doing::Pursuit) {
                errors.push(off(turning, velocity));
            }
        }
        let wrong = rests.iter().sum::<f64>() / rests.len() as f64;
        let [error, spread] = [rms(&errors), rms(&spreads)].map(f64::to_degrees);
        assert!(rests.len() > 200 && errors.len() > 200, "{} {}", rests.len(), errors.len());
        assert!(wrong <= 0.16 && error < spread, "noise {noise}: {wrong:.3}, {error:.2}, {spread:.2} deg/s");
    }
}

#[test]
fn the_spread_keeps_its_promise() {
    for settings in trackers() {
        let mut run = Run::new(settings);
        let looks = run.looks(40.0);
        // This holds at all times, including saccades and blinks.
        for (k, normal) in [(2.0, (-2f64).exp()), (3.0, (-4.5f64).exp())] {
            let n = looks.len() as f64;
            let outside = |l: &&Look| off(l.predicted.centre, l.truth.position) > k * l.predicted.spread;
            let out = looks.iter().filter(outside).count() as f64 / n;
            let promised =
                looks.iter().map(|l| l.predicted.elsewhere + (1.0 - l.predicted.elsewhere) * normal).sum::<f64>() / n;
            println!("{}: {out:.3} beyond {k} spreads, {promised:.3} promised", run.name);
            assert!(out <= promised, "{}: {out:.3} beyond {k} spreads, {promised:.3} promised", run.name);
        }
        // While nothing unforeseen happens, the normal distribution alone must hold.
        let (mut out, mut n) = (0.0, 0.0);
        for look in looks {
            if look.calm {
                n += 1.0;
                out += f64::from(off(look.predicted.centre, look.truth.position) > 2.0 * look.predicted.spread);
            }
        }
        assert!(out / n <= (-2f64).exp(), "{}: {:.3}", run.name, out / n);
    }
}

#[test]
fn a_landing_is_known_within_40_ms_of_the_onset() {
    for settings in trackers() {
        let settings = simulated::Settings { blinks: 0.0, ..settings };
        let mut run = Run::new(settings);
        let (mut known, mut all, mut inside, mut errors, mut sizes) = (0, 0, 0, Vec::new(), 0.0);
        let mut last = 0;
        for _ in 0..(60.0 * run.rate_hz) as usize {
            let look = run.next();
            // The first sample that is 40 ms into a saccade counts.
            let before = look.sample.time_ns - 40_000_000;
            let Doing::Saccade { began_ns, landing, .. } = run.source.truth(before).doing else { continue };
            if began_ns == last {
                continue;
            }
            last = began_ns;
            let size = off(run.source.truth(began_ns - 1).position, landing);
            // Only saccades of a degree or more count. Less is within the error of the pupil itself.
            if size < 0.19e-3 {
                continue;
            }
            all += 1;
            sizes += size;
            let p = run.estimator.predict(look.sample.time_ns + 40_000_000);
            let error = off(p.centre, landing);
            known += u32::from(error < (0.2 * size).max(0.3e-3));
            inside += u32::from(error < 3.0 * p.spread);
            errors.push(error);
        }
        println!(
            "{}: {known} of {all} landings known, {inside} inside three spreads, {:.3} mm rms of {:.2} mm",
            run.name,
            rms(&errors) * 1e3,
            sizes / f64::from(all) * 1e3
        );
        assert!(all > 20);
        assert!(f64::from(known) >= 0.9 * f64::from(all), "{}: {known} of {all}", run.name);
        assert!(f64::from(inside) >= 0.9 * f64::from(all), "{}: {inside} of {all}", run.name);
    }
}

#[test]
fn a_blink_costs_no_visible_step() {
    // The eye looks at one place, with blinks of 300 ms.
    let quiet = simulated::Settings {
        fixation: [1e3, 1e3],
        pursuit: 0.0,
        blinks: 15.0,
        blink: [0.3, 0.3],
        ..simulated::Settings::default()
    };
    for rate_hz in [120.0, 500.0, 1000.0] {
        let mut run = Run::new(simulated::Settings { rate_hz, seed: rate_hz as u64, ..quiet.clone() });
        let looks = run.looks(60.0);
        let lost = looks.iter().filter(|l| l.stages.phase == Phase::Lost).count();
        assert!(lost as f64 > 10.0 * 0.25 * rate_hz, "{lost} samples of blinks");
        let worst = looks.iter().map(|l| off(l.predicted.centre, l.truth.position)).fold(0.0, f64::max);
        let step = looks.windows(2).map(|w| off(w[0].predicted.centre, w[1].predicted.centre)).fold(0.0, f64::max);
        let returns: Vec<usize> = (1..looks.len())
            .filter(|i| looks[*i].stages.phase == Phase::Steady && looks[i - 1].stages.phase == Phase::Returning)
            .collect();
        // The movement from the held place to the prediction a tenth of a second after the return.
        let after = (0.1 * rate_hz) as usize;
        let moved = |i: &usize| Some(off(looks[i - 1].predicted.centre, looks.get(i + after)?.predicted.centre));
        let back = returns.iter().filter_map(moved).fold(0.0, f64::max);

        println!(
            "{rate_hz} Hz: {:.3} mm off at most, steps of {:.3} mm at most, on return {:.3}",
            worst * 1e3,
            step * 1e3,
            back * 1e3
        );
        assert!(returns.len() > 10 && back < 0.25e-3, "{rate_hz} Hz: a step of {back} m on return");
        // Apart from this, a steady eye shows only the tracker's noise at any time.
        assert!(worst < 0.4e-3 && step < 0.3e-3, "{rate_hz} Hz: {worst} m off, a step of {step} m");
        // During the blink the spread widens after a while.
        let widest = looks.iter().map(|l| l.predicted.spread).fold(0.0, f64::max);
        assert!(widest > 0.5e-3, "{widest}");
    }
}

#[test]
fn a_tracker_that_falls_silent_is_held_then_doubted() {
    let mut run = Run::new(simulated::Settings { blinks: 0.0, ..simulated::Settings::default() });
    let last = run.looks(1.0).pop().unwrap();
    let later = |ms: u64| run.estimator.predict(last.sample.time_ns + ms * 1_000_000_u64);
    assert!(later(1000).spread > 2.0 * later(100).spread && later(1000).elsewhere > 0.9);
    assert!(later(100_000).spread <= Settings::default().widest.max(last.predicted.spread));
    assert_eq!(later(10_000).centre, later(1000).centre, "nothing is extrapolated for long");
}

/// A sample of both eyes in the pupil plane.
fn sample(time_ns: u64, position: [f64; 2]) -> Sample {
    let mut sample = Sample::empty(time_ns);
    let reading = Some(Reading::new(Quantity::Pupil, Unit::Metres, position));
    (sample.left, sample.right) = (reading, reading);
    sample
}

#[test]
fn lies_are_passed_over() {
    let mut estimator = Estimator::new(Settings::default(), None).unwrap();
    let mut rng = fastrand::Rng::with_seed(2);
    let at = [1e-3, -2e-3];
    for i in 0..2000u64 {
        let time = START_NS + i * 2_000_000;
        let noisy = at.map(|a| a + 0.1e-3 * (rng.f64() - 0.5));
        let lie = match i % 20 {
            5 => sample(time, [9e-3, 9e-3]),               // a jump for one sample
            9 => sample(time - 300_000_000, [0.0, 0.0]),   // the time runs back
            13 => sample(time, [f64::NAN, f64::INFINITY]), // not a number
            17 => sample(time, [1.0, 1.0]),                // a metre away
            _ => sample(time, noisy),
        };
        let stages = estimator.update(&lie);
        assert!(matches!(i % 20, 5 | 9 | 13 | 17) != stages.placed.is_ok(), "{i}: {stages}");
        let p = estimator.predict(time + 30_000_000);
        assert!(i < 20 || off(p.centre, at) < 0.15e-3, "{i}: {p}");
    }
    // A place that persists is not a wrong sample.
    for i in 2000..2100u64 {
        estimator.update(&sample(START_NS + i * 2_000_000, [9e-3, 9e-3]));
    }
    assert!(off(estimator.predict(START_NS + 4_230_000_000).centre, [9e-3, 9e-3]) < 0.2e-3);
}

#[test]
fn samples_that_are_missing_now_and_then_cost_nothing() {
    let mut estimator = Estimator::new(Settings::default(), None).unwrap();
    for i in 0..600u64 {
        let time = START_NS + i * 8_000_000;
        // The eye follows at 2 mm per second.
        let mut s = sample(time, [i as f64 * 16e-6 - 5e-3, 0.0]);
        if i % 7 == 3 {
            s.left = s.left.map(|r| Reading { confidence: 0.3, ..r });
            s.right = s.right.map(|r| Reading { valid: false, ..r });
        }
        let stages = estimator.update(&s);
        assert_eq!((stages.phase, stages.placed.is_ok()), (Phase::Steady, i % 7 != 3));
        let p = estimator.predict(time + 40_000_000);
        assert!(i < 300 || off(p.centre, [(i + 5) as f64 * 16e-6 - 5e-3, 0.0]) < 0.05e-3, "{i}: {p}");
    }
}

#[test]
fn one_eye_stands_for_the_other() {
    let settings = Settings { eye: Eye::Left, ..Settings::default() };
    let mut estimator = Estimator::new(settings, None).unwrap();
    let mut last = START_NS;
    for i in 0..600u64 {
        last = START_NS + i * 8_000_000;
        let mut s = sample(last, [1e-3, 0.0]);
        s.right = Some(Reading::new(Quantity::Pupil, Unit::Metres, [1.8e-3, 0.3e-3]));
        if i > 300 {
            s.left = s.left.map(|r| Reading { valid: false, ..r });
        }
        assert!(estimator.update(&s).placed.is_ok());
        assert_eq!(estimator.phase(), Phase::Steady);
    }
    assert!(off(estimator.predict(last + 20_000_000).centre, [1e-3, 0.0]) < 0.02e-3);
}

#[test]
fn the_rotation_of_the_eye_places_what_no_calibration_does() {
    let place =
        |reading: Reading, gaze: Option<Reading>| place::rotation(&reading, gaze.as_ref(), &Settings::default());
    let degree = place(Reading::new(Quantity::Gaze, Unit::Radians, [1f64.to_radians(), 0.0]), None).unwrap();
    assert!((degree[0] - 0.192e-3).abs() < 1e-6, "0.19 mm a degree: {degree:?}");
    // The gaze point is 60 cm to the side of a screen 60 cm away, which is 45 degrees.
    let side = place(Reading::new(Quantity::Gaze, Unit::Metres, [0.6, 0.0]), None).unwrap();
    assert!((side[0] - 11e-3 * 0.5f64.sqrt()).abs() < 1e-9);
    // An eye in space that looks straight ahead is not turned, for any place.
    let eye = Reading { distance: Some(0.6), ..Reading::new(Quantity::Pupil, Unit::Metres, [-0.032, 0.01]) };
    let ahead = place(eye, Some(Reading::new(Quantity::Gaze, Unit::Metres, [-0.032, 0.01]))).unwrap();
    assert!(off(ahead, [0.0, 0.0]) < 1e-12);
    assert_eq!(place(Reading::new(Quantity::Pupil, Unit::Counts, [1.0, 1.0]), None), None);
    assert_eq!(place(Reading::new(Quantity::Pupil, Unit::Normalized, [0.5, 1.0]), None), Some([0.0, 12e-3]));
}

#[test]
fn eyes_too_near_or_too_far_apart_are_not_believed() {
    let mut placer = place::Placer::new(Settings::default(), None);
    let mut at = |time, x: f64| {
        let mut s = sample(time, [-x / 2.0, 0.0]);
        s.right = Some(Reading::new(Quantity::Pupil, Unit::Metres, [x / 2.0, 0.0]));
        for eye in [&mut s.left, &mut s.right] {
            *eye = eye.map(|r| Reading { distance: Some(0.6), ..r });
        }
        s.combined = Some(Reading::new(Quantity::Gaze, Unit::Metres, [0.0, 0.0]));
        placer.place(&s, 1e-4).map(|_| ())
    };
    assert_eq!(at(1, 0.063), Ok(()));
    assert_eq!(at(2, 0.02), Err(place::Refusal::BetweenEyes));
    assert_eq!(at(3, 0.2), Err(place::Refusal::BetweenEyes));
    assert_eq!(at(3, 0.063), Err(place::Refusal::Time));
}

#[test]
fn a_calibration_is_stored_and_used() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ada.toml");
    let fit = Fit::new(&targets(), Unit::Radians).unwrap();
    let calibration = Calibration { user: "ada".into(), left: Some(fit), ..Calibration::default() };
    calibration.save(&file).unwrap();
    assert_eq!(Calibration::load(&file).unwrap().note_on("B"), None, "it does not state its tracker");
    Calibration { tracker: Some("A".into()), ..calibration }.save(&file).unwrap();
    let again = Calibration::load(&file).unwrap();
    assert_eq!(again.note_on("A"), None);
    assert!(again.note_on("B").is_some_and(|note| ["ada", "A", "B"].iter().all(|name| note.contains(name))));
    let point = [0.7, -0.3];
    assert!(off(again.left.unwrap().map.apply(point), fit.map.apply(point)) < 1e-12);
    assert_eq!((again.user.as_str(), again.left.unwrap().used, again.right), ("ada", [9, 0], None));

    let mut placer = place::Placer::new(Settings::default(), Some(again));
    let mut s = Sample::empty(5);
    s.left = Some(Reading::new(Quantity::Gaze, Unit::Radians, [300.0, -50.0]));
    s.right = Some(Reading::new(Quantity::Gaze, Unit::Radians, [0.0, 0.0]));
    assert!(off(placer.place(&s, 1e-4).unwrap().position, targets()[0].pupil) < 1e-9);
    s.time_ns = 6;
    s.received_ns = 6;
    s.left = Some(Reading::new(Quantity::Gaze, Unit::Metres, [0.1, 0.1]));
    assert_eq!(placer.place(&s, 1e-4), Err(place::Refusal::NoMap), "made for another unit");

    std::fs::write(&file, std::fs::read_to_string(&file).unwrap().replace("x_mm", "x_cm")).unwrap();
    let error = Calibration::load(&file).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "file/toml");
    assert!(error.to_string().contains("ada.toml") && error.to_string().contains("x_cm"), "{error}");
    assert_eq!(Calibration::from_toml("user = \"x\"\n").unwrap_err().code(), "no-map");
}

#[test]
fn settings_are_checked() {
    assert!(Settings::default().check().is_ok());
    for wrong in [
        Settings { radius: 0.0, ..Settings::default() },
        Settings { cutoff: f64::NAN, ..Settings::default() },
        Settings { hold: -1.0, ..Settings::default() },
        Settings { diameter: [5e-3, 3e-3], ..Settings::default() },
    ] {
        assert!(wrong.check().is_err());
    }
}

#[test]
fn pupils_are_drawn_as_the_distribution_says() {
    let p = PupilDistribution {
        centre: [1e-3, -2e-3],
        spread: 0.2e-3,
        diameter: [3e-3, 5e-3],
        focus: [-1e-3, 1e-3],
        elsewhere: 0.1,
    };
    let mut rng = fastrand::Rng::with_seed(8);
    let (mut square, mut beyond) = ([0.0; 2], 0);
    for _ in 0..20_000 {
        let pupil = p.pupil([rng.f64(), rng.f64(), rng.f64(), rng.f64()]);
        assert!((3e-3..=5e-3).contains(&pupil.diameter) && (-1e-3..=1e-3).contains(&pupil.depth));
        let away = [pupil.x - 1e-3, pupil.y + 2e-3];
        square = [square[0] + away[0] * away[0], square[1] + away[1] * away[1]];
        beyond += u32::from(away[0].hypot(away[1]) > 0.4e-3);
    }
    for s in square {
        assert!(((s / 20_000.0).sqrt() / 0.2e-3 - 1.0).abs() < 0.03);
    }
    assert!((f64::from(beyond) / 20_000.0 - (-2f64).exp()).abs() < 0.01);
    assert!(p.pupil([1.0; 4]).check().is_ok() && p.pupil([0.0; 4]).check().is_ok());
}

proptest! {
    /// The distribution stays a valid distribution for any samples at any times.
    #[test]
    fn nothing_makes_it_nonsense(
        samples in prop::collection::vec(
            (any::<u64>(), 0u64..40_000_000, prop::array::uniform2(any::<f64>()), any::<f64>(), 0u8..6), 0..150),
    ) {
        let mut estimator = Estimator::new(Settings::default(), None).unwrap();
        let mut time = START_NS;
        for (far, step, position, more, kind) in samples {
            time = if kind == 5 { far } else { time.saturating_add(step) };
            let near = position.map(|p| (p % 1.0) * 0.02);
            let mut s = sample(time, if kind < 3 { near } else { position });
            s.left = s.left.map(|r| Reading { diameter: Some(more), confidence: more, ..r }.checked());
            estimator.update(&s);
            for light in [0, time, time.saturating_add(step), u64::MAX] {
                let p = estimator.predict(light);
                prop_assert!(p.centre.iter().all(|c| c.abs() <= 0.02 + 1e-9), "{}", p);
                prop_assert!(p.spread.is_finite() && p.spread > 0.0, "{}", p);
                prop_assert!((0.0..=1.0).contains(&p.elsewhere), "{}", p);
                prop_assert!(p.diameter[0] > 0.0 && p.diameter[1].is_finite() && p.diameter[0] <= p.diameter[1], "{}", p);
                prop_assert!(p.pupil([0.3, 0.7, 0.5, 0.5]).check().is_ok());
            }
        }
    }
}
