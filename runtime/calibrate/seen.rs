//! Predicts the light at a camera's pixels from the spectrum that enters an iris.
//!
//! A non-uniform transform gives the field at any places of the image.

use super::device::{Window, optics_of};
use super::map::CameraMap;
use super::parameters::{Parameter, Parameters};
use super::pattern::transposed;
use eyebox_kernels::{Complex64, fft};
use eyebox_optics::{Optics, Pupil, SlmPart, fast_size, transfer, zernike};
use std::f64::consts::{PI, TAU};
use std::sync::OnceLock;

/// Width of the interpolating kernel, grid points. Its error is 1e-5 if the grid is twice as fine as the field.
const TAPS: usize = 6;
/// Shape of the kernel (Beatty, Nishimura and Pauly 2005).
const BETA: f64 = 13.86;
/// Number of points that sample a camera's pixel.
pub(super) const POINTS: usize = 4;

/// Points of a camera's pixel (x, y) from its middle. They are the two by two Gauss points of the square that sees
/// light. `share` is the area of the square as a share of the pixel.
pub(super) fn points_of_pixel(share: f64) -> [[f64; 2]; POINTS] {
    let off = (share / 12.0).sqrt();
    [[-off, -off], [off, -off], [-off, off], [off, off]]
}

/// The kernel at |t| <= 1, from a table. Its shape is smooth in t.
fn tap(t: f64) -> f64 {
    const STEPS: usize = 1 << 14;
    static TABLE: OnceLock<Vec<f64>> = OnceLock::new();
    let value = |i: usize| {
        let t = (i.min(STEPS) as f64) / STEPS as f64;
        bessel(BETA * (1.0 - t * t).max(0.0).sqrt()) / bessel(BETA)
    };
    let table = TABLE.get_or_init(|| (0..=STEPS + 1).map(value).collect());
    let place = t.abs().min(1.0) * STEPS as f64;
    let (i, share) = (place as usize, place.fract());
    table[i] * (1.0 - share) + table[i + 1] * share
}

/// The modified Bessel function of order 0.
fn bessel(x: f64) -> f64 {
    let quarter = x * x / 4.0;
    let (mut sum, mut term) = (1.0, 1.0);
    for k in 1..60 {
        term *= quarter / f64::from(k * k);
        sum += term;
        if term < 1e-17 * sum {
            break;
        }
    }
    sum
}

/// The pixels of a camera that look at a part of the SLM through an iris.
#[derive(Clone)]
pub(super) struct Look {
    /// The optics of this part only.
    pub(super) optics: Optics,
    part: SlmPart,
    pub(super) window: Window,
    /// The iris as it was requested.
    pub(super) pupil: Pupil,
    pub(super) radius: f64,
    side: usize,
    /// Camera pixels (x, y).
    pub(super) pixels: Vec<[f64; 2]>,
}

/// Positions of points on the grid, as first grid points and weights along both axes.
pub(super) struct Places {
    first: Vec<[usize; 2]>,
    weights: Vec<[[f64; TAPS]; 2]>,
}

/// Intensity at the camera's pixels, and its slopes by parameter.
#[derive(Default)]
pub(super) struct Prediction {
    pub(super) intensity: Vec<f64>,
    pub(super) slopes: Vec<Vec<f64>>,
}

impl Prediction {
    /// Joins the predictions of all parts of an SLM, in their order.
    pub(super) fn joined(parts: Vec<Self>) -> Self {
        parts.into_iter().reduce(Self::and).unwrap_or_default()
    }

    fn and(mut self, other: Self) -> Self {
        self.intensity.extend(other.intensity);
        self.slopes.iter_mut().zip(other.slopes).for_each(|(slopes, more)| slopes.extend(more));
        self
    }
}

impl Look {
    /// A look through an iris as it was requested, at a part of an SLM with these optics. `radius` is of the
    /// wavefront's disc, meters.
    pub(super) fn new(
        (part, optics): (SlmPart, &Optics),
        pupil: Pupil,
        radius: f64,
        at: &Parameters,
        pixels: Vec<[f64; 2]>,
    ) -> Self {
        let optics = optics_of(&part, optics);
        let (window, side) = Self::frame(&optics, &at.model.true_pupil(&pupil));
        Self { optics, part, window, pupil, radius, side, pixels }
    }

    pub(super) fn of(&self, pixels: Vec<[f64; 2]>) -> Self {
        Self { pixels, ..self.clone() }
    }

    /// The window of bins that an iris passes, and the side of the grid for it. The window has a margin for an iris
    /// that is not exactly at its requested place.
    fn frame(optics: &Optics, iris: &Pupil) -> (Window, usize) {
        let (bin_y, bin_x) = optics.bin_size();
        let reach = iris.diameter / 2.0 + 0.4e-3 + 0.02 * (iris.x.abs().max(iris.y.abs()) + iris.diameter / 2.0);
        let size = (2.0 * reach / bin_y.min(bin_x)).ceil() as usize + 4;
        // Bins that do not exist are not carried along.
        let size = size.min(optics.height.max(optics.width) + 2);
        let first = |centre: f64, bin: f64, n: usize| {
            let lowest = (centre / bin).round() as i64 - size as i64 / 2;
            let half = n as i64 / 2 + 1;
            lowest.clamp(-half, (half - size as i64).max(-half))
        };
        let first = [first(iris.y, bin_y, optics.height), first(iris.x, bin_x, optics.width)];
        (Window { first, size }, fast_size(2 * size))
    }

    /// True if the window contains all that the iris passes.
    pub(super) fn holds(&self, at: &Parameters) -> bool {
        let iris = at.model.true_pupil(&self.pupil);
        let (bin_y, bin_x) = self.optics.bin_size();
        let inside = |centre: f64, bin: f64, first: i64, n: usize| {
            let (low, high) = ((centre - iris.diameter / 2.0) / bin, (centre + iris.diameter / 2.0) / bin);
            let half = n as f64 / 2.0;
            low.max(-half) >= first as f64 - 0.5 && high.min(half) <= first as f64 + self.window.size as f64 + 0.5
        };
        let [y, x] = self.window.first;
        inside(iris.y, bin_y, y, self.optics.height) && inside(iris.x, bin_x, x, self.optics.width)
    }

    /// The product K R in the window.
    pub(super) fn kernel(&self, at: &Parameters) -> Vec<Complex64> {
        let pupil = at.model.true_pupil(&self.pupil);
        self.window.bins().map(|bin| self.kernel_at(at, &pupil, bin)).collect()
    }

    /// The product K R of an iris at its true place, at one bin.
    pub(super) fn kernel_at(&self, at: &Parameters, iris: &Pupil, (ky, kx): (i64, i64)) -> Complex64 {
        let (bin_y, bin_x) = self.optics.bin_size();
        let (covered, iris) = match at.soft_edge {
            true => {
                let bin = bin_y.min(bin_x);
                let off = (kx as f64 * bin_x - iris.x).hypot(ky as f64 * bin_y - iris.y) - iris.diameter / 2.0;
                ((0.5 - off / bin).clamp(0.0, 1.0), Pupil { diameter: iris.diameter + 2.0 * bin, ..*iris })
            }
            false => (1.0, *iris),
        };
        let (re, im) = if covered > 0.0 { transfer(&self.optics, &iris, ky, kx) } else { (0.0, 0.0) };
        if (re, im) == (0.0, 0.0) {
            return Complex64::default();
        }
        let turns = at.model.wavefront_turns(kx as f64 * bin_x, ky as f64 * bin_y, self.radius);
        Complex64::new(re, im) * Complex64::cis(TAU * turns) * covered
    }

    /// The change of K R with a parameter, or none if it does not depend on it.
    fn kernel_slope(&self, at: &Parameters, kernel: &[Complex64], parameter: Parameter) -> Option<Vec<Complex64>> {
        let (bin_y, bin_x) = self.optics.bin_size();
        match parameter {
            Parameter::Wavefront(j) => {
                let factor = |(ky, kx): (i64, i64)| {
                    let [y, x] = [ky as f64 * bin_y, kx as f64 * bin_x].map(|v| v / self.radius);
                    Complex64::new(0.0, TAU * zernike(j, x, y))
                };
                Some(self.window.bins().zip(kernel).map(|(bin, k)| k * factor(bin)).collect())
            }
            Parameter::Iris(i) => {
                // A hard edge jumps from bin to bin, and a step of a bin and a half smooths it.
                let far = if at.soft_edge { 0.25 } else { 1.5 } * bin_y.min(bin_x) * 1e3;
                let reach = self.pupil.diameter / 2.0 + self.pupil.x.hypot(self.pupil.y);
                let step = if i == 2 { far / (reach * 1e3) } else { far };
                let [after, before] = [step, -step].map(|step| self.kernel(&at.moved(parameter, step)));
                Some(after.iter().zip(before).map(|(a, b)| (a - b) / (2.0 * step)).collect())
            }
            _ => None,
        }
    }

    /// Points of the part's image that the pixels look at, `POINTS` for each pixel.
    pub(super) fn points(&self, map: &CameraMap, camera_pixel: f64) -> Vec<[f64; 2]> {
        let around = points_of_pixel(camera_pixel);
        let [row, column] = self.part.first.map(|n| n as f64);
        let to_part = |[x, y]: [f64; 2]| [x - column, y - row];
        self.pixels.iter().flat_map(|[x, y]| around.map(|[dx, dy]| to_part(map.to_slm([x + dx, y + dy])))).collect()
    }

    /// The positions of points on the grid.
    pub(super) fn places(&self, points: &[[f64; 2]]) -> Places {
        let side = self.side as f64;
        let scale = [side / self.optics.width as f64, side / self.optics.height as f64];
        let (mut first, mut weights) = (Vec::new(), Vec::new());
        for point in points {
            let mut at = [0; 2];
            let mut weight = [[0.0; TAPS]; 2];
            for axis in 0..2 {
                let g = (point[axis] * scale[axis]).rem_euclid(side);
                let lowest = (g - TAPS as f64 / 2.0).ceil();
                at[axis] = (lowest as i64).rem_euclid(self.side as i64) as usize;
                for (i, w) in weight[axis].iter_mut().enumerate() {
                    *w = tap(2.0 * (g - lowest - i as f64) / TAPS as f64);
                }
            }
            first.push(at);
            weights.push(weight);
        }
        Places { first, weights }
    }

    /// The correction of the interpolation, by a bin's place in the window.
    pub(super) fn undo(&self) -> Vec<f64> {
        let norm = bessel(BETA).recip();
        let value = |i: usize| {
            let k = (i as f64 - (self.window.size / 2) as f64) / self.side as f64;
            let root = (BETA * BETA - (PI * TAPS as f64 * k).powi(2)).max(1e-9).sqrt();
            (TAPS as f64 * root.sinh() / root * norm).recip()
        };
        (0..self.window.size).map(value).collect()
    }

    /// The field at places, from its spectrum in the window. The carrier is left out, because no intensity depends on
    /// it.
    pub(super) fn at(&self, spectrum: &[Complex64], places: &Places, undo: &[f64]) -> Vec<Complex64> {
        self.between(&self.grid(spectrum, undo), places)
    }

    /// The field on the grid, (column, row).
    fn grid(&self, spectrum: &[Complex64], undo: &[f64]) -> Vec<Complex64> {
        let (n, side) = (self.window.size, self.side);
        let scale = 1.0 / (self.optics.height * self.optics.width) as f64;
        let home = |i: usize| (i + side - n / 2) % side;
        let mut rows = vec![Complex64::default(); n * side];
        for (i, row) in spectrum.chunks_exact(n).enumerate() {
            let factor = undo[i] * scale;
            row.iter().enumerate().for_each(|(j, v)| rows[i * side + home(j)] = v * (undo[j] * factor));
        }
        fft::transform_f64(&mut rows, side, fft::Direction::Inverse);
        let mut grid = vec![Complex64::default(); side * side];
        let turned = transposed(&rows, side);
        for (column, from) in grid.chunks_exact_mut(side).zip(turned.chunks_exact(n)) {
            from.iter().enumerate().for_each(|(i, v)| column[home(i)] = *v);
        }
        fft::transform_f64(&mut grid, side, fft::Direction::Inverse);
        grid
    }

    /// The field at places between the points of the grid.
    fn between(&self, grid: &[Complex64], places: &Places) -> Vec<Complex64> {
        let side = self.side;
        let value = |(first, [wx, wy]): (&[usize; 2], &[[f64; TAPS]; 2])| {
            let mut sum = Complex64::default();
            for (i, wx) in wx.iter().enumerate() {
                let column = &grid[(first[0] + i) % side * side..][..side];
                let mut part = Complex64::default();
                if first[1] + TAPS <= side {
                    column[first[1]..first[1] + TAPS].iter().zip(wy).for_each(|(v, w)| part += v * *w);
                } else {
                    wy.iter().enumerate().for_each(|(j, w)| part += column[(first[1] + j) % side] * *w);
                }
                sum += part * *wx;
            }
            sum
        };
        places.first.iter().zip(&places.weights).map(value).collect()
    }

    /// Intensity at the pixels for the spectra `fields` that enter in each sub-frame, and its slopes by `free`. `by`
    /// has the changes of the spectra (by parameter, then sub-frame) for parameters of the device.
    pub(super) fn see(
        &self,
        at: &Parameters,
        fields: &[&[Complex64]],
        free: &[Parameter],
        by: &[Vec<&[Complex64]>],
    ) -> Prediction {
        if self.pixels.is_empty() {
            return Prediction { intensity: Vec::new(), slopes: vec![Vec::new(); free.len()] };
        }
        let kernel = self.kernel(at);
        let points = self.points(&at.map, at.camera_pixel);
        let (places, undo) = (self.places(&points), self.undo());
        let times = |a: &[Complex64], b: &[Complex64]| a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>();
        let share = 1.0 / (fields.len() * POINTS) as f64;
        let mut intensity = vec![0.0; self.pixels.len()];
        let mut slopes = vec![vec![0.0; self.pixels.len()]; free.len()];
        let moves: Vec<Option<Vec<[f64; 2]>>> = free.iter().map(|p| self.moves(at, &points, *p)).collect();
        let kernels: Vec<_> = free.iter().map(|p| self.kernel_slope(at, &kernel, *p)).collect();
        for (t, field) in fields.iter().enumerate() {
            let spectrum = times(field, &kernel);
            let v = self.at(&spectrum, &places, &undo);
            for (sum, v) in intensity.iter_mut().zip(v.chunks_exact(POINTS)) {
                *sum += v.iter().map(|v| v.norm_sqr()).sum::<f64>() * share;
            }
            let moved = moves.iter().any(Option::is_some).then(|| {
                let half = self.window.size as i64 / 2;
                let n = self.window.size as i64;
                let along = |x: bool| {
                    let turn = TAU / if x { self.optics.width } else { self.optics.height } as f64;
                    let factor = |i: usize| {
                        let i = i as i64;
                        Complex64::new(0.0, turn * (if x { i % n } else { i / n } - half) as f64)
                    };
                    let slope: Vec<_> = spectrum.iter().enumerate().map(|(i, v)| v * factor(i)).collect();
                    let slope = self.at(&slope, &places, &undo);
                    v.iter().zip(slope).map(|(v, s)| 2.0 * (v.conj() * s).re).collect::<Vec<f64>>()
                };
                [along(true), along(false)]
            });
            for (p, slope) in slopes.iter_mut().enumerate() {
                if let (Some(moves), Some([along_x, along_y])) = (&moves[p], &moved) {
                    for (i, [dx, dy]) in moves.iter().enumerate() {
                        slope[i / POINTS] += (along_x[i] * dx + along_y[i] * dy) * share;
                    }
                    continue;
                }
                let changed = match &kernels[p] {
                    Some(kernel) => times(field, kernel),
                    None => times(by[p][t], &kernel),
                };
                let changed = self.at(&changed, &places, &undo);
                for (i, (v, c)) in v.iter().zip(changed).enumerate() {
                    slope[i / POINTS] += 2.0 * (v.conj() * c).re * share;
                }
            }
        }
        Prediction { intensity, slopes }
    }

    /// Intensity at the pixels for the spectra that enter in each sub-frame, for other maps of the camera, by map.
    pub(super) fn see_from(&self, at: &Parameters, fields: &[&[Complex64]], cameras: &[CameraMap]) -> Vec<Vec<f64>> {
        if self.pixels.is_empty() {
            return vec![Vec::new(); cameras.len()];
        }
        let (kernel, undo) = (self.kernel(at), self.undo());
        let lit = |field: &&[Complex64]| {
            let spectrum: Vec<_> = field.iter().zip(&kernel).map(|(f, k)| f * k).collect();
            self.grid(&spectrum, &undo)
        };
        let grids: Vec<_> = fields.iter().map(lit).collect();
        let share = 1.0 / (fields.len() * POINTS) as f64;
        let of_camera = |map: &CameraMap| {
            let places = self.places(&self.points(map, at.camera_pixel));
            let mut intensity = vec![0.0; self.pixels.len()];
            for grid in &grids {
                for (sum, v) in intensity.iter_mut().zip(self.between(grid, &places).chunks_exact(POINTS)) {
                    *sum += v.iter().map(|v| v.norm_sqr()).sum::<f64>() * share;
                }
            }
            intensity
        };
        cameras.iter().map(of_camera).collect()
    }

    /// The movement of the points with a parameter of the camera, SLM pixels (x, y).
    fn moves(&self, at: &Parameters, points: &[[f64; 2]], parameter: Parameter) -> Option<Vec<[f64; 2]>> {
        if !matches!(parameter, Parameter::Map(_) | Parameter::CameraPixel) {
            return None;
        }
        let step = parameter.step();
        let moved = at.moved(parameter, step);
        let after = self.points(&moved.map, moved.camera_pixel);
        Some(after.iter().zip(points).map(|(a, b)| [0, 1].map(|i| (a[i] - b[i]) / step)).collect())
    }
}
