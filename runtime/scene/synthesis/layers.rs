//! Represents a light field by Fourier disparity layers (OPTICS 14).
//!
//! The layers are a few pictures at different depths. Any view is their sum, with each layer moved by its parallax.
//! Hidden and shiny content, which layers cannot explain, appears in each view as the other views predict it.

use crate::{LightField, SceneError, ViewGrid};
use eyebox_base::memory;
use eyebox_kernels::fft::{Columns, Direction, Plans};
use eyebox_kernels::layers::seen;
use eyebox_kernels::regression::{Defocus, Found, Regression};
use eyebox_kernels::scattered::Scattered;
use eyebox_kernels::{Complex32, Complex64, ZERO};
use eyebox_optics::{Display, fast_size};
use rayon::prelude::*;

/// Pixels of movement across the eyebox between neighboring layers. It may be up to twice this number to save layers.
const MAX_LAYER_STEP_PX: f64 = 0.7;
/// Smallest and largest usual number of layers, and the largest number ever.
const USUAL: [f64; 2] = [4.0, 24.0];
const MOST: f64 = 96.0;
/// Pixels across the eyebox by which the range exceeds the stated range, as a minimum and as a share of the range.
const BEYOND: [f64; 2] = [1.0, 0.05];
/// Expected noise, and the damping of layers that views cannot distinguish.
const RIDGE: f64 = 0.05;
const SMOOTH: f64 = 0.0005;
/// Expected noise of a focal stack, whose pictures are means over an aperture.
const STACK_RIDGE: f64 = 0.003;
/// A view is odd if its accuracy is this many dB below the median of similar views. It is odd alone if the next one is
/// better by `NEXT` dB. It has another exposure if a gain explains `GAINS` dB.
const OUTLIER_DB: f64 = 6.0;
const NEXT: f64 = 3.0;
const GAINS: f64 = 3.0;
/// Least number of pixels over which opposite edges fade into each other.
const FADE: usize = 8;

/// A light field in layers.
pub struct Layers {
    size: [usize; 2],
    /// Rows and columns of the grid into which pictures are mirrored.
    padded: [usize; 2],
    grid: ViewGrid,
    /// Pixels by which the content of each layer moves per meter of the pupil plane.
    slopes: Vec<f64>,
    /// The spectra of each color as (layer, row, column), with the columns of frequencies from 0 up.
    planes: Vec<Vec<Complex32>>,
    /// Sums over all colors for each view of view², view x prediction and prediction².
    products: Vec<[f64; 3]>,
    /// The brightest light of any view.
    brightest: f64,
}

/// A focal stack in front of a display.
pub(crate) struct Stack {
    /// The depth at which each picture is sharp, in meters.
    pub focus: Vec<f64>,
    /// The diameter of the aperture that saw the pictures, in meters.
    pub aperture: f64,
}

impl Layers {
    /// Fits layers to the colors of a light field for a display, over these depths (farthest, nearest) in meters.
    ///
    /// # Errors
    /// [`SceneError`] if they do not fit into memory.
    pub fn new(field: &LightField, display: &Display, depth: [f64; 2]) -> Result<Self, SceneError> {
        let grid = ViewGrid { rows: field.grid[0], columns: field.grid[1], cell: field.cell(display) };
        let mut layers = Self::over(field, grid, display.eyebox_min(), display, depth)?;
        layers.add(field, display.eyebox_min());
        Ok(layers)
    }

    /// Fits layers to views at `positions` (x, y) of the pupil plane in meters, around its middle, which span `span`.
    pub(crate) fn at_positions(
        field: &LightField,
        positions: &[[f64; 2]],
        span: f64,
        display: &Display,
        depth: [f64; 2],
    ) -> Result<Self, SceneError> {
        let span = span.max(display.eyebox_min());
        let grid = ViewGrid { rows: 1, columns: positions.len(), cell: span / positions.len().max(1) as f64 };
        let mut layers = Self::over(field, grid, span, display, depth)?;
        let slopes = &layers.slopes;
        let scattered = Scattered {
            places: positions.iter().map(|[x, y]| [*y, *x]).collect(),
            slope: slopes[0],
            step: slopes[1] - slopes[0],
            movement: slopes.iter().map(|s| s * span).collect(),
            ridge: RIDGE,
            smooth: SMOOTH,
        };
        layers.add_colors(field, |omega, views, found| scattered.solve(omega, views, found));
        Ok(layers)
    }

    /// Fits layers to the pictures of a focal stack, which `field` has as a row of views, over these depths in meters.
    pub(crate) fn of_stack(
        field: &LightField,
        stack: &Stack,
        display: &Display,
        depth: [f64; 2],
    ) -> Result<Self, SceneError> {
        let grid = ViewGrid { rows: field.grid[0], columns: field.grid[1], cell: stack.aperture };
        let mut layers = Self::over(field, grid, display.eyebox_min(), display, depth)?;
        let per_pixel = display.focal_length * display.picture_pixel();
        let slopes = &layers.slopes;
        let blurs = stack.focus.iter().flat_map(|z| {
            let sharp = z / per_pixel;
            slopes.iter().map(move |slope| (slope - sharp).abs() * stack.aperture)
        });
        let defocus = Defocus {
            blur: blurs.collect(),
            movement: slopes.iter().map(|slope| slope * stack.aperture).collect(),
            ridge: STACK_RIDGE,
            smooth: SMOOTH,
        };
        layers.add_colors(field, |omega, pictures, found| defocus.solve(omega, pictures, found));
        Ok(layers)
    }

    /// Prepares empty layers for pictures like the pictures of the field, for pupils within `eyebox`.
    fn over(
        field: &LightField,
        grid: ViewGrid,
        eyebox: f64,
        display: &Display,
        depth: [f64; 2],
    ) -> Result<Self, SceneError> {
        let most = field.height.max(field.width) as f64;
        let (per_pixel, cell) = (display.focal_length * display.picture_pixel(), grid.cell);
        let [low, high] = depth.map(|z| (z / per_pixel * cell).clamp(-most, most) / cell * eyebox);
        let beyond = (BEYOND[1] * (high - low)).max(BEYOND[0]);
        let (low, high) = (low - beyond, high + beyond);
        let usual = ((high - low) / MAX_LAYER_STEP_PX).ceil().clamp(USUAL[0], USUAL[1]);
        let count = usual.max((0.5 * (high - low) / MAX_LAYER_STEP_PX).ceil()).min(MOST);
        let slope = |k: usize| (low + (high - low) * k as f64 / count) / eyebox;
        let slopes: Vec<f64> = (0..=count as usize).map(slope).collect();
        let move_most = (0.5 * low.abs().max(high.abs())).ceil().min(most) as usize;
        let size = [field.height, field.width];
        let padded = size.map(|n| fast_size(n + (2 * move_most).max(FADE).min(n)));
        let views = grid.rows * grid.columns;
        let counts = [padded[0], padded[1] / 2 + 1, (slopes.len() + 2 * views) * 2];
        let what = || format!("{} layers of {} x {} pixels", slopes.len(), padded[0], padded[1]);
        memory::check_available(what, memory::bytes_of(&counts, 8), "take a smaller `size`, or `photographs` cells")?;
        let products = vec![[0.0; 3]; views];
        Ok(Self { size, padded, grid, slopes, planes: Vec::new(), products, brightest: 0.0 })
    }

    /// Adds the colors of the same light field that were loaded after the others.
    pub fn with(mut self, field: &LightField, display: &Display) -> Self {
        self.add(field, display.eyebox_min());
        self
    }

    /// Returns the number of layers.
    pub fn count(&self) -> usize {
        self.slopes.len()
    }

    /// Returns the bytes in memory.
    pub fn bytes(&self) -> u64 {
        8 * self.planes.iter().map(Vec::len).sum::<usize>() as u64
    }

    /// Returns the accuracy with which the others predict each view, row by row, in dB of the brightest light.
    pub fn residual(&self) -> Vec<f64> {
        self.products.iter().map(|[own, both, told]| self.db(own - 2.0 * both + told)).collect()
    }

    fn db(&self, error: f64) -> f64 {
        decibels(error, self.size[0] * self.size[1] * self.planes.len().max(1), self.brightest)
    }

    /// Returns the error for one or two views that do not fit the others, with the likely cause.
    pub(crate) fn odd_views(&self, scene: &str) -> Option<SceneError> {
        let all = self.residual();
        // Views at the border or at a corner have fewer neighbors, so they are compared among themselves.
        let sides = |v: usize| {
            let outer = |i: usize, n: usize| usize::from(i == 0 || i + 1 == n);
            outer(v / self.grid.columns, self.grid.rows) + outer(v % self.grid.columns, self.grid.columns)
        };
        let middle = |v: usize| {
            let alike = |w: &usize| sides(*w) == sides(v);
            let mut of: Vec<f64> = (0..all.len()).filter(alike).map(|w| all[w]).collect();
            of.sort_by(f64::total_cmp);
            if of.len() < 3 { f64::NEG_INFINITY } else { of[of.len() / 2] }
        };
        let short: Vec<f64> = (0..all.len()).map(|v| middle(v) - all[v]).collect();
        let mut odd: Vec<usize> = (0..all.len()).filter(|v| short[*v] > OUTLIER_DB).collect();
        odd.sort_by(|a, b| short[*b].total_cmp(&short[*a]));
        let others = middle(*odd.first()?);
        // With few views, one odd view makes its neighbors odd.
        let alone = odd.len() > 1 && short[odd[0]] > short[odd[1]] + NEXT;
        let odd = if alone { &odd[..1] } else { &odd[..] };
        let [own, both, told] = self.products[odd[0]];
        let gain = both / told.max(f64::MIN_POSITIVE);
        let place = |v: &usize| format!("row {}, column {}", v / self.grid.columns + 1, v % self.grid.columns + 1);
        let (views, cause) = match odd {
            [one] if self.db(own - gain * both) > all[*one] + GAINS => {
                let cause = format!("it is {gain:.2} times as bright, which suggests another exposure");
                (format!("the view of {} is", place(one)), cause)
            }
            [one] => (format!("the view of {} is", place(one)), "it is moved, or shows something else".into()),
            [a, b] => (format!("the views of {} and {} are", place(a), place(b)), "they seem exchanged".into()),
            _ => return None,
        };
        Some(SceneError::OddViews { scene: scene.into(), views, found: all[odd[0]], others, cause })
    }

    /// Returns the mean over the views that have neighbors on all sides, which is the error of views in between. It is
    /// the mean over all views if no view has such neighbors.
    pub fn residual_between(&self) -> f64 {
        let inner = |i: usize, n: usize| n < 3 || (i > 0 && i + 1 < n);
        let all = self.residual();
        let middle = all.iter().enumerate().filter(|(v, _)| {
            inner(v / self.grid.columns, self.grid.rows) && inner(v % self.grid.columns, self.grid.columns)
        });
        let (sum, count) = middle.fold((0.0, 0.0), |(s, n), (_, db)| (s + 10f64.powf(-db / 10.0), n + 1.0));
        -10.0 * (sum / f64::max(count, 1.0)).log10()
    }

    /// Returns the pixels by which content at an end of the depths moves over `metres` meters of the pupil plane.
    pub fn parallax(&self, metres: f64) -> f64 {
        metres * self.slopes.iter().fold(0.0, |most: f64, s| most.max(s.abs()))
    }

    /// Returns views of color `color` from these places (x, y) of the pupil plane in meters.
    pub fn views(&self, color: usize, places: &[(f64, f64)]) -> Vec<Vec<f32>> {
        let plans = Plans::default();
        let [height, width] = self.padded;
        let one = |&(x, y): &(f64, f64)| {
            let moved = |slope: &f64| [slope * y / height as f64, slope * x / width as f64];
            let moves: Vec<[f64; 2]> = self.slopes.iter().map(moved).collect();
            let mut frame = vec![ZERO; height * width];
            seen(&self.planes[color], &moves, height, &mut frame);
            self.image(&plans, frame).into_iter().map(|v| v.max(0.0)).collect()
        };
        places.par_iter().map(one).collect()
    }

    fn half(&self) -> usize {
        self.padded[1] / 2 + 1
    }

    fn add(&mut self, field: &LightField, eyebox: f64) {
        let scale = self.grid.cell;
        let regression = Regression {
            grid: field.grid,
            disparity: self.slopes[0] * scale,
            step: (self.slopes[1] - self.slopes[0]) * scale,
            movement: self.slopes.iter().map(|s| s * eyebox).collect(),
            ridge: RIDGE,
            smooth: SMOOTH,
        };
        self.add_colors(field, |omega, views, found| regression.solve(omega, views, found));
    }

    /// Adds the colors of a field. `at` finds the layers at a frequency.
    fn add_colors(&mut self, field: &LightField, at: impl Fn([f64; 2], &[Complex64], &mut Found) + Sync) {
        for views in &field.planes {
            let brightest = views.par_iter().flatten().copied().reduce(|| 0.0, f32::max);
            self.brightest = self.brightest.max(f64::from(brightest));
            let layers = self.solve(&at, views);
            self.planes.push(layers);
        }
    }

    /// Returns the layers of one color, and adds to the products of the views.
    fn solve(
        &mut self,
        at: &(impl Fn([f64; 2], &[Complex64], &mut Found) + Sync),
        views: &[Vec<f32>],
    ) -> Vec<Complex32> {
        let plans = Plans::default();
        let ([height, width], half) = (self.padded, self.half());
        let spectrum = |view: &Vec<f32>| {
            let mut frame = mirrored(view, self.size, self.padded);
            let used = Columns { first: 0, count: half };
            plans.fft(&mut frame, height, width, Direction::Forward, used, |_| {});
            frame.chunks_exact(width).flat_map(|row| &row[..half]).copied().collect()
        };
        let spectra: Vec<Vec<Complex32>> = views.par_iter().map(spectrum).collect();
        let (count, n) = (self.slopes.len(), views.len());
        let row = |y: usize| {
            let mut layers = vec![ZERO; count * half];
            let mut errors = vec![ZERO; n * half];
            let (mut found, mut seen) = (Found::default(), vec![Complex64::ZERO; n]);
            let signed = |k: usize, size: usize| if 2 * k < size { k as f64 } else { k as f64 - size as f64 };
            let narrow = |v: &Complex64| Complex32::new(v.re as f32, v.im as f32);
            for x in (0..half).filter(|x| 2 * x != width && 2 * y != height) {
                for (seen, view) in seen.iter_mut().zip(&spectra) {
                    let v = view[y * half + x];
                    *seen = Complex64::new(f64::from(v.re), f64::from(v.im));
                }
                at([signed(y, height) / height as f64, x as f64 / width as f64], &seen, &mut found);
                found.layers.iter().enumerate().for_each(|(k, v)| layers[k * half + x] = narrow(v));
                found.left_out.iter().enumerate().for_each(|(v, e)| errors[v * half + x] = narrow(e));
            }
            (layers, errors)
        };
        let rows: Vec<_> = (0..height).into_par_iter().map(row).collect();
        drop(spectra);
        let mut layers = Vec::with_capacity(count * height * half);
        for k in 0..count {
            rows.iter().for_each(|(row, _)| layers.extend_from_slice(&row[k * half..][..half]));
        }
        let unit = 1.0 / (height * width) as f32;
        let error = |v: usize| {
            let mut frame = vec![ZERO; height * width];
            for (out, (_, row)) in frame.chunks_exact_mut(width).zip(&rows) {
                for (x, e) in row[v * half..][..half].iter().enumerate() {
                    out[x] = e * unit * if x == 0 { 1.0 } else { 2.0 };
                }
            }
            let error = self.image(&plans, frame);
            let one = |sum: [f64; 3], (view, error): (&f32, &f32)| {
                let (own, told) = (f64::from(*view), f64::from(view - error));
                [sum[0] + own * own, sum[1] + own * told, sum[2] + told * told]
            };
            views[v].iter().zip(&error).fold([0.0; 3], one)
        };
        let all: Vec<[f64; 3]> = (0..n).into_par_iter().map(error).collect();
        self.products.iter_mut().zip(all).for_each(|(sum, one)| (0..3).for_each(|i| sum[i] += one[i]));
        layers
    }

    /// Returns the picture of half a spectrum, whose columns are doubled except for the first one.
    fn image(&self, plans: &Plans, mut frame: Vec<Complex32>) -> Vec<f32> {
        let ([height, width], used) = (self.padded, Columns { first: 0, count: self.half() });
        plans.fft(&mut frame, height, width, Direction::Inverse, used, |_| {});
        let rows = frame.chunks_exact(width).take(self.size[0]);
        rows.flat_map(|row| &row[..self.size[1]]).map(|v| v.re).collect()
    }
}

/// Converts squared errors over `pixels` pixels to dB of the brightest light.
pub(crate) fn decibels(error: f64, pixels: usize, brightest: f64) -> f64 {
    -10.0 * (error / pixels as f64 / brightest.powi(2)).max(1e-12).log10()
}

/// Places a picture in the corner of a larger periodic one. Beyond its edges it continues as in a mirror, and one side
/// fades into the other.
fn mirrored(view: &[f32], [height, width]: [usize; 2], [high, wide]: [usize; 2]) -> Vec<Complex32> {
    // Each place of the larger picture mixes two source places, with the share of the first one.
    let axis = |n: usize, all: usize| -> Vec<(usize, usize, f32)> {
        let place = |i: usize| {
            if i < n {
                return (i, i, 1.0);
            }
            let t = ((i - n) as f32 + 0.5) / (all - n) as f32;
            let share = 0.5 + 0.5 * (std::f32::consts::PI * t).cos();
            ((2 * n - 1).saturating_sub(i), (all - 1 - i).min(n - 1), share)
        };
        (0..all).map(place).collect()
    };
    let columns = axis(width, wide);
    let mut frame = vec![ZERO; high * wide];
    for (out, (a, b, share)) in frame.chunks_exact_mut(wide).zip(axis(height, high)) {
        let at = |x: usize| share * view[a * width + x] + (1.0 - share) * view[b * width + x];
        for (out, (left, right, share)) in out.iter_mut().zip(&columns) {
            out.re = share * at(*left) + (1.0 - share) * at(*right);
        }
    }
    frame
}
