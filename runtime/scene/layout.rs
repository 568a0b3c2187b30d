//! What the axes of an array of views are. Other programs write them in other orders: such an array is refused with the line that
//! turns it.

use std::path::Path;

/// Views along an axis, and pixels of a view, at most.
const MOST_VIEWS: usize = 64;
const MOST_PIXELS: usize = 1 << 25;
/// Fewest pixels along an axis of a view by which an order of axes is recognized.
const FEWEST_PIXELS: usize = 8;

/// Lengths of the axes of an array of views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layout {
    pub grid: [usize; 2],
    pub size: [usize; 2],
    pub channels: usize,
}

/// Orders of five axes: which are rows and columns of views, rows and columns of pixels, and colors; the line that turns them.
const IN_COLOR: [([usize; 5], &str); 5] = [
    ([0, 1, 3, 4, 2], "numpy.moveaxis(views, 2, -1)"),
    ([3, 4, 0, 1, 2], "numpy.moveaxis(views, (3, 4), (0, 1))"),
    ([4, 3, 2, 1, 0], "numpy.transpose(views)"),
    ([2, 3, 0, 1, 4], "numpy.moveaxis(views, (2, 3), (0, 1))"),
    ([1, 2, 3, 4, 0], "numpy.moveaxis(views, 0, -1)"),
];
/// The same of four axes, without colors. What MATLAB wrote lists columns before rows once HDF5 was in between.
const IN_GRAY: [([usize; 4], &str); 1] =
    [([2, 3, 0, 1], "numpy.moveaxis(views, (2, 3), (0, 1)), or numpy.transpose(views) if columns come before rows")];

impl Layout {
    /// Determines the layout of an array of this shape; `grid` is that of its views, where it is stated, and `file` it.
    ///
    /// # Errors
    /// In words, with what would be right.
    pub fn of(shape: &[usize], grid: Option<[usize; 2]>, file: &Path) -> Result<Self, String> {
        let of_colors = |n: usize| matches!(n, 1 | 3 | 4);
        let fills = |n: usize| grid.is_some_and(|[rows, columns]| rows * columns == n);
        // A stated grid that the first axes have says that they are views.
        let stated = grid.is_some_and(|grid| shape.starts_with(&grid)) || shape.first().is_some_and(|n| fills(*n));
        if let Some(turn) = turned(shape).filter(|_| !stated) {
            return Err(format!(
                "has the shape {shape:?}: views are (rows of views, columns of views, rows of pixels, columns of pixels, \
                 colors), as by {turn}"
            ));
        }
        let (found, size, channels) = match *shape {
            [rows, columns, height, width, c] if of_colors(c) => ([rows, columns], [height, width], c),
            // Views one after the other.
            [n, height, width, c] if of_colors(c) && fills(n) => (grid.unwrap_or_default(), [height, width], c),
            [n, height, width] if fills(n) => (grid.unwrap_or_default(), [height, width], 1),
            [height, width, 3 | 4] | [height, width] if height >= FEWEST_PIXELS && width >= FEWEST_PIXELS => {
                return Err(format!(
                    "has the shape {shape:?}, which is one picture: an array holds views; save the picture as PNG, TIFF or EXR"
                ));
            }
            [n, _, _, 3 | 4] | [n, _, _] => {
                // The most even grid.
                let rows = (1..=MOST_VIEWS).rev().find(|rows| rows * rows <= n && n.is_multiple_of(*rows)).unwrap_or(1);
                let example = format!("{rows}x{}", n / rows);
                return Err(format!(
                    "has the shape {shape:?}: {n} views one after the other need their rows and columns, as in {}?grid={example}",
                    file.display()
                ));
            }
            [rows, columns, height, width] => ([rows, columns], [height, width], 1),
            [1, ref inner @ ..] if inner.len() >= 5 => return Self::of(inner, grid, file),
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

/// Whether these may be views: fewer of them along each axis than they have pixels.
fn plausible(grid: [usize; 2], size: [usize; 2], channels: usize) -> bool {
    matches!(channels, 1 | 3 | 4)
        && grid.iter().all(|n| (1..=MOST_VIEWS).contains(n))
        && size.iter().all(|n| *n >= FEWEST_PIXELS)
        && grid.iter().max() < size.iter().min()
}

/// The line that turns axes of an order that is not read; none where they may be in order.
fn turned(shape: &[usize]) -> Option<&'static str> {
    match *shape {
        [u, v, h, w, c] if !plausible([u, v], [h, w], c) => {
            let fits = |order: &[usize; 5]| {
                let [u, v, h, w, c] = order.map(|i| shape[i]);
                plausible([u, v], [h, w], c)
            };
            IN_COLOR.iter().find(|(order, _)| fits(order)).map(|(_, turn)| *turn)
        }
        // Colors last, or first, of views one after the other.
        [_, h, w, 3 | 4] if h >= FEWEST_PIXELS && w >= FEWEST_PIXELS => None,
        [n, c @ (3 | 4), h, w] if n > c && h >= FEWEST_PIXELS && w >= FEWEST_PIXELS && n < h.min(w) => {
            Some("numpy.moveaxis(views, 1, -1), with ?grid=ROWSxCOLUMNS behind the name")
        }
        [u, v, h, w] if !plausible([u, v], [h, w], 1) => {
            let fits = |order: &[usize; 4]| {
                let [u, v, h, w] = order.map(|i| shape[i]);
                plausible([u, v], [h, w], 1)
            };
            IN_GRAY.iter().find(|(order, _)| fits(order)).map(|(_, turn)| *turn)
        }
        [h, w, n] if n > 4 && n < h.min(w) && h.min(w) >= FEWEST_PIXELS => {
            Some("numpy.moveaxis(views, -1, 0), with ?grid=ROWSxCOLUMNS behind the name")
        }
        _ => None,
    }
}
