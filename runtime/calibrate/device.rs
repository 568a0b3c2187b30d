//! Computes the spectrum that enters an iris from drive phases, in float64.
//!
//! The device also has the slopes of the spectrum by each number of the model.

use super::parameters::{Parameter, Parameters};
use super::pattern::{Pattern, transformed, transposed};
use eyebox_kernels::{Complex64, fft};
use eyebox_optics::{DisplayModel, Optics, SlmPart, frequency_bin};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// A square of bins around an iris.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Window {
    pub(super) first: [i64; 2],
    pub(super) size: usize,
}

impl Window {
    /// Row and column of each of its bins.
    pub(super) fn bins(&self) -> impl Iterator<Item = (i64, i64)> {
        let ([y, x], n) = (self.first, self.size as i64);
        (0..n * n).map(move |i| (y + i / n, x + i % n))
    }
}

/// The model as tables.
#[derive(Clone)]
pub(super) struct Device {
    /// The optics of this part only.
    optics: Optics,
    part: SlmPart,
    /// Sub-pixels of a pixel along an axis.
    subpixels: usize,
    model: DisplayModel,
    level: Vec<f64>,
    amplitude: Vec<f64>,
    /// Transfer from pixels to the phases of sub-pixels along y and x, with the factors of the transforms, or none
    /// without crosstalk.
    transfer: Option<[Vec<Complex64>; 2]>,
    /// The pixel's aperture along y and x, by bin.
    aperture: [Vec<Complex64>; 2],
    /// Zero order behind the aperture, by bin.
    rest: Vec<Complex64>,
}

/// A set of consecutive patterns on a part of the SLM, with the windows of the irises.
pub(super) struct Set {
    pub(super) pattern: Pattern,
    pub(super) windows: Vec<Window>,
}

pub(super) fn optics_of(part: &SlmPart, optics: &Optics) -> Optics {
    Optics { height: part.size[0], width: part.size[1], ..*optics }
}

/// Fields in windows, by sub-frame, window and bin.
type Fields = Vec<Vec<Vec<Complex64>>>;

impl Device {
    /// Tables of a model for a part of an SLM with these optics. `subpixels` counts only with crosstalk.
    pub(super) fn new(model: &DisplayModel, part: SlmPart, optics: &Optics, subpixels: usize) -> Self {
        let optics = optics_of(&part, optics);
        let (height, width) = (optics.height, optics.width);
        let p = if model.crosstalk.is_some() { subpixels } else { 1 };
        let sides = [height, width];
        let transfer = Self::crosstalk(model, optics, p);
        let aperture = sides.map(|n| {
            let k = |i: usize| frequency_bin(i as i64, n) as f64 / n as f64;
            (0..n).map(|i| model.pixel_aperture(k(i), p) / p as f64).collect()
        });
        let amplitude = model.source_amplitude(part);
        let rest = if model.undiffracted.is_empty() {
            vec![Complex64::default(); height * width]
        } else {
            let share = model.undiffracted_share(part);
            let field = share.iter().zip(&amplitude).map(|(s, a)| s * a).collect();
            let mut rest = transformed(field, sides, fft::Direction::Forward);
            let sinc = sides.map(|n| {
                let k = |i: usize| frequency_bin(i as i64, n) as f64 / n as f64;
                (0..n).map(|i| model.pixel_aperture(k(i), 1)).collect::<Vec<_>>()
            });
            rest.iter_mut().enumerate().for_each(|(i, v)| *v *= sinc[0][i / width] * sinc[1][i % width]);
            rest
        };
        let level = model.level_map(part);
        Self { optics, part, subpixels: p, model: model.clone(), level, amplitude, transfer, aperture, rest }
    }

    fn crosstalk(model: &DisplayModel, optics: Optics, p: usize) -> Option<[Vec<Complex64>; 2]> {
        let [along_y, along_x] = model.crosstalk_kernels(optics.height, optics.width, p)?;
        let axis = |kernel: Vec<f64>| {
            let count = kernel.len();
            let mut line: Vec<Complex64> = kernel.into_iter().map(Complex64::from).collect();
            fft::transform_f64(&mut line, count, fft::Direction::Forward);
            for (k, v) in line.iter_mut().enumerate() {
                let turn = -TAU * k as f64 / count as f64;
                *v *= (0..p).map(|i| Complex64::cis(turn * i as f64)).sum::<Complex64>() / count as f64;
            }
            line
        };
        Some([axis(along_y), axis(along_x)])
    }

    /// The tables after one step of a parameter.
    fn further(&self, at: &Parameters, parameter: Parameter) -> Self {
        let model = at.moved(parameter, parameter.step()).model;
        match parameter {
            Parameter::Crosstalk(_) => {
                let transfer = Self::crosstalk(&model, self.optics, self.subpixels);
                Self { transfer, model, ..self.clone() }
            }
            Parameter::Level(_) => Self { level: model.level_map(self.part), model, ..self.clone() },
            Parameter::Bend(_) | Parameter::Lag => Self { model, ..self.clone() },
            _ => Self::new(&model, self.part, &self.optics, self.subpixels),
        }
    }

    /// The tables after one step of each of these parameters, made once for all sets.
    pub(super) fn all_further(&self, at: &Parameters, free: &[Parameter]) -> Vec<Further> {
        free.par_iter().map(|&parameter| Further { device: self.further(at, parameter), parameter }).collect()
    }

    /// Phases of the pixels, with lag, by sub-frame.
    fn settled(&self, pattern: &Pattern) -> Vec<Vec<f64>> {
        let looked_up = |frame: &[f32]| -> Vec<f64> {
            frame.iter().zip(&self.level).map(|(w, level)| self.model.look_up(f64::from(*w), *level).0).collect()
        };
        let driven: Vec<Vec<f64>> = (0..pattern.frames).map(|t| looked_up(pattern.frame(t))).collect();
        if self.model.lag == 0.0 || pattern.frames == 1 {
            return driven;
        }
        let shares = self.model.lag_shares(pattern.frames);
        let mixed = |t: usize| {
            let mut sum = vec![0.0; driven[0].len()];
            for (k, share) in shares.iter().enumerate() {
                let before = &driven[(t + pattern.frames - k) % pattern.frames];
                sum.iter_mut().zip(before).for_each(|(s, b)| *s += share * b);
            }
            sum
        };
        (0..pattern.frames).map(mixed).collect()
    }

    /// Spreads two real images at once, as real and imaginary part, onto sub-pixels (column, row).
    fn spread(&self, image: &[Complex64]) -> Vec<Complex64> {
        let (height, width, p) = (self.optics.height, self.optics.width, self.subpixels);
        let Some([along_y, along_x]) = &self.transfer else { return transposed(image, width) };
        let axis = |mut lines: Vec<Complex64>, n: usize, transfer: &[Complex64]| {
            fft::transform_f64(&mut lines, n, fft::Direction::Forward);
            let mut out = Vec::with_capacity(lines.len() * p);
            for line in lines.chunks_exact(n) {
                transfer.chunks_exact(n).for_each(|part| out.extend(part.iter().zip(line).map(|(t, v)| t * v)));
            }
            fft::transform_f64(&mut out, n * p, fft::Direction::Inverse);
            out
        };
        let wide = axis(image.to_vec(), width, along_x);
        axis(transposed(&wide, width * p), height, along_y)
    }

    /// The field's spectrum in each window, before the aperture. The field is (column, row) on sub-pixels, and is
    /// consumed.
    fn spectra(&self, mut field: Vec<Complex64>, windows: &[Window]) -> Vec<Vec<Complex64>> {
        let (rows, columns) = (self.optics.height * self.subpixels, self.optics.width * self.subpixels);
        fft::transform_f64(&mut field, rows, fft::Direction::Forward);
        let index = |k: i64, n: usize| k.rem_euclid(n as i64) as usize;
        let mut place = vec![usize::MAX; rows];
        let mut used = Vec::new();
        for k in windows.iter().flat_map(|w| (0..w.size as i64).map(|i| w.first[0] + i)) {
            let row = index(k, rows);
            if place[row] == usize::MAX {
                place[row] = used.len();
                used.push(row);
            }
        }
        let mut lines = vec![Complex64::default(); used.len() * columns];
        for (x, column) in field.chunks_exact(rows).enumerate() {
            used.iter().enumerate().for_each(|(i, row)| lines[i * columns + x] = column[*row]);
        }
        fft::transform_f64(&mut lines, columns, fft::Direction::Forward);
        let at = |(ky, kx): (i64, i64)| match self.optics.has_bin(ky, kx) {
            true => lines[place[index(ky, rows)] * columns + index(kx, columns)],
            false => Complex64::default(),
        };
        windows.iter().map(|w| w.bins().map(at).collect()).collect()
    }

    /// A spectrum behind the aperture, with the zero order.
    fn behind(&self, window: &Window, raw: &[Complex64]) -> Vec<Complex64> {
        let share = self.model.modulated_share();
        self.dressed(window, raw, |v, rest| v * share + rest)
    }

    fn dressed(
        &self,
        window: &Window,
        raw: &[Complex64],
        join: impl Fn(Complex64, Complex64) -> Complex64,
    ) -> Vec<Complex64> {
        let value = |((ky, kx), v): ((i64, i64), &Complex64)| {
            if !self.optics.has_bin(ky, kx) {
                return Complex64::default();
            }
            let (y, x) = self.optics.index_of(ky, kx);
            join(v * self.aperture[0][y] * self.aperture[1][x], self.rest[y * self.optics.width + x])
        };
        window.bins().zip(raw).map(value).collect()
    }

    /// The light on sub-pixels without the zero order, (column, row), and the phases of the sub-pixels.
    fn field(&self, settled: &[f64]) -> (Vec<Complex64>, Vec<f64>) {
        let image: Vec<Complex64> = settled.iter().map(|m| Complex64::new(*m, 0.0)).collect();
        let phase: Vec<f64> = self.spread(&image).into_iter().map(|v| v.re).collect();
        let rows = self.optics.height * self.subpixels;
        let light = |(i, w): (usize, &f64)| {
            let (x, y) = (i / rows / self.subpixels, i % rows / self.subpixels);
            Complex64::from_polar(self.amplitude[y * self.optics.width + x], *w)
        };
        (phase.iter().enumerate().map(light).collect(), phase)
    }

    /// The light that enters each window in each sub-frame, and its slopes by each parameter of `free`. The slopes are
    /// by parameter first.
    pub(super) fn enter(&self, set: &Set, free: &[Further]) -> (Fields, Vec<Fields>) {
        let settled = self.settled(&set.pattern);
        let slopes: Vec<Slope> = free.iter().map(|further| Slope::new(set, &settled, further)).collect();
        let (mut fields, mut by) = (Vec::new(), vec![Vec::new(); free.len()]);
        for t in 0..set.pattern.frames {
            let (light, phase) = self.field(&settled[t]);
            let raw = self.spectra(light.clone(), &set.windows);
            // Two changes of the phase go through the crosstalk at once.
            let turns: Vec<&Vec<f64>> = slopes.iter().filter_map(|s| s.settled.as_ref().map(|all| &all[t])).collect();
            let mut spread = Vec::new();
            for pair in turns.chunks(2) {
                let second = pair.get(1).unwrap_or(&pair[0]);
                let image: Vec<Complex64> = pair[0].iter().zip(*second).map(|(a, b)| Complex64::new(*a, *b)).collect();
                let both = self.spread(&image);
                spread.push(both.iter().map(|v| v.re).collect::<Vec<f64>>());
                spread.push(both.into_iter().map(|v| v.im).collect());
            }
            let mut spread = spread.into_iter();
            for (slope, by) in slopes.iter().zip(&mut by) {
                let turn = slope.settled.as_ref().and_then(|_| spread.next());
                by.push(slope.enter(self, set, &settled[t], &light, &phase, &raw, turn));
            }
            fields.push(set.windows.iter().zip(&raw).map(|(w, raw)| self.behind(w, raw)).collect());
        }
        (fields, by)
    }
}

/// The tables after one step of a parameter.
pub(super) struct Further {
    device: Device,
    parameter: Parameter,
}

/// The change of the light that leaves a set's pixels with a parameter.
struct Slope<'f> {
    further: &'f Further,
    /// Change of the settled phases, by sub-frame.
    settled: Option<Vec<Vec<f64>>>,
}

impl<'f> Slope<'f> {
    fn new(set: &Set, settled: &[Vec<f64>], further: &'f Further) -> Self {
        let Further { device, parameter } = further;
        let step = parameter.step();
        let phases = parameter.is_of_drive().then(|| {
            let difference = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| (a - b) / step).collect();
            device.settled(&set.pattern).iter().zip(settled).map(difference).collect()
        });
        Self { further, settled: phases }
    }

    /// The slope of the light that enters each window in a sub-frame.
    #[allow(clippy::too_many_arguments, reason = "all values of the sub-frame")]
    fn enter(
        &self,
        device: &Device,
        set: &Set,
        settled: &[f64],
        light: &[Complex64],
        phase: &[f64],
        raw: &[Vec<Complex64>],
        turn: Option<Vec<f64>>,
    ) -> Vec<Vec<Complex64>> {
        let Further { device: moved, parameter } = self.further;
        let step = parameter.step();
        let share = device.model.modulated_share();
        let of_field = |field: Vec<Complex64>, rest: bool| -> Vec<Vec<Complex64>> {
            let windows = device.spectra(field, &set.windows);
            let all = windows.iter().zip(&set.windows);
            all.map(|(raw, window)| {
                let mut out = device.dressed(window, raw, |v, _| v * share);
                if rest {
                    let zero = vec![Complex64::default(); raw.len()];
                    let [after, before] = [moved, device].map(|d| d.dressed(window, &zero, |_, rest| rest));
                    out.iter_mut().zip(after.iter().zip(before)).for_each(|(o, (a, b))| *o += (a - b) / step);
                }
                out
            })
            .collect()
        };
        let i = Complex64::new(0.0, 1.0);
        if let Some(turn) = turn {
            return of_field(light.iter().zip(turn).map(|(v, w)| i * v * w).collect(), false);
        }
        match parameter {
            Parameter::Crosstalk(_) => {
                let image: Vec<Complex64> = settled.iter().map(|m| Complex64::new(*m, 0.0)).collect();
                let spread = moved.spread(&image);
                let turned = light.iter().zip(spread.iter().zip(phase)).map(|(v, (a, b))| i * v * ((a.re - b) / step));
                of_field(turned.collect(), false)
            }
            Parameter::Source(_) => {
                let rows = device.optics.height * device.subpixels;
                let factor = |at: usize| {
                    let (x, y) = (at / rows / device.subpixels, at % rows / device.subpixels);
                    let at = y * device.optics.width + x;
                    (moved.amplitude[at] / device.amplitude[at] - 1.0) / step
                };
                of_field(light.iter().enumerate().map(|(at, v)| v * factor(at)).collect(), true)
            }
            // The other parameters change the aperture and the zero order only.
            _ => raw
                .iter()
                .zip(&set.windows)
                .map(|(raw, window)| {
                    let (after, before) = (moved.behind(window, raw), device.behind(window, raw));
                    after.iter().zip(before).map(|(a, b)| (a - b) / step).collect()
                })
                .collect(),
        }
    }
}
