//! Determines the axes of an array of views, and refuses the orders of other programs.
//!
//! The refusal has the NumPy call that rearranges the array.

use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::path::Path;

/// Limits of the views along an axis, and of the pixels of a view.
const MOST_VIEWS: usize = 64;
const MOST_PIXELS: usize = 1 << 25;
/// Fewest pixels along an axis of a view for which an order of axes is recognized.
const FEWEST_PIXELS: usize = 8;

/// Lengths of the axes of an array of views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Layout {
    pub grid: [usize; 2],
    pub size: [usize; 2],
    pub channels: usize,
}

/// Orders of five axes, as rows and columns of views, rows and columns of pixels, and colors, with the call that
/// rearranges them.
const IN_COLOR: [([usize; 5], &str); 5] = [
    ([0, 1, 3, 4, 2], "numpy.moveaxis(views, 2, -1)"),
    ([3, 4, 0, 1, 2], "numpy.moveaxis(views, (3, 4), (0, 1))"),
    ([4, 3, 2, 1, 0], "numpy.transpose(views)"),
    ([2, 3, 0, 1, 4], "numpy.moveaxis(views, (2, 3), (0, 1))"),
    ([1, 2, 3, 4, 0], "numpy.moveaxis(views, 0, -1)"),
];
/// The same for four axes, without colors. Data that MATLAB wrote has columns before rows after a passage through HDF5.
const IN_GRAY: [([usize; 4], &str); 1] =
    [([2, 3, 0, 1], "numpy.moveaxis(views, (2, 3), (0, 1)), or numpy.transpose(views) if columns come before rows")];

impl Layout {
    /// Determines the layout of an array of this shape. `grid` is the stated grid of its views, `color` the axis of its
    /// colors if its contents show that, and `file` its path.
    pub fn of(shape: &[usize], grid: Option<[usize; 2]>, color: Option<usize>, file: &Path) -> Result<Self, Reason> {
        let of_colors = |n: usize| matches!(n, 1 | 3 | 4);
        let fills = |n: usize| grid.is_some_and(|[rows, columns]| rows * columns == n);
        // A stated grid that matches the first axes shows that these axes are the views.
        let stated = grid.is_some_and(|grid| shape.starts_with(&grid)) || shape.first().is_some_and(|n| fills(*n));
        if let Some(turn) = turned(shape, color).filter(|_| !stated) {
            return Err(reason!(
                "array-shape",
                "has the shape {shape:?}: views are (rows of views, columns of views, rows of pixels, columns of \
                 pixels, colors). Rearrange the axes by {turn}"
            ));
        }
        let (found, size, channels) = match *shape {
            [rows, columns, height, width, c] if of_colors(c) => ([rows, columns], [height, width], c),
            // Views one after the other.
            [n, height, width, c] if of_colors(c) && fills(n) => (grid.unwrap_or_default(), [height, width], c),
            [n, height, width] if fills(n) => (grid.unwrap_or_default(), [height, width], 1),
            [height, width, 3 | 4] | [height, width] if height >= FEWEST_PIXELS && width >= FEWEST_PIXELS => {
                return Err(reason!(
                    "array-one-picture",
                    "has the shape {shape:?}, which is one picture instead of views. Save the picture as PNG, TIFF or \
                     EXR"
                ));
            }
            [n, _, _, 3 | 4] | [n, _, _] => {
                // The most even grid is the example.
                let rows = (1..=MOST_VIEWS).rev().find(|rows| rows * rows <= n && n.is_multiple_of(*rows)).unwrap_or(1);
                let example = format!("{rows}x{}", n / rows);
                return Err(reason!(
                    "array-row-of-views",
                    "has the shape {shape:?}: {n} views one after the other need their rows and columns, as in {}?grid={example}",
                    file.display()
                ));
            }
            [rows, columns, height, width] => ([rows, columns], [height, width], 1),
            [1, ref inner @ ..] if inner.len() >= 5 => return Self::of(inner, grid, None, file),
            _ => {
                return Err(reason!(
                    "array-shape",
                    "has the shape {shape:?}: views are (rows of views, columns of views, rows of pixels, columns of \
                     pixels, colors), as (9, 9, 512, 512, 3), without the last axis if they are gray"
                ));
            }
        };
        if let Some([rows, columns]) = grid.filter(|grid| *grid != found) {
            return Err(reason!(
                "grid-count",
                "has {} x {} views, but a grid of {rows} x {columns} is stated",
                found[0],
                found[1]
            ));
        }
        let is_size = |n: &usize| (1..=65536).contains(n);
        if !found.iter().all(|n| (1..=MOST_VIEWS).contains(n))
            || !size.iter().all(is_size)
            || size[0] * size[1] > MOST_PIXELS
        {
            let most = MOST_PIXELS >> 20;
            return Err(reason!(
                "array-size",
                "has the shape {shape:?}, but an array may have {MOST_VIEWS} x {MOST_VIEWS} views of {most} Mpx at \
                 most, and one pixel at least"
            ));
        }
        Ok(Self { grid: found, size, channels })
    }
}

/// Returns true if these may be views, which are fewer along each axis than their pixels.
fn plausible(grid: [usize; 2], size: [usize; 2], channels: usize) -> bool {
    matches!(channels, 1 | 3 | 4)
        && grid.iter().all(|n| (1..=MOST_VIEWS).contains(n))
        && size.iter().all(|n| *n >= FEWEST_PIXELS)
        && grid.iter().max() < size.iter().min()
}

/// Returns the unsupported orders of five axes that this shape may have. It returns none if the axes may be in order.
fn orders(shape: &[usize]) -> Vec<([usize; 5], &'static str)> {
    let fits = |order: &[usize; 5]| {
        let [u, v, h, w, c] = order.map(|i| shape[i]);
        plausible([u, v], [h, w], c)
    };
    if shape.len() != 5 || fits(&[0, 1, 2, 3, 4]) {
        return Vec::new();
    }
    IN_COLOR.into_iter().filter(|(order, _)| fits(order)).collect()
}

/// Returns true if the shape leaves open which axis counts colors.
pub(crate) fn needs_contents(shape: &[usize]) -> bool {
    orders(shape).len() > 1
}

/// Differences of stored values up to this share of the largest value count as equal.
const SAME: f32 = 1.0 / 64.0;
/// The axis of the colors must be unlike an axis of views by this much more than any other axis (logarithms of ratios).
const CLEARLY: f64 = 1.2;

/// Finds the axis of the colors among several that the shape allows, from the values in C order. It returns `None` if
/// the values do not show it. From view to view, a picture differs along both axes of the grid alike, at moving
/// content. From color to color, it differs everywhere or nowhere.
pub(crate) fn color_axis(shape: &[usize], values: &[f32]) -> Option<usize> {
    let orders = orders(shape);
    let is_of_views = |axis: &usize| orders.iter().all(|(order, _)| order[..2].contains(axis));
    let views = (0..shape.len()).find(is_of_views)?;
    let largest = values.iter().fold(f32::MIN_POSITIVE, |most, v| most.max(v.abs()));
    let differs = |axis: usize| {
        let stride: usize = shape[axis + 1..].iter().product();
        let has_next = |i: &usize| i / stride % shape[axis] + 1 < shape[axis];
        let (mut sum, mut other, mut count) = (1e-6, 1e-3, 1e-9);
        for i in (0..values.len()).filter(has_next) {
            let apart = (values[i + stride] - values[i]).abs() / largest;
            (sum, other, count) = (sum + f64::from(apart), other + f64::from(u8::from(apart > SAME)), count + 1.0);
        }
        [sum / count, other / count]
    };
    let usual = differs(views);
    let unlike = |axis: usize| differs(axis).iter().zip(usual).map(|(a, b)| (a / b).ln().abs()).sum::<f64>();
    let mut found: Vec<(f64, usize)> = orders.iter().map(|(order, _)| (unlike(order[4]), order[4])).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.dedup_by_key(|(_, axis)| *axis);
    match found[..] {
        [(_, axis)] => Some(axis),
        [(most, axis), (second, _), ..] => (most > second + CLEARLY).then_some(axis),
        [] => None,
    }
}

/// Returns the call that rearranges axes of an unsupported order. It returns `None` if the axes may be in order.
fn turned(shape: &[usize], color: Option<usize>) -> Option<String> {
    if shape.len() == 5 {
        let orders = orders(shape);
        let lines = orders.iter().filter(|(order, _)| color.is_none_or(|axis| order[4] == axis));
        let lines: Vec<String> = match lines.clone().count() {
            1 => lines.map(|(_, turn)| (*turn).to_owned()).collect(),
            _ => lines.map(|(order, turn)| format!("{turn} if axis {} counts colors", order[4])).collect(),
        };
        return (!lines.is_empty()).then(|| lines.join(", or by "));
    }
    turned_in_gray(shape).map(str::to_owned)
}

/// The same without colors, or for views one after the other.
fn turned_in_gray(shape: &[usize]) -> Option<&'static str> {
    match *shape {
        // Colors are last, or first, in views one after the other.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of an array (rows of views, columns, rows of pixels, columns, colors) of a scene whose content moves from
    /// view to view.
    fn views(u: usize, v: usize, h: usize, w: usize, c: usize) -> f32 {
        let (y, x) = (h + u, w + 2 * v);
        let bump = |a: usize, b: usize| (((y / 4 * 7 + x / 4 * 13 + a) % b) as f32) / b as f32;
        0.5 * bump(0, 11) + [0.3, 0.1, 0.45][c] * bump(c, 5)
    }

    fn stored(shape: [usize; 5], order: [usize; 5], gray: bool) -> Vec<f32> {
        let count: usize = shape.iter().product();
        let value = |mut i: usize| {
            let mut at = [0; 5];
            for axis in (0..5).rev() {
                (at[order[axis]], i) = (i % shape[axis], i / shape[axis]);
            }
            views(at[0], at[1], at[2], at[3], if gray { 0 } else { at[4] })
        };
        (0..count).map(value).collect()
    }

    #[test]
    fn contents_show_the_axis_of_colors_that_a_shape_leaves_open() {
        for (shape, order, color) in [
            ([32, 32, 3, 3, 3], [2, 3, 0, 1, 4], 4),
            ([32, 32, 3, 3, 3], [2, 3, 4, 0, 1], 2),
            ([3, 3, 3, 32, 32], [0, 1, 4, 2, 3], 2),
            ([3, 3, 3, 32, 32], [4, 0, 1, 2, 3], 0),
        ] {
            assert!(needs_contents(&shape));
            for gray in [false, true] {
                let values = stored(shape, order, gray);
                let found = color_axis(&shape, &values);
                assert!(found == Some(color) || (found.is_none() && !gray), "{shape:?} {order:?}: {found:?}");
            }
            let flat = vec![0.5; shape.iter().product()];
            assert_eq!(color_axis(&shape, &flat), None);
            // The message has both calls if the contents show nothing.
            let both = turned(&shape, None).unwrap();
            assert_eq!(both.matches("numpy.").count(), 2, "{both}");
            assert_eq!(turned(&shape, Some(color)).unwrap().matches("numpy.").count(), 1);
        }
        assert!(!needs_contents(&[3, 3, 32, 32, 3]) && !needs_contents(&[5, 5, 3, 32, 32]));
    }
}
