//! Converts between an image on a window's grid and the pixels of the camera.

use crate::classified::CAMERA_PIXEL;
use crate::map::CameraMap;
use crate::pattern::transposed;
use crate::seen::points_of_pixel;
use eyebox_kernels::{Complex64, fft, modulate};
use rayon::prelude::*;

/// Up to this number of samples along an axis an image is made four times as fine for the camera. Larger images are
/// made twice as fine.
const SMALL: usize = 512;

/// A grid of samples over the SLM and its padding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) place: modulate::Args,
}

impl Grid {
    /// The factor of a finer grid, on which four samples are enough to interpolate between samples.
    fn times(&self) -> usize {
        if self.rows.max(self.columns) > SMALL { 2 } else { 4 }
    }

    /// The place of a pixel of the SLM (x, y) among the samples.
    fn of(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let place = &self.place;
        let along =
            |v: f64, first: u32, all: u32, samples: usize| (v + f64::from(first)) * samples as f64 / f64::from(all);
        [along(x, place.left, place.grid_width, self.columns), along(y, place.top, place.grid_height, self.rows)]
    }
}

/// An image with more samples than its grid.
#[derive(Debug)]
pub(super) struct Fine {
    values: Vec<f32>,
    grid: Grid,
    /// Factor by which it is finer than the grid.
    times: usize,
}

impl Fine {
    /// Refines an image on a grid that holds its spectrum.
    pub(super) fn of_image(image: &[f32], grid: Grid) -> Self {
        let times = grid.times();
        let image = image.iter().map(|v| Complex64::new(f64::from(*v), 0.0)).collect();
        let fine = finer(image, &grid, times, usize::div_ceil);
        Self { values: fine.iter().map(|v| v.re as f32).collect(), grid, times }
    }

    /// The intensity of fields (sub-frame, row, column, pairs of numbers) whose spectra fit on the grid. It is `gain`
    /// times the sum of their squares. Intensity has twice the bandwidth of the field, and the samples hold it.
    pub(super) fn of_fields(fields: &[f32], gain: f64, grid: Grid) -> Self {
        let times = grid.times();
        let mut values = vec![0.0f32; grid.rows * grid.columns * times * times];
        for frame in fields.chunks_exact(2 * grid.rows * grid.columns) {
            let frame = frame.chunks_exact(2).map(|v| Complex64::new(f64::from(v[0]), f64::from(v[1]))).collect();
            // The bins of a window follow each other, so finer bins come behind them.
            let field = finer(frame, &grid, times, |n, _| n);
            values.iter_mut().zip(field).for_each(|(sum, v)| *sum += (gain * v.norm_sqr()) as f32);
        }
        Self { values, grid, times }
    }
}

/// The camera's pixels that look at the SLM's image.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    pub(super) map: CameraMap,
    /// Their indices in the picture.
    pub(super) pixels: Vec<usize>,
    /// Indices of pixels that look past the image.
    pub(super) beside: Vec<usize>,
    /// Places that the pixels look at, (x, y) in pixels of the SLM.
    places: Vec<[f64; 2]>,
    /// Camera pixels per pixel of the SLM.
    zoom: f64,
}

impl Sensor {
    pub(super) fn new(map: CameraMap) -> Self {
        let [rows, columns] = map.slm.map(|n| n as f64);
        let (mut pixels, mut beside, mut places) = (Vec::new(), Vec::new(), Vec::new());
        for at in 0..map.camera[0] * map.camera[1] {
            let [x, y] = map.to_slm([(at % map.camera[1]) as f64, (at / map.camera[1]) as f64]);
            let within = |v: f64, most: f64, beyond: f64| (-beyond..most - 1.0 + beyond).contains(&v);
            if within(x, columns, 0.0) && within(y, rows, 0.0) {
                pixels.push(at);
                places.push([x, y]);
            } else if !(within(x, columns, 4.0) && within(y, rows, 4.0)) {
                beside.push(at);
            }
        }
        Self { map, pixels, beside, places, zoom: map.zoom() }
    }

    /// The same pixels with another map.
    pub(super) fn moved(&self, map: CameraMap) -> Self {
        let place = |at: &usize| map.to_slm([(at % map.camera[1]) as f64, (at / map.camera[1]) as f64]);
        let (pixels, beside) = (self.pixels.clone(), self.beside.clone());
        Self { map, places: pixels.iter().map(place).collect(), pixels, beside, zoom: map.zoom() }
    }

    /// The sensor with one pixel in `every`.
    pub(super) fn thinned(&self, every: usize) -> Self {
        let pixels = self.pixels.iter().copied().step_by(every).collect();
        let places = self.places.iter().copied().step_by(every).collect();
        Self { map: self.map, pixels, beside: Vec::new(), places, zoom: self.zoom }
    }

    /// Means of an image over the pixels.
    pub(super) fn see(&self, image: &Fine) -> Vec<f32> {
        let Fine { values, grid, times } = image;
        let [rows, columns] = [grid.rows * times, grid.columns * times];
        let points = points_of_pixel(CAMERA_PIXEL).map(|at| at.map(|v| v / self.zoom));
        let value = |[x, y]: [f64; 2]| {
            let [x, y] = grid.of([x, y]).map(|v| v * *times as f64);
            let (first_x, first_y) = (x.floor(), y.floor());
            let (along_x, along_y) = (cubic(x - first_x), cubic(y - first_y));
            let index = |first: f64, i: usize, n: usize| (first as i64 + i as i64 - 1).rem_euclid(n as i64) as usize;
            let row = |i: usize| {
                let row = &values[index(first_y, i, rows) * columns..][..columns];
                (0..4).map(|j| along_x[j] * f64::from(row[index(first_x, j, columns)])).sum::<f64>()
            };
            (0..4).map(|i| along_y[i] * row(i)).sum::<f64>()
        };
        let pixel = |[x, y]: &[f64; 2]| {
            (points.iter().map(|[dx, dy]| value([x + dx, y + dy])).sum::<f64>() / points.len() as f64) as f32
        };
        self.places.par_iter().map(pixel).collect()
    }

    /// Spreads values of the pixels onto a grid. Each sample is a mean over the pixels around it, as far as the coarser
    /// of the two pitches reaches. NaN pixels have no weight. A sample without pixels is 0.
    pub(super) fn spread(&self, values: &[f32], grid: &Grid) -> Vec<f32> {
        let place = &grid.place;
        let pitch = |samples: usize, all: u32| (samples as f64 / f64::from(all) / self.zoom).max(1.0);
        let [reach_x, reach_y] = [pitch(grid.columns, place.grid_width), pitch(grid.rows, place.grid_height)];
        let mut sums = vec![[0.0f64; 2]; grid.rows * grid.columns];
        for (at, value) in self.places.iter().zip(values).filter(|(_, v)| v.is_finite()) {
            let [x, y] = grid.of(*at);
            let around = |v: f64, reach: f64, n: usize| {
                let (first, last) = ((v - reach).ceil().max(0.0) as usize, (v + reach).floor().min(n as f64 - 1.0));
                (first..=last.max(0.0) as usize).map(move |i| (i, 1.0 - (i as f64 - v).abs() / reach))
            };
            for (row, of_row) in around(y, reach_y, grid.rows) {
                for (column, of_column) in around(x, reach_x, grid.columns) {
                    let weight = (of_row * of_column).max(0.0);
                    let [sum, weights] = &mut sums[row * grid.columns + column];
                    *sum += weight * f64::from(*value);
                    *weights += weight;
                }
            }
        }
        sums.iter().map(|[sum, weights]| if *weights > 1e-9 { (sum / weights) as f32 } else { 0.0 }).collect()
    }
}

/// Lagrange weights of four samples around a place between the middle two.
fn cubic(t: f64) -> [f64; 4] {
    let (a, b, c) = (t + 1.0, t - 1.0, t - 2.0);
    [-t * b * c / 6.0, a * b * c / 2.0, -t * a * c / 2.0, t * a * b / 6.0]
}

/// Values at `up` times as many samples along both axes, by their spectrum. The bins before `half(n, 2)` of each axis
/// stay at its start.
fn finer(values: Vec<Complex64>, grid: &Grid, up: usize, half: fn(usize, usize) -> usize) -> Vec<Complex64> {
    // The transform runs along one axis, then along the other, and each returns its lines transposed.
    let axis = |mut lines: Vec<Complex64>, n: usize| {
        fft::transform_f64(&mut lines, n, fft::Direction::Forward);
        let (mut wide, half) = (vec![Complex64::default(); lines.len() * up], half(n, 2));
        for (to, from) in wide.chunks_exact_mut(n * up).zip(lines.chunks_exact(n)) {
            to[..half].copy_from_slice(&from[..half]);
            to[n * up - (n - half)..].copy_from_slice(&from[half..]);
        }
        fft::transform_f64(&mut wide, n * up, fft::Direction::Inverse);
        wide.iter_mut().for_each(|v| *v /= n as f64);
        transposed(&wide, n * up)
    };
    axis(axis(values, grid.columns), grid.rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// A rotated and shifted camera over a grid with padding.
    fn bench() -> (Sensor, Grid, CameraMap) {
        let numbers = [0.9, 0.03, 0.02, -0.03, 0.91, -0.05, 0.02, -0.01, 0.01, 0.0];
        let map = CameraMap { numbers, slm: [40, 48], camera: [84, 90] };
        let place = modulate::Args { height: 40, width: 48, grid_height: 48, grid_width: 60, top: 4, left: 6 };
        (Sensor::new(map), Grid { rows: 20, columns: 30, place }, map)
    }

    #[test]
    fn what_pixels_see_of_a_wave_is_the_wave_where_they_look() {
        let (sensor, grid, map) = bench();
        let wave = |x: f64, y: f64| 1.0 + 0.5 * (TAU * (5.0 * (x + 6.0) / 60.0 - 3.0 * (y + 4.0) / 48.0)).cos();
        let sample = |i: usize| wave((i % 30) as f64 * 2.0 - 6.0, (i / 30) as f64 * 2.4 - 4.0) as f32;
        let seen = sensor.see(&Fine::of_image(&(0..600).map(sample).collect::<Vec<_>>(), grid));
        assert!(sensor.pixels.len() > 1500 && !sensor.beside.is_empty());
        for (at, seen) in sensor.pixels.iter().zip(seen) {
            let [x, y] = map.to_slm([(at % 90) as f64, (at / 90) as f64]);
            // The size of a pixel lowers the contrast a little.
            assert!((f64::from(seen) - wave(x, y)).abs() < 0.02, "at {x}, {y}: {seen}, not {}", wave(x, y));
        }
    }

    #[test]
    fn fields_are_seen_with_all_the_bandwidth_of_their_squares() {
        let (sensor, grid, map) = bench();
        // The two waves are at the ends of the grid's bins, and the samples do not hold their beat.
        let phases = |x: f64, y: f64| [0.0, TAU * (17.0 * (x + 6.0) / 60.0 + 11.0 * (y + 4.0) / 48.0)];
        let field = |x: f64, y: f64| {
            let [a, b] = phases(x, y).map(Complex64::cis);
            a + 0.5 * b
        };
        let sample = |i: usize| field((i % 30) as f64 * 2.0 - 6.0, (i / 30) as f64 * 2.4 - 4.0);
        let fields: Vec<f32> = (0..600).map(sample).flat_map(|v| [v.re as f32, v.im as f32]).collect();
        let seen = sensor.see(&Fine::of_fields(&[&fields[..], &fields].concat(), 0.5, grid));
        for (at, seen) in sensor.pixels.iter().zip(seen) {
            let [x, y] = map.to_slm([(at % 90) as f64, (at / 90) as f64]);
            assert!((f64::from(seen) - field(x, y).norm_sqr()).abs() < 0.1, "at {x}, {y}: {seen}");
        }
    }

    #[test]
    fn what_is_spread_lies_where_it_was_seen() {
        let (sensor, grid, map) = bench();
        let slope = |[x, y]: [f64; 2]| 0.3 + 0.02 * x - 0.01 * y;
        let mut values: Vec<f32> =
            sensor.pixels.iter().map(|at| slope(map.to_slm([(at % 90) as f64, (at / 90) as f64])) as f32).collect();
        values[700] = f32::NAN;
        let spread = sensor.spread(&values, &grid);
        let mut inside = 0;
        for (i, got) in spread.iter().enumerate() {
            let at = [(i % 30) as f64 * 2.0 - 6.0, (i / 30) as f64 * 2.4 - 4.0];
            if (3.0..44.0).contains(&at[0]) && (3.0..36.0).contains(&at[1]) {
                assert!((f64::from(*got) - slope(at)).abs() < 0.02, "at {at:?}: {got}, not {}", slope(at));
                inside += 1;
            }
        }
        assert!(inside > 200 && spread[0] == 0.0, "{inside}");
    }
}
