//! Computes the terms of a [`DisplayModel`] per pixel, sub-frame and frequency, in float64 (OPTICS 10).

use super::model::{DisplayModel, Iris, Spread};
use super::{Pupil, zernike};
use eyebox_kernels::{Complex64, fft};
use std::f64::consts::{PI, TAU};

/// Place of a pixel from -1 to 1 over an SLM of `count` pixels along an axis.
fn place(pixel: usize, count: usize) -> f64 {
    (2 * pixel + 1) as f64 / count as f64 - 1.0
}

/// `value(x, y)` at each pixel of a part of an SLM, row-major. x and y run from -1 to 1 over the whole SLM.
fn per_pixel<T>(part: SlmPart, value: impl Fn(f64, f64) -> T) -> Vec<T> {
    let SlmPart { slm: [height, width], first: [row, column], size: [rows, columns] } = part;
    let at = |i: usize| value(place(column + i % columns, width), place(row + i / columns, height));
    (0..rows * columns).map(at).collect()
}

/// A rectangle of an SLM's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlmPart {
    /// Rows and columns of the whole SLM.
    pub slm: [usize; 2],
    /// First row and column of the part.
    pub first: [usize; 2],
    /// Rows and columns of the part.
    pub size: [usize; 2],
}

impl From<[usize; 2]> for SlmPart {
    /// All rows and columns of an SLM.
    fn from(slm: [usize; 2]) -> Self {
        Self { slm, first: [0; 2], size: slm }
    }
}

/// The most places along an axis over which the source's light is summed. Between that many places it is linear to a
/// float32.
const PLACES: usize = 2048;

/// The function `sin(pi x) / (pi x)`, continued at 0.
fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

impl DisplayModel {
    /// Phase at full drive in units of 2 pi, of each pixel of an SLM or of a part of it, as (rows, columns).
    pub fn level_map(&self, part: impl Into<SlmPart>) -> Vec<f64> {
        per_pixel(part.into(), |x, y| self.level_at(x, y))
    }

    /// The phase at full drive at (x, y), from -1 to 1 over the SLM.
    fn level_at(&self, x: f64, y: f64) -> f64 {
        let hat = |at: f64| [-1.0, 0.0, 1.0].map(|node: f64| (1.0 - (at - node).abs()).max(0.0));
        let (along_y, along_x) = (hat(y), hat(x));
        let row = |nodes: &[f64; 3]| nodes.iter().zip(along_x).map(|(node, share)| node * share).sum::<f64>();
        self.level.iter().zip(along_y).map(|(nodes, share)| row(nodes) * share).sum()
    }

    /// The properties of one pixel of an SLM of `height` x `width`. They are the level of its look-up table, the
    /// source's amplitude that it modulates, and the real and imaginary part of the light that it does not modulate.
    /// `root` is [`source_root`](Self::source_root) of that SLM. Rows and columns beyond the edges wrap around and are
    /// dark, because crosstalk reaches them but a pupil does not.
    pub fn pixel(&self, [row, column]: [i64; 2], [height, width]: [usize; 2], root: f64) -> [f64; 4] {
        let inside = |i: i64, n: usize| (0..n as i64).contains(&i);
        let at = |i: i64, n: usize| place(i.rem_euclid(n as i64) as usize, n);
        let (x, y) = (at(column, width), at(row, height));
        let level = self.level_at(x, y);
        if !inside(row, height) || !inside(column, width) {
            return [level, 0.0, 0.0, 0.0];
        }
        let amplitude = self.source_at(x, y) / root;
        let rest = self.undiffracted_at(x, y);
        [level, amplitude * self.modulated_share(), rest.re * amplitude, rest.im * amplitude]
    }

    /// Phase w' in radians for a drive of `w` radians in 0 .. 2 pi at the level `level`, and its slope dw'/dw.
    pub fn look_up(&self, w: f64, level: f64) -> (f64, f64) {
        let ([b1, b2], (sin, cos)) = (self.bend, w.sin_cos());
        (level * w + b1 * sin + b2 * (1.0 - cos), level + b1 * cos + b2 * sin)
    }

    /// The drive from 0 to 2 pi that gives a phase at the level `level`, the inverse of [`look_up`](Self::look_up). For
    /// a phase beyond full drive it is the end of the range that is nearer around the turn.
    pub fn drive_of(&self, phase: f64, level: f64) -> f64 {
        let (phase, full) = (phase.rem_euclid(TAU), level * TAU);
        if level == 1.0 && self.bend == [0.0; 2] {
            return phase;
        }
        if phase > full {
            return if TAU - phase < phase - full { 0.0 } else { TAU };
        }
        // The table rises, so a bisection finds the drive, to a ten-millionth of a turn.
        let (mut low, mut high) = (0.0, TAU);
        for _ in 0..24 {
            let middle = (low + high) / 2.0;
            let below = self.look_up(middle, level).0 < phase;
            *(if below { &mut low } else { &mut high }) = middle;
        }
        (low + high) / 2.0
    }

    /// Shares of the sub-frames `k` before in the visible light of one, for k = 0 .. frames. They are the steady state
    /// of a repeated set of `frames` sub-frames.
    pub fn lag_shares(&self, frames: usize) -> Vec<f64> {
        let h = self.lag;
        (0..frames as i32).map(|k| (1.0 - h) * h.powi(k) / (1.0 - h.powi(frames as i32))).collect()
    }

    /// The crosstalk kernels along y and x of a grid of `height` x `width` pixels, with `subpixels` each along an axis.
    /// They have `height * subpixels` and `width * subpixels` values, in the order of the DFT. Sub-pixel 0 comes first,
    /// then those towards +, and those towards - last. Each sum is 1. The result is none without crosstalk.
    pub fn crosstalk_kernels(&self, height: usize, width: usize, subpixels: usize) -> Option<[Vec<f64>; 2]> {
        let [up, down, left, right] = self.crosstalk?;
        Some([kernel(height, subpixels, up, down), kernel(width, subpixels, left, right)])
    }

    /// Weights of crosstalk along y and x of an SLM in a grid of `height` x `width` pixels, with their reach in pixels
    /// to either side. Each of a pixel's `subpixels` has weights from the pixel `reach` before its own to the pixel
    /// `reach` after it, with the sum 1.
    ///
    /// The weights are cut if the rest changes the field by less than `error`, as its power over the power of the
    /// field. The drives count as evenly random. The result is none without crosstalk.
    pub fn crosstalk_weights(&self, height: usize, width: usize, subpixels: usize, error: f64) -> Option<[Weights; 2]> {
        let kernels = self.crosstalk_kernels(height, width, subpixels)?;
        // The variance of a drive, with half of the error for each axis.
        let most = error / (2.0 * TAU * TAU / 12.0);
        Some(kernels.map(|kernel| Weights::new(&kernel, subpixels, most)))
    }

    /// Share of the variance of random drives that remains after crosstalk on an SLM of `height` x `width` pixels. It
    /// is the sum of the squares of its kernel, or 1 without crosstalk.
    pub fn variance_left(&self, height: usize, width: usize) -> f64 {
        let squares = |kernel: &Vec<f64>| kernel.iter().map(|v| v * v).sum::<f64>();
        self.crosstalk_kernels(height, width, 1).map_or(1.0, |axes| axes.iter().map(squares).product())
    }

    /// Factors along one axis of bin `k` of `count`, k from 0 to count. They account for the place of each sub-pixel in
    /// its pixel. They multiply the spectrum of the sub-pixel's field in the spectrum of the whole field. The factor of
    /// the aperture is separate.
    pub fn subpixel_factors(&self, count: usize, subpixels: usize) -> Vec<Complex64> {
        let p = subpixels as f64;
        let factor = |i: usize| {
            let (a, k) = ((i / count) as f64, super::frequency_bin((i % count) as i64, count) as f64 / count as f64);
            let done = if k == 0.0 { p } else { (PI * k).sin() / (PI * k / p).sin() };
            Complex64::from_polar(1.0 / done, -2.0 * PI * k * (a - (p - 1.0) / 2.0) / p)
        };
        (0..count * subpixels).map(factor).collect()
    }

    /// Amplitude of the source at each pixel, (height, width). Its mean square is 1.
    pub fn source_amplitude(&self, part: impl Into<SlmPart>) -> Vec<f64> {
        let part = part.into();
        let root = self.source_root(part.slm);
        per_pixel(part, |x, y| self.source_at(x, y) / root)
    }

    /// The amplitude of the source before its mean square is made 1.
    pub fn source_at(&self, x: f64, y: f64) -> f64 {
        let [cx, cy, cxx, cxy, cyy] = self.source;
        (cx * x + cy * y + cxx * x * x + cxy * x * y + cyy * y * y).exp()
    }

    /// The root of the source's mean square over the pixels of an SLM of `height` x `width`. For very many pixels it
    /// uses fewer places that are as even.
    pub fn source_root(&self, [height, width]: [usize; 2]) -> f64 {
        if self.source == [0.0; 5] {
            return 1.0;
        }
        let all = per_pixel([height.min(PLACES), width.min(PLACES)].into(), |x, y| self.source_at(x, y).powi(2));
        (all.iter().sum::<f64>() / all.len() as f64).sqrt()
    }

    /// `sum |eta|^2`, the share of the light that the pixels do not modulate.
    pub fn undiffracted_light(&self) -> f64 {
        self.undiffracted.iter().map(|[re, im, ..]| re * re + im * im).sum()
    }

    /// `sqrt(1 - sum |eta|^2)`, the part of the source's amplitude that the pixels modulate.
    pub fn modulated_share(&self) -> f64 {
        (1.0 - self.undiffracted_light()).max(0.0).sqrt()
    }

    /// `sum eta exp(i psi)` at each pixel, (height, width), the part of the source's amplitude that the pixels do not
    /// modulate.
    pub fn undiffracted_share(&self, part: impl Into<SlmPart>) -> Vec<Complex64> {
        per_pixel(part.into(), |x, y| self.undiffracted_at(x, y))
    }

    fn undiffracted_at(&self, x: f64, y: f64) -> Complex64 {
        let wave = |[re, im, px, py, pr]: &[f64; 5]| {
            Complex64::new(*re, *im) * Complex64::cis(px * x + py * y + pr * (x * x + y * y))
        };
        self.undiffracted.iter().map(wave).sum()
    }

    /// Factor of a pixel's aperture along one axis, at `k` cycles per pixel (-0.5 to 0.5), on a field of `subpixels`
    /// values per pixel. It is `sinc(b k) / d_P(k) exp(i pi k (P - 1) / P)`. The factors of both axes multiply.
    ///
    /// If the fill is 0, pixels are points and the sinc is 1.
    pub fn pixel_aperture(&self, k: f64, subpixels: usize) -> Complex64 {
        let p = subpixels as f64;
        let done = if k == 0.0 { 1.0 } else { (PI * k).sin() / (p * (PI * k / p).sin()) };
        Complex64::from_polar(self.pixel_sinc(k) / done, PI * k * (p - 1.0) / p)
    }

    /// The same factor for one value per pixel, which is real.
    pub fn pixel_sinc(&self, k: f64) -> f64 {
        sinc(self.fill * k)
    }

    /// Share of the light through `pupil` that the pixels' aperture passes, relative to points, on an SLM with eyeboxes
    /// of `eyebox` meters.
    pub fn aperture_light(&self, pupil: &Pupil, eyebox: f64) -> f64 {
        if self.fill == 0.0 {
            return 1.0;
        }
        // Light falls off so smoothly that four points are enough, each at the disc's root mean square along both axes.
        let along = |center: f64| {
            let at = |side: f64| self.pixel_sinc((center + side * pupil.diameter / 4.0) / eyebox).powi(2);
            (at(-1.0) + at(1.0)) / 2.0
        };
        along(pupil.x) * along(pupil.y)
    }

    /// The relay's wavefront at (x, y) meters of the pupil plane, in turns of the model's wavelength. `radius` is half
    /// the eyebox of the display's shortest wavelength in meters.
    pub fn wavefront_turns(&self, x: f64, y: f64, radius: f64) -> f64 {
        self.wavefront.iter().map(|(&j, waves)| waves * zernike(j, x / radius, y / radius)).sum()
    }

    /// The actual iris for the requested `pupil`. All code uses it, also for the share of the eyebox.
    pub fn true_pupil(&self, pupil: &Pupil) -> Pupil {
        let iris = self.iris;
        Pupil {
            x: pupil.x * iris.scale + iris.x,
            y: pupil.y * iris.scale + iris.y,
            diameter: pupil.diameter * iris.scale,
            depth: pupil.depth,
        }
    }

    /// The request for which the actual iris is `iris`, the inverse of [`true_pupil`](Self::true_pupil).
    pub fn asked_pupil(&self, iris: &Pupil) -> Pupil {
        let Iris { x, y, scale } = self.iris;
        Pupil { x: (iris.x - x) / scale, y: (iris.y - y) / scale, diameter: iris.diameter / scale, depth: iris.depth }
    }
}

/// The weights of each sub-pixel for the pixels around it along an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Number of pixels to either side.
    pub reach: usize,
    /// Weights with the shape (sub-pixels, 2 reach + 1).
    pub values: Vec<f64>,
}

impl Weights {
    /// Makes weights from a kernel on sub-pixels in the order of the DFT. The reach is the smallest for which the error
    /// of the phase is below `most` of the drives' variance. The remainder is spread evenly over the weights.
    fn new(kernel: &[f64], subpixels: usize, most: f64) -> Self {
        let pixels = kernel.len() / subpixels;
        // Sub-pixel a of a pixel is at P d + a - c from sub-pixel c of the pixel d before it.
        let of = |a: usize, d: i64| {
            let at = |c: usize| (d * subpixels as i64 + a as i64 - c as i64).rem_euclid(kernel.len() as i64) as usize;
            (0..subpixels).map(|c| kernel[at(c)]).sum::<f64>()
        };
        let (mut reach, mut squares) = (pixels / 2, 0.0);
        let mut sums = vec![0.0; subpixels];
        while reach > 0 {
            for (a, sum) in sums.iter_mut().enumerate() {
                let both = [reach as i64, -(reach as i64)].map(|d| of(a, d));
                squares += both[0] * both[0] + both[1] * both[1];
                *sum += both[0] + both[1];
            }
            let shared: f64 = sums.iter().map(|sum| sum * sum).sum::<f64>() / (2 * reach - 1) as f64;
            if squares + shared > most * subpixels as f64 {
                break;
            }
            reach -= 1;
        }
        let mut values = Vec::with_capacity(subpixels * (2 * reach + 1));
        for a in 0..subpixels {
            // Half a turn of an even number of pixels is one place, not two.
            let twice = |d: i64| 2 * d == pixels as i64;
            let line = (-(reach as i64)..=reach as i64).rev().map(|d| if twice(d) { 0.0 } else { of(a, d) });
            let line: Vec<f64> = line.collect();
            let left = (1.0 - line.iter().sum::<f64>()) / line.len() as f64;
            values.extend(line.into_iter().map(|v| v + left));
        }
        Self { reach, values }
    }
}

/// The kernel along one axis. The transfer of each half axis is averaged over a sub-pixel twice, once over the driving
/// one and once over the driven one.
fn kernel(pixels: usize, subpixels: usize, below: Spread, above: Spread) -> Vec<f64> {
    let (count, p) = (pixels * subpixels, subpixels as f64);
    let side = |spread: Spread| {
        // Beyond this many cycles per pixel nothing is left in float64. The limit is 100 orders.
        let reach = spread.sigma * 40f64.powf(1.0 / spread.q);
        let orders = (reach / p).ceil().min(100.0) as i64 + 1;
        let transfer = |i: usize| {
            let k = super::frequency_bin(i as i64, count) as f64 * p / count as f64;
            let order = |l: i64| {
                let l = l as f64;
                sinc(k / p + l).powi(2) * (-((k + l * p).abs() / spread.sigma).powf(spread.q)).exp()
            };
            (-orders..=orders).map(order).sum::<f64>()
        };
        let mut line: Vec<Complex64> = (0..count).map(|i| Complex64::new(transfer(i), 0.0)).collect();
        fft::transform_f64(&mut line, count, fft::Direction::Inverse);
        line.into_iter().map(|z| z.re / count as f64).collect::<Vec<f64>>()
    };
    let (below, above) = (side(below), side(above));
    let mut kernel: Vec<f64> = (0..count)
        .map(|i| match super::frequency_bin(i as i64, count) {
            0 => (below[i] + above[i]) / 2.0,
            n if n < 0 => below[i],
            _ => above[i],
        })
        .collect();
    let sum: f64 = kernel.iter().sum();
    kernel.iter_mut().for_each(|v| *v /= sum);
    kernel
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(got: &[f64], want: &[f64]) {
        for (i, (got, want)) in got.iter().zip(want).enumerate() {
            assert!((got - want).abs() < 1e-11, "{i}: {got}, not {want}");
        }
    }

    fn spectrum(kernel: &[f64]) -> Vec<Complex64> {
        let mut line: Vec<Complex64> = kernel.iter().map(|v| Complex64::new(*v, 0.0)).collect();
        let count = line.len();
        fft::transform_f64(&mut line, count, fft::Direction::Forward);
        line
    }

    /// The light that the aperture passes through a disc, against the mean over its points.
    #[test]
    fn an_aperture_leaves_less_light_to_the_edge_of_the_eyebox() {
        let (eyebox, model) = (26e-3, DisplayModel { fill: 0.94, ..DisplayModel::default() });
        for [x, y, diameter] in [[0.0, 0.0, 20.0], [9.0, -4.0, 6.0], [-11.0, 10.0, 3.0]] {
            let pupil = Pupil::from_mm([x, y, diameter, 0.0]);
            let light = |[u, v]: [f64; 2]| {
                let at = [pupil.x + u, pupil.y + v].map(|at| model.pixel_sinc(at / eyebox).powi(2));
                at[0] * at[1]
            };
            let steps = (-100..=100).map(|i| pupil.diameter / 2.0 * f64::from(i) / 100.0);
            let points = steps.clone().flat_map(|v| steps.clone().map(move |u| [u, v]));
            let inside: Vec<f64> = points.filter(|[u, v]| u.hypot(*v) <= pupil.diameter / 2.0).map(light).collect();
            let wanted = inside.iter().sum::<f64>() / inside.len() as f64;
            let found = model.aperture_light(&pupil, eyebox);
            assert!((found / wanted - 1.0).abs() < 0.01, "{pupil:?}: {found}, not {wanted}");
        }
        assert_eq!(DisplayModel::default().aperture_light(&Pupil::from_mm([9.0, 9.0, 4.0, 0.0]), eyebox), 1.0);
    }

    /// Values of the same definitions in float64 NumPy.
    #[test]
    fn tables_are_those_of_the_equations() {
        let model = DisplayModel {
            fill: 0.9,
            level: [[0.9, 1.0, 1.1], [1.0, 1.05, 0.95], [1.2, 1.0, 0.8]],
            source: [0.1, -0.2, -0.3, 0.05, -0.4],
            undiffracted: vec![[0.15, 0.1, 0.2, -0.1, 0.3], [-0.05, 0.02, -3.0, 1.0, 0.5]],
            ..DisplayModel::default()
        };
        near(&model.level_map([5, 6])[..7], &[0.935, 0.965, 0.995, 1.02, 1.04, 1.06, 0.9716666666666667]);
        let source = model.source_amplitude([5, 6]);
        assert!((source.iter().map(|a| a * a).sum::<f64>() / 30.0 - 1.0).abs() < 1e-12);
        let modulated: Vec<f64> = source.iter().map(|a| a * model.modulated_share()).collect();
        near(&modulated[..3], &[0.8366805267601275, 0.9753297729739018, 1.0636294087342775]);
        let rest = model.undiffracted_share([5, 6])[1] * source[1];
        near(&[rest.re, rest.im], &[0.08156187261724136, 0.09569661053376309]);
        // This is bin 1 of 5 rows and bin 2 of 6 columns on 2 x 2 sub-pixels, then bin 2 of 5 and bin 1 of 6 on one.
        let two = model.pixel_aperture(0.2, 2) * model.pixel_aperture(2.0 / 6.0, 2);
        near(&[two.re, two.im], &[0.6607885435787886, 0.733880026154358]);
        let one = model.pixel_aperture(0.4, 1) * model.pixel_aperture(1.0 / 6.0, 1);
        near(&[one.re, one.im], &[0.7707594111456598, 0.0]);
    }

    #[test]
    fn crosstalk_is_that_of_the_equations() {
        let (below, above) = (Spread { q: 1.2, sigma: 2.03 }, Spread { q: 1.5, sigma: 1.1 });
        let model = DisplayModel { crosstalk: Some([below, above, above, below]), ..DisplayModel::default() };
        let wants = [
            (1, [(1.0, 0.0), (0.919836722693, -0.021899046268), (0.785212540083, -0.029220763912)]),
            (2, [(1.0, 0.0), (0.943117413764, -0.024187958426), (0.845198467386, -0.044617145204)]),
            (3, [(1.0, 0.0), (0.950255429476, -0.024477785881), (0.868446440102, -0.046927849835)]),
        ];
        for (subpixels, want) in wants {
            let [along_y, along_x] = model.crosstalk_kernels(7, 7, subpixels).unwrap();
            for (got, (re, im)) in spectrum(&along_y).iter().zip(want) {
                near(&[got.re, got.im], &[re, im]);
            }
            // The sides are exchanged along x. If the number is even, the last value belongs to the side below.
            if subpixels != 2 {
                near(&along_x[1..], &along_y[1..].iter().rev().copied().collect::<Vec<_>>());
            }
        }
        assert_eq!(DisplayModel::default().crosstalk_kernels(7, 7, 1), None);
    }

    #[test]
    fn the_table_has_its_slope_and_lag_keeps_the_light() {
        let model = DisplayModel { bend: [0.1, -0.05], lag: 0.2, ..DisplayModel::default() };
        for w in [0.1, 2.0, 5.5] {
            let numeric = (model.look_up(w + 1e-6, 1.1).0 - model.look_up(w - 1e-6, 1.1).0) / 2e-6;
            assert!((model.look_up(w, 1.1).1 - numeric).abs() < 1e-8);
        }
        for level in [0.9, 1.0, 1.1] {
            for drive in [0.1, 2.0, 5.5] {
                assert!((model.drive_of(model.look_up(drive, level).0, level) - drive).abs() < 1e-6, "{drive}");
            }
        }
        // Beyond the reach of full drive, the result is the nearer end.
        assert_eq!((model.drive_of(5.7, 0.9), model.drive_of(6.2, 0.9)), (TAU, 0.0));
        let shares = model.lag_shares(8);
        assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-14 && (shares[1] / shares[0] - 0.2).abs() < 1e-14);
        assert_eq!(DisplayModel::default().lag_shares(3), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn the_relay_is_where_and_what_it_says() {
        let model = DisplayModel {
            wavefront: [(4, 0.5), (7, -0.25)].into(),
            iris: Iris { x: 1e-3, y: -2e-3, scale: 1.1 },
            ..DisplayModel::default()
        };
        let turns = model.wavefront_turns(3.3e-3, -7.7e-3, 11e-3);
        assert!((turns - 0.5 * 0.2771281292110202 + 0.25 * 0.5147737367038071).abs() < 1e-12);
        let mm = model.true_pupil(&Pupil::from_mm([2.0, 3.0, 4.0, 5.0])).to_mm();
        near(&mm, &[3.2, 1.3, 4.4, 5.0]);
        near(&model.asked_pupil(&Pupil::from_mm(mm)).to_mm(), &[2.0, 3.0, 4.0, 5.0]);
    }
}
