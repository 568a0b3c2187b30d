//! Tests clocks of every origin, sign, unit and drift, by their placed times against the true ones.

use super::*;
use fastrand::Rng;

const START_NS: u64 = 7_000_000_000_000;
/// The least delay of each simulated way, nanoseconds.
const LEAST_NS: u64 = 3_000_000;

/// A clock with this unit, first time (in its unit) and drift (ppm), read by a tracker of this rate.
struct Foreign {
    unit: TimeUnit,
    first: f64,
    drift_ppm: f64,
    rate_hz: f64,
    rng: Rng,
}

impl Foreign {
    /// The number of a line at a true time since the start, nanoseconds, if seconds are expected.
    fn expected_ns(&self, since_ns: f64) -> i128 {
        let unit = self.unit.per_second() as f64;
        let value = self.first + since_ns * 1e-9 * unit * (1.0 + self.drift_ppm * 1e-6);
        (value * 1e9).round() as i128
    }

    /// The delay on the way, which is at least 3 ms, often little more, and sometimes 30 ms.
    fn delay_ns(&mut self) -> u64 {
        LEAST_NS + (-self.rng.f64().max(1e-9).ln() * 2e6).min(30e6) as u64
    }
}

/// The largest error, nanoseconds, of the times placed from `settled` seconds on. The least delay is not an error.
fn worst(foreign: &mut Foreign, clock: &mut ForeignClock, seconds: f64, settled: f64) -> f64 {
    let samples = (seconds * foreign.rate_hz) as u64;
    let mut worst = 0.0f64;
    for i in 0..samples {
        let since = i as f64 / foreign.rate_hz * 1e9;
        let received = START_NS + since as u64 + foreign.delay_ns();
        let stamp = clock.place(foreign.expected_ns(since), received);
        assert!(stamp.time_ns <= received);
        if since * 1e-9 >= settled {
            worst = worst.max((stamp.time_ns as f64 - (START_NS + LEAST_NS) as f64 - since).abs());
        }
    }
    worst
}

/// Times are placed for any origin and sign, in every unit, at the rates of real trackers.
#[test]
fn times_are_placed_whatever_the_clock() {
    let mut cases = 0;
    for (unit, origin_s) in
        TimeUnit::ALL.into_iter().flat_map(|unit| [0.0, -323_801.0, -0.25, 98.4, 1.69e9].map(|origin| (unit, origin)))
    {
        for (rate_hz, drift_ppm) in [(30.0, 0.0), (120.0, 50.0), (1000.0, -50.0)] {
            let first = origin_s * unit.per_second() as f64;
            let rng = Rng::with_seed(cases);
            let mut foreign = Foreign { unit, first, drift_ppm, rate_hz, rng };
            let mut clock = ForeignClock::new();
            let worst = worst(&mut foreign, &mut clock, 40.0, 10.0);
            assert!(worst < 0.6e6, "{unit} from {origin_s} s, {drift_ppm} ppm at {rate_hz} Hz: {worst} ns");
            let events: Vec<ClockEvent> = std::iter::from_fn(|| clock.event()).collect();
            let news = if unit == TimeUnit::Seconds { vec![] } else { vec![ClockEvent::Unit(unit)] };
            assert_eq!((events, clock.sets), (news, 0), "{unit} from {origin_s} s at {rate_hz} Hz");
            cases += 1;
        }
    }
    assert_eq!(cases, 60);
}

/// Drift is found, so that times do not lag behind a slow clock by the whole drift of a window.
#[test]
fn drift_is_followed() {
    for (seed, drift_ppm) in [-100.0, -75.0, -50.0, -20.0, -5.0, 5.0, 20.0, 50.0, 75.0, 100.0].into_iter().enumerate() {
        let rng = Rng::with_seed(seed as u64);
        let mut foreign = Foreign { unit: TimeUnit::Seconds, first: -50.0, drift_ppm, rate_hz: 500.0, rng };
        let worst = worst(&mut foreign, &mut ForeignClock::new(), 120.0, 20.0);
        assert!(worst < 0.1e6, "{drift_ppm} ppm: {worst} ns");
    }
}

/// Each sample before and after a change of the clock is placed, for changes back or forward, by a restart or by hand.
#[test]
fn a_clock_that_is_set_is_followed_at_once() {
    for (seed, by_s) in [-2.0, 2.0, -0.4, 0.4, -10.0, 3600.0, -1e6, 1e6, -100.0, 30.0, 1.69e9].into_iter().enumerate() {
        let rng = Rng::with_seed(seed as u64);
        let mut foreign = Foreign { unit: TimeUnit::Seconds, first: 100.0, drift_ppm: 0.0, rate_hz: 120.0, rng };
        let mut clock = ForeignClock::new();
        let mut late = 0;
        for i in 0..2400u64 {
            let since = i as f64 / 120.0 * 1e9;
            if i == 1200 {
                foreign.first += by_s;
            }
            let received = START_NS + since as u64 + foreign.delay_ns();
            let stamp = clock.place(foreign.expected_ns(since), received);
            let error = (stamp.time_ns as f64 - (START_NS + LEAST_NS) as f64 - since).abs();
            // The first samples after the change have the jitter of their arrivals.
            if i > 600 && (!(1200..1210).contains(&i) && error > 2e6 || error > 31e6) {
                late += 1;
            }
        }
        assert!(late == 0 && clock.sets == 1, "{by_s} s: {late} samples, {} sets", clock.sets);
    }
}

/// The times of samples that were held up on their way are correct, and a repeated time is the same sample.
#[test]
fn delays_and_duplicates_are_told_from_clocks_that_were_set() {
    for held_ms in [30, 60, 100, 200, 300, 500, 800, 1200, 2000, 3000] {
        let mut clock = ForeignClock::new();
        for i in 0..1200u64 {
            let since_ns = i * 8_333_333;
            // All samples of the third second and after are held up and arrive together.
            let held = (3_000_000_000..3_000_000_000 + held_ms * 1_000_000).contains(&since_ns);
            let arrival = if held { 3_000_000_000 + held_ms * 1_000_000 } else { since_ns };
            let received = START_NS + arrival + LEAST_NS;
            let times = [0; 2].map(|_| clock.place(i128::from(since_ns) - 5_000_000_000, received).time_ns);
            assert_eq!(times[0], times[1], "a duplicate is the same sample");
            if since_ns > 200_000_000 {
                let true_ns = START_NS + since_ns + LEAST_NS;
                assert!(
                    times[0].abs_diff(true_ns) < 1000,
                    "{held_ms} ms, sample {i}: {} off",
                    times[0].abs_diff(true_ns)
                );
            }
        }
        assert_eq!(clock.sets, 0, "{held_ms} ms");
    }
}

/// Times that count frames or do not advance are replaced by arrivals, with one note.
#[test]
fn a_clock_without_a_unit_is_said_and_arrivals_are_used() {
    for (i, per_second) in [0.0, 12.0, 30.0, 60.0, 90.0, 120.0, 240.0, 5000.0, 2e7, 1e11].into_iter().enumerate() {
        let mut clock = ForeignClock::new();
        let mut events = Vec::new();
        for sample in 0..1200u64 {
            let received = START_NS + sample * 8_333_333;
            let count = (sample as f64 / 120.0 * per_second * 1e9).round() as i128;
            let stamp = clock.place(count, received);
            let known = sample > 60 || per_second > 0.0;
            assert!(!known || stamp.time_ns == received, "{per_second} per second, sample {sample}");
            events.extend(std::iter::from_fn(|| clock.event()));
        }
        assert_eq!(events.len(), 1, "case {i}: {events:?}");
        let stands = matches!(events[0], ClockEvent::Stands);
        assert!(stands == (per_second == 0.0) && (stands || matches!(events[0], ClockEvent::NoUnit(_))), "{events:?}");
    }
}

/// A stated unit is used from the first sample on, and checked.
#[test]
fn a_stated_unit_is_checked() {
    for stated in TimeUnit::ALL {
        for is in TimeUnit::ALL {
            let mut clock = ForeignClock::of(stated);
            let mut last = 0;
            for sample in 0..1200u64 {
                let received = START_NS + sample * 8_333_333 + (sample % 3) * 1_000_000;
                let count = i128::from(sample * 8_333_333) * is.per_second();
                last = received - clock.place(count, received).time_ns;
            }
            let said = std::iter::from_fn(|| clock.event()).any(|event| matches!(event, ClockEvent::NoUnit(_)));
            assert_eq!((said, last), (stated != is, if stated == is { 2_000_000 } else { 0 }), "{is} as {stated}");
        }
    }
}

#[test]
fn the_quickest_arrivals_set_the_offset() {
    let mut clock = ForeignClock::of(TimeUnit::Seconds);
    let start = 7_000_000_000u64;
    for i in 0..1000u64 {
        let tracker = i * 2_000_000;
        // The delay is at least 3 ms, and up to 9 ms more.
        let delay = 3_000_000 + (i * 7919 % 10) * 1_000_000;
        let arrival = clock.place(i128::from(tracker), start + tracker + delay).time_ns;
        if i > 20 {
            assert_eq!(arrival, start + tracker + 3_000_000);
        }
        assert!(arrival <= start + tracker + delay);
    }
}

/// Numbers that no clock has do no harm.
#[test]
fn extreme_times_do_no_harm() {
    let mut rng = Rng::with_seed(3);
    let mut clock = ForeignClock::new();
    for _ in 0..100_000 {
        let extreme = [i128::from(i64::MIN) * 1_000_000_000, -1, 0, 1, i128::from(u64::MAX) * 1_000_000_000];
        let time = if rng.bool() { extreme[rng.usize(0..5)] } else { i128::from(rng.i64(..)) };
        let received = if rng.bool() { rng.u64(..) } else { [0, 1, u64::MAX][rng.usize(0..3)] };
        assert!(clock.place(time, received).time_ns <= received);
        let _ = clock.event();
    }
}

#[test]
fn a_narrow_counter_goes_on() {
    let mut unwrap = Unwrap::default();
    let counts: Vec<u64> = [65_000, 65_535, 0, 20, 10, 65_530].iter().map(|v| unwrap.count(*v, 16)).collect();
    assert_eq!(counts[..5], [65_000, 65_535, 65_536, 65_556, 65_546]);
    assert_eq!(Unwrap::default().count(u64::MAX, 64), u64::MAX);
}
