//! Light fields in one array: `.npy` and `.npz`, (rows of views, columns of views, rows of pixels, columns of pixels, colours).

use super::light::Transfer;
use super::options::Options;
use super::settings::{self, Settings};
use super::tone::{FullScale, Reading, Stored};
use super::views::{self, Frame, Read};
use super::{Request, SceneError};
use crate::files::{FileError, NpyArray};
use rayon::prelude::*;
use std::path::Path;

/// Views along an axis, and pixels of a view, at most.
const MOST_VIEWS: usize = 64;
const MOST_PIXELS: usize = 1 << 25;

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

/// The kind of the elements of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Elements {
    Bytes,
    Words,
    Floats,
}

impl Elements {
    fn of(kind: &str) -> Result<Self, String> {
        match kind {
            "u1" => Ok(Self::Bytes),
            "u2" => Ok(Self::Words),
            "f2" | "f4" | "f8" => Ok(Self::Floats),
            _ => Err(format!(
                "holds '{kind}': views are of 8 or 16 bits without a sign ('u1', 'u2'), or floats of which 1 is full scale; \
                 numpy.uint8(views) makes the first"
            )),
        }
    }
}

/// An array that was opened, and what it says of itself.
struct Opened {
    array: NpyArray,
    layout: Layout,
    stated: Settings,
    elements: Elements,
}

fn open(file: &Path, options: &Options) -> Result<Opened, SceneError> {
    let stated = settings::beside(file, options)?;
    let array = NpyArray::open(file, options.array.as_deref(), |shape| matches!(shape.len(), 4 | 5));
    let array = array.map_err(|error| unread(file, error))?;
    let corrupt = |reason: String| SceneError::Corrupt { file: file.display().to_string(), reason };
    let layout = Layout::of(&array.shape, stated.grid, file).map_err(corrupt)?;
    let elements = Elements::of(&array.kind).map_err(corrupt)?;
    Ok(Opened { array, layout, stated, elements })
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
    let Opened { mut array, layout: Layout { grid, size, channels }, stated, elements } = open(file, options)?;
    let count = grid[0] * grid[1];
    let frame = Frame::new(size, count, request)?;
    let reading = Reading::new(stated.tone());
    let planes = |view: usize, values: Vec<f32>| {
        let planes = match elements {
            Elements::Bytes => {
                let values: Vec<u8> = values.into_iter().map(|v| v as u8).collect();
                reading.light(Stored::Bytes(&values), channels, false, Transfer::Srgb, request.colors)
            }
            Elements::Words => {
                let values: Vec<u16> = values.into_iter().map(|v| v as u16).collect();
                reading.light(Stored::Words(&values), channels, false, Transfer::Srgb, request.colors)
            }
            Elements::Floats => {
                reading.light(Stored::Floats(&values), channels, false, Transfer::Linear, request.colors)
            }
        };
        let place =
            || format!("{}, the view of row {}, column {}", file.display(), view / grid[1] + 1, view % grid[1] + 1);
        planes.map_err(|(i, value)| SceneError::no_light(place(), [i / size[1], i % size[1]], value))
    };
    let together = rayon::current_num_threads().min(count);
    let mut fitted: Vec<Vec<Vec<f32>>> = Vec::with_capacity(count);
    while fitted.len() < count {
        let mut some = Vec::with_capacity(together);
        while some.len() < together.min(count - fitted.len()) {
            let values = array.take(size[0] * size[1] * channels).map_err(|error| unread(file, error))?;
            some.push((fitted.len() + some.len(), values));
        }
        let one = |(view, values): (usize, Vec<f32>)| Ok(frame.fit(planes(view, values)?));
        let some: Result<Vec<_>, SceneError> = some.into_par_iter().map(one).collect();
        fitted.extend(some?);
    }
    reading.judge(file, FullScale::File)?;
    let field = frame.field(file, grid, fitted, request, &stated, stated.disparity);
    let how = format!("an array of {}", array.kind);
    views::ordered(file, field, request, &stated, how, size, (elements == Elements::Floats).then_some("floats"))
}
