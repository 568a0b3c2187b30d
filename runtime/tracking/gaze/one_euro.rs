//! Filters a position in the plane with a one-euro filter (Casiez, Roussel, Vogel 2012) of known lag.
//!
//! The filter is a low pass whose cutoff rises with speed, so that it is calm at rest and quick in motion. A
//! first-order low pass follows a ramp with a constant known delay, and a prediction can correct it.

use serde::Serialize;
use std::f64::consts::TAU;

/// The state of the filter after at least one position.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OneEuro {
    /// The filtered position, meters.
    pub position: [f64; 2],
    /// Filtered velocity, meters per second.
    pub velocity: [f64; 2],
    /// Delay of `position` on a ramp, seconds.
    pub lag: f64,
    /// Variance of `position` for measurements of variance 1.
    pub gain: f64,
    /// Variance of `velocity` for measurements of variance 1, per square second.
    pub velocity_gain: f64,
    /// The time of the last measurement, nanoseconds.
    pub time_ns: u64,
    last: [f64; 2],
    /// Measurements since the start. The first ones are averaged, not filtered.
    count: u32,
    cutoff: f64,
    beta: f64,
    speed_cutoff: f64,
}

/// The squared speed counts above this many times its expectation from noise.
const STRICT: f64 = 3.0;

/// Weight of a new value for a step of `dt` seconds.
fn share(cutoff: f64, dt: f64) -> f64 {
    let r = TAU * cutoff * dt;
    r / (r + 1.0)
}

impl OneEuro {
    /// Starts at a position that is as accurate as the mean of `count` measurements.
    pub fn new(time_ns: u64, position: [f64; 2], count: u32, [cutoff, beta, speed_cutoff]: [f64; 3]) -> Self {
        Self {
            position,
            velocity: [0.0; 2],
            lag: 0.0,
            gain: 1.0 / f64::from(count.max(1)),
            velocity_gain: 0.0,
            time_ns,
            last: position,
            count: count.max(1),
            cutoff,
            beta,
            speed_cutoff,
        }
    }

    /// Adds a measurement that is later than the last one. An earlier one is ignored.
    pub fn update(&mut self, time_ns: u64, measured: [f64; 2]) {
        let Some(step) = time_ns.checked_sub(self.time_ns).filter(|s| *s > 0) else { return };
        let dt = step as f64 * 1e-9;
        self.count = self.count.saturating_add(1);
        let b = share(self.speed_cutoff, dt);
        self.velocity = [0, 1].map(|i| {
            let speed = (measured[i] - self.last[i]) / dt;
            self.velocity[i] + b * (speed - self.velocity[i])
        });
        // The filtered difference of white noise has a variance of nearly (b / dt)^2 in the long run, and less at
        // first.
        let settled = (b / dt).powi(2) * (1.0 + b / (2.0 - b));
        self.velocity_gain += (2.0 * b - b * b).min(1.0) * (settled - self.velocity_gain);
        let speed = self.velocity[0].hypot(self.velocity[1]);
        // Speed that noise alone explains is not motion.
        let a = share(self.cutoff + self.beta * speed, dt).max(1.0 / f64::from(self.count));
        self.position = [0, 1].map(|i| self.position[i] + a * (measured[i] - self.position[i]));
        self.gain = a * a + (1.0 - a).powi(2) * self.gain;
        self.lag = (1.0 - a) * (self.lag + dt);
        self.last = measured;
        self.time_ns = time_ns;
    }

    /// The velocity minus the part that measurements of variance `noise` would show at rest. It follows James and Stein
    /// (1961) but is stricter, because a prediction that trembles is worse than one that is slow to follow a slow
    /// pursuit.
    pub fn calm_velocity(&self, noise: f64) -> [f64; 2] {
        let square = self.velocity[0].powi(2) + self.velocity[1].powi(2);
        let expected = STRICT * 2.0 * noise * self.velocity_gain;
        let keep = if square > 0.0 { (1.0 - expected / square).max(0.0) } else { 0.0 };
        self.velocity.map(|v| v * keep)
    }

    /// The position at a time if the ramp continues, for measurements of variance `noise`.
    pub fn at(&self, time_ns: u64, noise: f64) -> [f64; 2] {
        let ahead = (time_ns as f64 - self.time_ns as f64) * 1e-9 + self.lag;
        let velocity = self.calm_velocity(noise);
        [0, 1].map(|i| self.position[i] + velocity[i] * ahead)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: [f64; 3] = [3.0, 2000.0, 2.0];

    #[test]
    fn a_ramp_is_followed_without_lag_once_it_is_known() {
        let mut filter = OneEuro::new(0, [0.0; 2], 1, SETTINGS);
        for ms in 1..2000u64 {
            filter.update(ms * 1_000_000, [ms as f64 * 3e-6, -1e-3]);
        }
        let there = filter.at(2_050_000_000, 0.0);
        assert!((there[0] - 2050.0 * 3e-6).abs() < 1e-6 && (there[1] + 1e-3).abs() < 1e-6, "{there:?}");
        assert!(filter.lag > 5e-3, "and it does lag: {}", filter.lag);
    }

    #[test]
    fn noise_is_reduced_as_it_says() {
        let mut rng = fastrand::Rng::with_seed(4);
        for rate in [120u64, 500, 1000] {
            let mut filter = OneEuro::new(0, [0.0; 2], 1, SETTINGS);
            let (mut sum, mut speed, mut said, mut said_speed, mut n) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for k in 1..rate * 60 {
                // The noise is uniform with variance one.
                let noise = [0, 1].map(|_| (rng.f64() - 0.5) * 12f64.sqrt() * 1e-4);
                filter.update(k * 1_000_000_000 / rate, noise);
                if k > rate {
                    sum += filter.position[0].powi(2);
                    speed += filter.velocity[0].powi(2);
                    said += filter.gain * 1e-8;
                    said_speed += filter.velocity_gain * 1e-8;
                    n += 1.0;
                }
            }
            assert!((sum / said - 1.0).abs() < 0.4, "{rate}: {} {}", (sum / n).sqrt(), (said / n).sqrt());
            assert!(
                (speed / said_speed - 1.0).abs() < 0.3,
                "{rate}: {} {}",
                (speed / n).sqrt(),
                (said_speed / n).sqrt()
            );
            assert!((sum / n).sqrt() < 0.05e-3);
        }
    }

    #[test]
    fn time_that_stands_or_runs_back_is_ignored() {
        let mut filter = OneEuro::new(5, [1.0, 2.0], 1, SETTINGS);
        filter.update(5, [9.0, 9.0]);
        filter.update(4, [9.0, 9.0]);
        assert_eq!(filter.position, [1.0, 2.0]);
    }
}
