//! Light fields in one array: `.npy` and `.npz`, (rows of views, columns of views, rows of pixels, columns of pixels, colours).

use super::light::{Transfer, table};
use super::options::Options;
use super::settings::{self, Settings};
use super::views::{self, Frame, Read};
use super::{Request, SceneError, srgb_to_linear};
use crate::files::{FileError, NpyArray};
use crate::optics::Color;
use rayon::prelude::*;
use std::path::Path;

/// Views along an axis, and pixels of a view, at most.
const MOST_VIEWS: usize = 64;
const MOST_PIXELS: usize = 1 << 25;
/// Light in floats beyond this is no light of which 1 is full scale.
const BRIGHT: f32 = 64.0;

/// What the axes of an array are.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Layout {
    grid: [usize; 2],
    size: [usize; 2],
    channels: usize,
}

impl Layout {
    /// Of an array of this shape; `grid` is that of its views, where it is stated, and `file` it.
    ///
    /// # Errors
    /// In words, with what would be right.
    fn of(shape: &[usize], grid: Option<[usize; 2]>, file: &Path) -> Result<Self, String> {
        let of_colors = |n: usize| matches!(n, 1 | 3 | 4);
        let fills = |n: usize| grid.is_some_and(|[rows, columns]| rows * columns == n);
        let (found, size, channels) = match *shape {
            [rows, columns, height, width, c] if of_colors(c) => ([rows, columns], [height, width], c),
            [_, _, c, _, _] if of_colors(c) => {
                return Err(format!("has the shape {shape:?}: colours come last, as by numpy.moveaxis(views, 2, -1)"));
            }
            // Views one after the other.
            [n, height, width, c] if of_colors(c) && fills(n) => (grid.unwrap_or_default(), [height, width], c),
            [n, height, width] if fills(n) => (grid.unwrap_or_default(), [height, width], 1),
            [n, _, _, 3 | 4] | [n, _, _] => {
                let side = (n as f64).sqrt().round() as usize;
                let example = if side * side == n && n > 0 { format!("{side}x{side}") } else { format!("1x{n}") };
                return Err(format!(
                    "has the shape {shape:?}: {n} views one after the other need their rows and columns, as in {}?grid={example}",
                    file.display()
                ));
            }
            [rows, columns, height, width] => ([rows, columns], [height, width], 1),
            _ => {
                return Err(format!(
                    "has the shape {shape:?}: views are (rows of views, columns of views, rows of pixels, columns of pixels, \
                     colours), as (9, 9, 512, 512, 3), without the last where they are grey"
                ));
            }
        };
        if let Some([rows, columns]) = grid.filter(|grid| *grid != found) {
            return Err(format!("has {} x {} views, but a grid of {rows} x {columns} is stated", found[0], found[1]));
        }
        let is_size = |n: &usize| (1..=65536).contains(n);
        if !found.iter().all(|n| (1..=MOST_VIEWS).contains(n))
            || !size.iter().all(is_size)
            || size[0] * size[1] > MOST_PIXELS
        {
            let most = MOST_PIXELS >> 20;
            return Err(format!(
                "has the shape {shape:?}: at most {MOST_VIEWS} x {MOST_VIEWS} views of {most} Mpx are read, and one pixel at least"
            ));
        }
        Ok(Self { grid: found, size, channels })
    }
}

/// The largest value of an element of this kind; of floats 1.
fn full_scale(kind: &str) -> Result<f32, String> {
    match kind {
        "u1" => Ok(255.0),
        "u2" => Ok(65535.0),
        "f2" | "f4" | "f8" => Ok(1.0),
        _ => Err(format!(
            "holds '{kind}': views are of 8 or 16 bits without a sign ('u1', 'u2'), or floats of which 1 is full scale; \
             numpy.uint8(views) makes the first"
        )),
    }
}

/// An array that was opened, and what it says of itself.
struct Opened {
    array: NpyArray,
    layout: Layout,
    stated: Settings,
    full: f32,
}

fn open(file: &Path, options: &Options) -> Result<Opened, SceneError> {
    let stated = settings::beside(file, options)?;
    let array = NpyArray::open(file, options.array.as_deref(), |shape| matches!(shape.len(), 4 | 5));
    let array = array.map_err(|error| unread(file, error))?;
    let corrupt = |reason: String| SceneError::Corrupt { file: file.display().to_string(), reason };
    let layout = Layout::of(&array.shape, stated.grid, file).map_err(corrupt)?;
    let full = full_scale(&array.kind).map_err(corrupt)?;
    Ok(Opened { array, layout, stated, full })
}

fn unread(file: &Path, error: FileError) -> SceneError {
    match error {
        FileError::Content { file, reason } => SceneError::Corrupt { file, reason },
        FileError::Read { source, .. } => SceneError::unreadable(file, &source),
        other => SceneError::Unreadable { path: file.display().to_string(), reason: other.to_string() },
    }
}

/// Rows and columns of the views of an array.
///
/// # Errors
/// Those of [`read`] that its header can cause.
pub(super) fn size(file: &Path, options: &Options) -> Result<[usize; 2], SceneError> {
    Ok(open(file, options)?.layout.size)
}

/// Reads the views of an array, a few at a time, each scaled to the display as soon as it is read.
///
/// # Errors
/// Every [`SceneError`] that a file can cause; it names the file.
pub(super) fn read(file: &Path, options: &Options, request: &Request) -> Result<Read, SceneError> {
    let Opened { mut array, layout: Layout { grid, size, channels }, stated, full } = open(file, options)?;
    let count = grid[0] * grid[1];
    let frame = Frame::new(size, count, request)?;
    let is_float = full == 1.0;
    let transfer = stated.transfer.unwrap_or(if is_float { Transfer::Linear } else { Transfer::Srgb });
    let light = Light { file, full, transfer, channels, width: size[1] };
    let together = rayon::current_num_threads().min(count);
    let mut fitted: Vec<Vec<Vec<f32>>> = Vec::with_capacity(count);
    while fitted.len() < count {
        let mut some = Vec::with_capacity(together);
        while some.len() < together.min(count - fitted.len()) {
            let values = array.take(size[0] * size[1] * channels).map_err(|error| unread(file, error))?;
            some.push((fitted.len() + some.len(), values));
        }
        let one = |(view, values): (usize, Vec<f32>)| {
            Ok(frame.fit(light.planes([view / grid[1], view % grid[1]], &values, request.colors)?))
        };
        let some: Result<Vec<_>, SceneError> = some.into_par_iter().map(one).collect();
        fitted.extend(some?);
    }
    let field = frame.field(file, grid, fitted, request, &stated, stated.disparity);
    if is_float && field.planes.iter().flatten().flatten().any(|v| *v > BRIGHT) {
        tracing::warn!("{}: floats are light of which 1 is full scale, and some are above {BRIGHT}", file.display());
    }
    let how = format!("an array of {}", array.kind);
    views::ordered(file, field, request, &stated, how, size, is_float.then_some("floats"))
}

/// How the values of an array become light.
struct Light<'a> {
    file: &'a Path,
    /// The value of full scale.
    full: f32,
    transfer: Transfer,
    channels: usize,
    width: usize,
}

impl Light<'_> {
    /// The planes of a view, the one in this row and column; transparency is laid over black.
    fn planes(&self, at: [usize; 2], values: &[f32], colors: &[Color]) -> Result<Vec<Vec<f32>>, SceneError> {
        let (n, is_float) = (self.channels, self.full == 1.0);
        if is_float && let Some(i) = values.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            return Err(SceneError::Value {
                file: format!("{}, the view of row {}, column {}", self.file.display(), at[0] + 1, at[1] + 1),
                row: i / n / self.width,
                column: i / n % self.width,
                value: values[i],
                must: "finite and not negative",
            });
        }
        let table = (!is_float).then(|| table(self.full as u16, self.transfer));
        let light = |v: f32| match (table, self.transfer) {
            (Some(table), _) => table[v as usize],
            (None, Transfer::Srgb) => srgb_to_linear(f64::from(v)) as f32,
            (None, Transfer::Linear) => v,
        };
        let plane = |color: &Color| {
            let channel = if n > 1 { color.channel() } else { 0 };
            let value = |pixel: &[f32]| {
                let v = light(pixel[channel]);
                if n == 4 { v * (pixel[3] / self.full) } else { v }
            };
            values.chunks_exact(n).map(value).collect()
        };
        Ok(colors.iter().map(plane).collect())
    }
}
