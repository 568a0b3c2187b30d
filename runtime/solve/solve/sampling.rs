//! Draws pupils from a distribution of diameters and a sequence over (diameter, x, y, depth) (OPTICS 6e).

use crate::optics::{EyeboxRegion, Pupil, PupilDistribution};
use eyebox_base::random::SplitMix;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The distribution of diameters between their limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Diameters {
    /// Uniform in d, as in the paper.
    Uniform,
    /// Uniform in log d, because small pupils are the hardest to serve and the cheapest to compute.
    #[serde(alias = "log")]
    LogUniform,
    /// Uniform in the reciprocal 1/d.
    Reciprocal,
}

impl Diameters {
    /// Returns the name by which it is chosen.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::LogUniform => "log",
            Self::Reciprocal => "reciprocal",
        }
    }
}

/// The sequence that fills the four dimensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Sequence {
    /// Independent pseudo-random numbers, as in the paper.
    Random,
    /// Sobol's sequence (Joe and Kuo 2008), scrambled after Owen by hashing (Burley 2020).
    Sobol,
}

/// The range from which pupils are drawn, in meters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PupilRange {
    /// Side of the square in which the whole pupil stays if it fits. It is the eyebox that all colors serve.
    pub eyebox: f64,
    /// Smallest and largest diameter.
    pub diameter: [f64; 2],
    /// Nearest and farthest focus.
    pub depth: [f64; 2],
    /// Distribution of the diameters.
    pub diameters: Diameters,
}

impl PupilRange {
    /// Returns the usual diameters in an eyebox of this side, from 2 mm to most of it and 20 mm at most.
    pub fn usual_diameter(eyebox: f64) -> [f64; 2] {
        let largest = (eyebox * 10.0 / 11.0).min(20e-3);
        [2e-3_f64.min(largest / 2.0), largest]
    }

    /// Returns the range over a whole eyebox with its usual diameters, drawn uniformly.
    pub fn over(eyebox: f64, depth: [f64; 2]) -> Self {
        Self { eyebox, diameter: Self::usual_diameter(eyebox), depth, diameters: Diameters::Uniform }
    }

    /// Returns the pupil at a point of the unit cube (diameter, x, y, depth) in one of these regions of the pupil
    /// plane, weighted by area. Without a region it is in the eyebox.
    pub fn within(&self, regions: &[EyeboxRegion], [d, x, y, z]: [f64; 4]) -> Pupil {
        let area = |region: &EyeboxRegion| region.size[0] * region.size[1];
        let all: f64 = regions.iter().map(area).sum();
        let mut at = x * all;
        for (i, region) in regions.iter().enumerate() {
            if at <= area(region) || i + 1 == regions.len() {
                let pupil = self.at([d, 0.5, 0.5, z]);
                let (room, [across, down]) = (region.room(pupil.diameter), [at / area(region), y]);
                let place = |i: usize, u: f64| region.center[i] + room[i] * (2.0 * u - 1.0);
                return Pupil { x: place(0, across), y: place(1, down), ..pupil };
            }
            at -= area(region);
        }
        self.at([d, x, y, z])
    }

    /// Returns the pupil at a point of the unit cube (diameter, x, y, depth).
    pub fn at(&self, [d, x, y, z]: [f64; 4]) -> Pupil {
        let [low, high] = self.diameter;
        let diameter = match self.diameters {
            Diameters::Uniform => low + (high - low) * d,
            Diameters::LogUniform => low * (high / low).powf(d),
            Diameters::Reciprocal => 1.0 / (1.0 / high + (1.0 / low - 1.0 / high) * d),
        };
        let reach = (self.eyebox / 2.0 - diameter / 2.0).max(0.0);
        let place = |u: f64| reach * (2.0 * u - 1.0);
        Pupil { x: place(x), y: place(y), diameter, depth: self.depth[0] + (self.depth[1] - self.depth[0]) * z }
    }
}

/// An endless stream of pupils, which is the same for the same seed.
#[derive(Debug, Clone)]
pub struct Sampler {
    range: PupilRange,
    regions: Arc<[EyeboxRegion]>,
    points: Points,
}

impl Sampler {
    /// Starts the stream from its beginning.
    pub fn new(range: PupilRange, sequence: Sequence, seed: u64) -> Self {
        Self { range, regions: Arc::new([]), points: Points::new(sequence, seed) }
    }

    /// Returns the same stream over these regions of the pupil plane
    /// ([`Display::regions`](crate::optics::Display::regions)).
    #[must_use]
    pub fn over(self, regions: impl Into<Arc<[EyeboxRegion]>>) -> Self {
        Self { regions: regions.into(), ..self }
    }

    /// Returns the next pupil.
    pub fn draw(&mut self) -> Pupil {
        self.range.within(&self.regions, self.points.draw())
    }

    /// Returns the next point of the unit cube (diameter, x, y, depth).
    pub(super) fn point(&mut self) -> [f64; 4] {
        self.points.draw()
    }
}

/// An endless stream of points of the four-dimensional unit cube, which is the same for the same seed.
#[derive(Debug, Clone)]
pub(super) struct Points {
    sequence: Sequence,
    random: SplitMix,
    scramble: [u32; 4],
    index: u32,
}

impl Points {
    /// Starts the stream from its beginning.
    pub(super) fn new(sequence: Sequence, seed: u64) -> Self {
        let mut random = SplitMix(seed ^ 0x7075_7069_6c73);
        let scramble = [0; 4].map(|_: u32| random.next() as u32);
        Self { sequence, random, scramble, index: 0 }
    }

    /// Returns the next point.
    pub(super) fn draw(&mut self) -> [f64; 4] {
        match self.sequence {
            Sequence::Random => [0; 4].map(|_: i32| self.random.unit()),
            Sequence::Sobol => {
                let index = self.index;
                self.index = self.index.wrapping_add(1);
                std::array::from_fn(|d| (f64::from(owen(sobol(index, d), self.scramble[d])) + 0.5) / 4_294_967_296.0)
            }
        }
    }
}

/// Returns `count` pupils of a distribution, evenly spread and the same for the same seed.
pub fn pupils_of(distribution: &PupilDistribution, count: usize, seed: u64) -> Vec<Pupil> {
    let mut points = Points::new(Sequence::Sobol, seed);
    (0..count).map(|_| distribution.pupil(points.draw())).collect()
}

/// Returns phases uniform in -pi .. pi in float32, the same for the same seed.
pub fn random_phases(count: usize, seed: u64) -> Vec<f32> {
    let mut random = SplitMix(seed ^ 0x7068_6173_6573);
    (0..count).map(|_| ((random.unit() - 0.5) * std::f64::consts::TAU) as f32).map(eyebox_kernels::trig::wrap).collect()
}

/// Computes Sobol's sequence in the first four dimensions from direction numbers (degree, coefficients, initial
/// values).
fn sobol(index: u32, dimension: usize) -> u32 {
    const POLYNOMIALS: [(u32, u32, [u32; 3]); 3] = [(1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1])];
    if dimension == 0 {
        return index.reverse_bits();
    }
    let (s, a, m) = POLYNOMIALS[dimension - 1];
    let mut v = [0u32; 32];
    for i in 0..32 {
        let k = i as u32;
        v[i] = if k < s {
            m[i] << (31 - k)
        } else {
            let back = v[i - s as usize];
            let mut value = back ^ (back >> s);
            for j in 1..s {
                value ^= ((a >> (s - 1 - j)) & 1) * v[i - j as usize];
            }
            value
        };
    }
    (0..32).filter(|bit| index >> bit & 1 == 1).fold(0, |x, bit| x ^ v[bit])
}

/// Applies Owen's nested scrambling by a hash in which only higher bits decide (Laine and Karras 2011). No general
/// mixer has this property.
fn owen(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: PupilRange =
        PupilRange { eyebox: 22e-3, diameter: [2e-3, 20e-3], depth: [-3e-3, 3.5e-3], diameters: Diameters::LogUniform };

    #[test]
    fn sobol_fills_every_elementary_interval() {
        // These 64 points are a (0, m, 1) net in each dimension, with one point per interval of 1/64, scrambled or not.
        for d in 0..4 {
            for seed in [None, Some(77)] {
                let mut hit = [false; 64];
                for i in 0..64 {
                    let x = seed.map_or(sobol(i, d), |s| owen(sobol(i, d), s));
                    hit[(x >> 26) as usize] = true;
                }
                assert!(hit.iter().all(|h| *h), "dimension {d}, {seed:?}");
            }
        }
        // The first dimension with the second has one point in each of 8 x 8 squares.
        let mut hit = [false; 64];
        (0..64).for_each(|i| hit[((sobol(i, 0) >> 29) * 8 + (sobol(i, 1) >> 29)) as usize] = true);
        assert!(hit.iter().all(|h| *h));
    }

    #[test]
    fn pupils_stay_in_range_and_repeat_with_the_seed() {
        for sequence in [Sequence::Random, Sequence::Sobol] {
            for diameters in [Diameters::Uniform, Diameters::LogUniform, Diameters::Reciprocal] {
                let range = PupilRange { diameters, ..RANGE };
                let (mut a, mut b) = (Sampler::new(range, sequence, 5), Sampler::new(range, sequence, 5));
                for _ in 0..500 {
                    let p = a.draw();
                    assert_eq!(p, b.draw());
                    assert!(
                        p.x.abs() + p.diameter / 2.0 <= 11e-3 + 1e-12 && p.y.abs() + p.diameter / 2.0 <= 11e-3 + 1e-12
                    );
                    assert!(
                        (2e-3 - 1e-12..=20e-3 + 1e-12).contains(&p.diameter) && (-3e-3..=3.5e-3).contains(&p.depth)
                    );
                }
            }
        }
        assert_ne!(Sampler::new(RANGE, Sequence::Sobol, 1).draw(), Sampler::new(RANGE, Sequence::Sobol, 2).draw());
    }

    #[test]
    fn diameters_have_their_means() {
        let mean = |diameters| {
            let mut s = Sampler::new(PupilRange { diameters, ..RANGE }, Sequence::Sobol, 3);
            (0..4096).map(|_| s.draw().diameter * 1e3).sum::<f64>() / 4096.0
        };
        assert!((mean(Diameters::Uniform) - 11.0).abs() < 0.02);
        assert!((mean(Diameters::LogUniform) - 18.0 / 10f64.ln()).abs() < 0.02);
        assert!((mean(Diameters::Reciprocal) - 10f64.ln() / 0.45).abs() < 0.02);
    }
}
