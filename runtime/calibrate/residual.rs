//! Measures the rest that a model leaves, picture by picture and place by place.

use super::classified::Sorted;
use super::error::CalibrateError;
use super::fit::Fit;
use serde::Serialize;

/// The rest of a picture.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct PictureLeft {
    /// The file of the picture.
    pub file: String,
    /// The kind of its pattern, `even`, `smooth`, `random`, or `set` (several sub-frames).
    pub kind: &'static str,
    /// The iris that was requested, x, y, diameter, mm.
    pub iris_mm: [f64; 3],
    /// `fitted`, `held out` (taken twice), or `left out` (it contradicts the others).
    pub role: &'static str,
    /// Share of its variance about its mean that is left, including the noise.
    pub left: f64,
    /// Mean of the squared rest, in units of the noise.
    pub squares: f64,
}

/// The rest by place in the camera's picture, over all pictures except the excluded ones.
#[derive(Debug, Clone, Serialize)]
pub struct ResidualMap {
    /// Camera pixels along a side of a tile.
    pub tile_px: usize,
    /// Number of rows of tiles.
    pub rows: usize,
    /// Number of columns of tiles.
    pub columns: usize,
    /// Mean of the squared rest in units of the noise, row by row, or none if a tile has too few pixels.
    pub squares: Vec<Option<f64>>,
}

/// A picture that was not fitted, with its prediction, on a part of the camera's pixels. Counts are 1 at full scale.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct HoldoutPicture {
    /// The file of the picture.
    pub file: String,
    /// Number of rows and columns.
    pub size: [usize; 2],
    /// Counts of the camera, row by row.
    pub picture: Vec<f32>,
    /// Counts that the model predicts, row by row.
    pub prediction: Vec<f32>,
    /// Absolute difference of both, row by row. It is 0 if a pixel does not look well inside the SLM's image.
    pub difference: Vec<f32>,
}

pub(super) const LEFT_OUT: &str = "left out";
/// Number of tiles along the longer side of the map.
const TILES: usize = 16;
/// The least number of pixels of a tile.
const FEWEST: usize = 20;
/// Largest number of pixels along the longer side of a `HoldoutPicture`.
const SHOWN: usize = 160;

/// The rest of each picture, and the rest by place.
pub(super) fn left(sorted: &Sorted, fit: &Fit, fitted: &[usize], subpixels: usize) -> (Vec<PictureLeft>, ResidualMap) {
    let pictures = &sorted.pictures;
    let held_out: Vec<usize> = sorted.pairs.iter().map(|p| p[0]).collect();
    let which: Vec<usize> = sorted.fitted.iter().chain(&sorted.strange).chain(&held_out).copied().collect();
    let seen = pictures.see(&fit.at, subpixels, &which, &[]);
    let [height, width] = sorted.camera;
    let tile_px = height.max(width).div_ceil(TILES);
    let (rows, columns) = (height.div_ceil(tile_px), width.div_ceil(tile_px));
    let mut tiles = vec![(0.0, 0usize); rows * columns];
    let mut all = Vec::new();
    let lefts = pictures.left(&which, &seen);
    for ((v, seen), [left, squares]) in which.iter().zip(&seen).zip(lefts) {
        let view = &pictures.views[*v];
        let residuals = pictures.residuals(*v, seen);
        let role = match (fitted.contains(v), !held_out.contains(v)) {
            (true, _) => "fitted",
            (false, false) => "held out",
            (false, true) => LEFT_OUT,
        };
        let counted = if role == LEFT_OUT { 0 } else { residuals.len() };
        for (([x, y], r), variance) in view.pixels().zip(residuals).zip(&view.variance).take(counted) {
            let tile = &mut tiles[y as usize / tile_px * columns + x as usize / tile_px];
            *tile = (tile.0 + r * r / variance, tile.1 + 1);
        }
        let p = view.pupil();
        let file = view.file_name();
        let iris_mm = [p.x, p.y, p.diameter].map(|v| v * 1e3);
        let kind = pictures.sets[view.set].pattern.kind();
        all.push(PictureLeft { file, kind, iris_mm, role, left, squares });
    }
    let squares = tiles.into_iter().map(|(sum, n)| (n >= FEWEST).then(|| sum / n as f64)).collect();
    (all, ResidualMap { tile_px, rows, columns, squares })
}

impl ResidualMap {
    /// The tile with the largest rest, by x and y of its middle in camera pixels, and its squares.
    pub(super) fn most(&self) -> Option<([usize; 2], f64)> {
        let known = self.squares.iter().enumerate().filter_map(|(i, s)| s.map(|s| (i, s)));
        let (i, squares) = known.max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(([i % self.columns, i / self.columns].map(|t| t * self.tile_px + self.tile_px / 2), squares))
    }
}

/// The pictures that were not fitted, each with its prediction.
pub(super) fn shown(sorted: &Sorted, fit: &Fit, subpixels: usize) -> Result<Vec<HoldoutPicture>, CalibrateError> {
    let [height, width] = sorted.camera;
    let step = height.max(width).div_ceil(SHOWN);
    let size = [height.div_ceil(step), width.div_ceil(step)];
    let pixel = |i: usize| [i % size[1] * step, i / size[1] * step];
    let places: Vec<[f64; 2]> = (0..size[0] * size[1]).map(|i| pixel(i).map(|v| v as f64)).collect();
    let one = |pair: &[usize; 2]| {
        let view = &sorted.pictures.views[pair[0]];
        let picture = view.picture(sorted.camera)?;
        let seen = sorted.pictures.see_places(&fit.at, subpixels, pair[0], &places);
        let at_pixels = sorted.pictures.see(&fit.at, subpixels, &pair[..1], &[]);
        let exposure = sorted.pictures.exposure(pair[0], &at_pixels[0]);
        let gain = exposure.gain * view.exposure_ms;
        let [rows, columns] = sorted.map.slm.map(|n| n as f64);
        let inside = |at: &[f64; 2], margin: f64| {
            let [x, y] = fit.at.map.to_slm(*at);
            (margin - 0.5..columns - 0.5 - margin).contains(&x) && (margin - 0.5..rows - 0.5 - margin).contains(&y)
        };
        let light = |(at, i): (&[f64; 2], f64)| (exposure.dark + if inside(at, 0.0) { gain * i } else { 0.0 }) as f32;
        let prediction: Vec<f32> = places.iter().zip(seen).map(light).collect();
        let picture: Vec<f32> = (0..places.len()).map(|i| picture.values[pixel(i)[1] * width + pixel(i)[0]]).collect();
        let apart = |(at, (a, b)): (&[f64; 2], (&f32, &f32))| if inside(at, 2.5) { (a - b).abs() } else { 0.0 };
        let difference = places.iter().zip(picture.iter().zip(&prediction)).map(apart).collect();
        Ok(HoldoutPicture { file: view.file_name(), size, picture, prediction, difference })
    };
    sorted.pairs.iter().map(one).collect()
}
