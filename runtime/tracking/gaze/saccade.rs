//! Detects saccades during their flight and predicts their landing.
//!
//! The duration of a saccade follows from its size (the main sequence, Carpenter 1988: 21 ms + 2.2 ms per degree). Its
//! course is close to minimum jerk (Hogan 1984). Its first half therefore determines its end. Sizes and onsets are
//! weighted by the fit of the samples. The landing is their weighted mean, and its spread is the spread that remains.

use super::Settings;
use serde::Serialize;
use std::collections::VecDeque;

/// A measured position with its time.
pub type Point = (u64, [f64; 2]);

/// Sizes that are weighted, degrees.
const SIZES: [f64; 18] =
    [0.4, 0.6, 0.9, 1.3, 1.8, 2.4, 3.2, 4.0, 5.0, 6.2, 7.5, 9.0, 11.0, 13.0, 15.5, 18.5, 22.0, 27.0];
/// Time between the onsets that are weighted, nanoseconds, and their number.
const ONSET_STEP_NS: u64 = 3_000_000;
const ONSETS: u64 = 16;
/// Largest number of points that are fitted. More samples are averaged in groups.
const FITTED: usize = 24;
/// Scatter about the main sequence, as a share of the size.
const SCATTER: f64 = 0.15;
const REMEMBERED: usize = 256;

/// Duration of a saccade of this size, seconds.
pub fn duration(degrees: f64) -> f64 {
    21e-3 + 2.2e-3 * degrees
}

/// Share of a saccade's distance that is covered at share `u` of its time.
pub fn progress(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (10.0 + u * (6.0 * u - 15.0))
}

/// Slope of points, meters per second, and the variance of each of its coordinates for measurements of variance 1.
pub fn slope<'a>(points: impl Iterator<Item = &'a Point> + Clone) -> Option<([f64; 2], f64)> {
    let first = points.clone().next()?.0;
    let seconds = |t: u64| t.saturating_sub(first) as f64 * 1e-9;
    let (mut n, mut st, mut sp) = (0.0, 0.0, [0.0; 2]);
    for (t, p) in points.clone() {
        (n, st) = (n + 1.0, st + seconds(*t));
        sp = [sp[0] + p[0], sp[1] + p[1]];
    }
    let mean = st / n;
    let (mut tt, mut tp) = (0.0, [0.0; 2]);
    for (t, p) in points {
        let dt = seconds(*t) - mean;
        tt += dt * dt;
        tp = [0, 1].map(|i| tp[i] + dt * (p[i] - sp[i] / n));
    }
    (tt > 0.0).then(|| (tp.map(|v| v / tt), 1.0 / tt))
}

/// The estimate of a saccade in flight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Flight {
    /// The start of the saccade, meters.
    pub from: [f64; 2],
    /// The time of its detection, nanoseconds.
    pub noticed_ns: u64,
    /// The predicted landing, meters.
    pub landing: [f64; 2],
    /// Standard deviation of the landing along each axis, meters.
    pub spread: f64,
    /// The predicted time of the landing, nanoseconds.
    pub lands_ns: u64,
    /// Standard deviation of the time of the landing, nanoseconds.
    pub lands_spread_ns: f64,
}

impl Flight {
    /// The size of the saccade, meters.
    pub fn size(&self) -> f64 {
        (self.landing[0] - self.from[0]).hypot(self.landing[1] - self.from[1])
    }
}

/// A saccade in flight, with its measurements.
#[derive(Debug, Clone, PartialEq)]
pub struct Jump {
    /// The current estimate of the saccade.
    pub flight: Flight,
    points: VecDeque<Point>,
}

impl Jump {
    /// A saccade from `from`, detected at `noticed_ns`, with the measurements `points`.
    pub fn new(from: [f64; 2], noticed_ns: u64, points: VecDeque<Point>, noise: f64, s: &Settings) -> Self {
        let landing = points.back().map_or(from, |p| p.1);
        let flight =
            Flight { from, noticed_ns, landing, spread: s.unknown, lands_ns: noticed_ns, lands_spread_ns: 20e6 };
        let mut jump = Self { flight, points };
        jump.fit(noise, s);
        jump
    }

    /// Adds a measurement. `noise` is the variance of each coordinate.
    pub fn update(&mut self, point: Point, noise: f64, settings: &Settings) {
        self.points.push_back(point);
        if self.points.len() > REMEMBERED {
            self.points.pop_front();
        }
        self.fit(noise, settings);
    }

    /// Returns the empty storage for the measurements of the next saccade.
    pub fn into_room(mut self) -> VecDeque<Point> {
        self.points.clear();
        self.points
    }

    /// The measurements since a time.
    pub fn since(&self, time_ns: u64) -> impl Iterator<Item = &Point> + Clone {
        self.points.iter().filter(move |p| p.0 >= time_ns)
    }

    /// True if the eye rests at the last measurement.
    pub fn over(&self, noise: f64, settings: &Settings) -> bool {
        let Some(last) = self.points.back().map(|p| p.0) else { return true };
        if last.saturating_sub(self.flight.noticed_ns) > 150_000_000 {
            return true;
        }
        if last < self.flight.lands_ns.saturating_add(8_000_000) {
            return false;
        }
        let Some((speed, variance)) = slope(self.since(last.saturating_sub(16_000_000))) else { return false };
        let limit = settings.saccade_speed * settings.radius + 2.5 * (noise * variance).sqrt();
        speed[0].hypot(speed[1]) < limit
    }

    fn fit(&mut self, noise: f64, settings: &Settings) {
        let Some((first, last)) = self.points.front().map(|p| p.0).zip(self.points.back().map(|p| p.0)) else { return };
        let every = self.points.len().div_ceil(FITTED).max(1);
        let Flight { from, noticed_ns, .. } = self.flight;
        // Points are thinned by averaging, so that each measurement counts.
        let (mut thinned, mut count) = ([(0.0, [0.0; 2], 0.0); FITTED], 0);
        for (place, c) in thinned.iter_mut().zip(self.points.make_contiguous().chunks(every)) {
            let n = c.len() as f64;
            let t = c.iter().map(|p| p.0.saturating_sub(first) as f64).sum::<f64>() / n * 1e-9;
            *place = (t, [0, 1].map(|i| c.iter().map(|p| p.1[i]).sum::<f64>() / n - from[i]), n);
            count += 1;
        }
        let points = &thinned[..count];
        let metres_per_degree = settings.radius * 1f64.to_radians();
        let noise = noise.max(1e-12);
        // The noise limits the start, and the course is not quite minimum jerk.
        let (mut best, mut found) = (f64::INFINITY, [(0.0, [0.0; 2], 0.0, 0.0); SIZES.len() * ONSETS as usize]);
        let mut weighed = 0;
        for back in 0..ONSETS {
            let onset = noticed_ns.saturating_sub(back * ONSET_STEP_NS);
            let start = (onset as f64 - first as f64) * 1e-9;
            for degrees in SIZES {
                let lasts = duration(degrees);
                let expected = degrees * metres_per_degree;
                // The length that the size predicts counts as one more measurement of it.
                let (mut ff, mut fr) = (0.0, [0.0; 2]);
                for (t, r, n) in points {
                    let f = progress((t - start) / lasts);
                    ff += n * f * f;
                    fr = [0, 1].map(|i| fr[i] + n * f * r[i]);
                }
                let along = fr[0].hypot(fr[1]);
                if ff <= 0.0 || along <= 0.0 {
                    continue;
                }
                let scatter = (SCATTER * expected).powi(2) + noise;
                let precision = ff / noise + 1.0 / scatter;
                let length = (along / noise + expected / scatter) / precision;
                let way = fr.map(|v| v / along * length);
                let mut cost = ((length - expected).powi(2) / scatter) + 2.0 * (degrees / 30.0);
                for (t, r, n) in points {
                    let f = progress((t - start) / lasts);
                    let off = (r[0] - f * way[0]).powi(2) + (r[1] - f * way[1]).powi(2);
                    cost += n * off / (noise + 0.0016 * f * (1.0 - f) * length * length);
                }
                best = best.min(cost);
                found[weighed] = (cost, way, onset as f64 + lasts * 1e9, 1.0 / precision);
                weighed += 1;
            }
        }
        let (mut total, mut way, mut lands, mut square, mut lands_square) = (0.0, [0.0; 2], 0.0, 0.0, 0.0);
        let origin = last as f64;
        for (cost, w, at, variance) in &found[..weighed] {
            let weight = (-0.5 * (cost - best)).exp();
            total += weight;
            way = [0, 1].map(|i| way[i] + weight * w[i]);
            square += weight * ((w[0] * w[0] + w[1] * w[1]) / 2.0 + variance);
            lands += weight * (at - origin);
            lands_square += weight * (at - origin).powi(2);
        }
        if !(total > 0.0 && total.is_finite()) {
            return;
        }
        let way = way.map(|w| w / total);
        let variance = (square / total - (way[0] * way[0] + way[1] * way[1]) / 2.0).max(0.0);
        let long = way[0].hypot(way[1]);
        let Flight { landing, spread, lands_ns, lands_spread_ns, .. } = &mut self.flight;
        *landing = [0, 1].map(|i| from[i] + way[i]);
        // The error of the model itself is a few hundredths of the distance.
        *spread = (variance + (0.04 * long).powi(2) + noise / 4.0).sqrt();
        let mean = lands / total;
        *lands_ns = (origin + mean).max(0.0) as u64;
        *lands_spread_ns = (lands_square / total - mean * mean).max(0.0).sqrt().max(3e6);
    }
}
