//! Measures the depth of a view by a plane sweep over the views of its row and column.

use crate::depth::map::resized;
use crate::depth::range::{USUAL, mean_light};
use crate::depth::sweep::{Compared, MOST, Sweep, reach_within};
use crate::light_field::resize::Resize;
use crate::{Fit, LightField, Pyramid, ViewGrid};
use eyebox_optics::Display;

/// Pixels along the longer side of the copies in which disparities are searched.
const LARGEST: usize = 512;
/// Steps to the farthest view that is compared in the search for the disparities of any view.
const NEAR: usize = 3;

/// Returns the depth of each pixel of the central view, (height, width), in meters. The central row and column of views
/// agree best at this depth. The range is the one that the scene states or that is found (see
/// `LightField::disparities_sought`).
pub fn central_depth(field: &LightField, display: &Display) -> Vec<f32> {
    let range = field.disparities_sought(display);
    let per_pixel = display.focal_length * display.picture_pixel() / field.cell(display);
    let Some(views) = field.planes.get(field.planes.len() / 2) else { return Vec::new() };
    let (counts, size) = (field.grid, [field.height, field.width]);
    let at = counts.map(|n| n / 2);
    let compared = Compared::Exactly;
    let found = if field.depth_range(display).is_some() || range == USUAL {
        let reach = reach_within(range, usize::MAX);
        Sweep::around(counts, at, reach, size, |index| views[index].clone()).disparities(range, compared)
    } else {
        let (grid, center) = (field.view_grid(display), at[0] * counts[1] + at[1]);
        view_disparities(&grid, center, size, range, compared, mean_light(field))
    };
    found.into_iter().map(|d| (f64::from(d) * per_pixel) as f32).collect()
}

/// Returns the central view of a pyramid in linear light, and its disparities between the ends of `range` (pixels
/// between neighboring views). Both are (height, width) of the pyramid's first level.
pub fn central_view(pyramid: &Pyramid, grid: &ViewGrid, range: [f64; 2]) -> (Vec<f32>, Vec<f32>) {
    let level = &pyramid.levels[0];
    let pixels = level.height * level.width;
    let unit = pyramid.scale / 65535.0;
    let view =
        |index: usize| level.views[index * pixels..][..pixels].iter().map(|v| f32::from(*v) * unit).collect::<Vec<_>>();
    let at = [grid.rows / 2, grid.columns / 2];
    let reach = reach_within(range, usize::MAX);
    let sweep = Sweep::around([grid.rows, grid.columns], at, reach, [level.height, level.width], view);
    (view(at[0] * grid.columns + at[1]), sweep.disparities(range, Compared::Exactly))
}

/// Returns the bytes that [`view_disparities`] takes while it works, which are two volumes of costs.
pub(crate) fn scratch([height, width]: [usize; 2], range: [f64; 2]) -> u64 {
    let times = height.max(width).div_ceil(LARGEST).max(1);
    let candidates = ((2.0 * (range[1] - range[0]) * NEAR as f64 / times as f64).ceil() as usize + 1).min(MOST);
    (8 * candidates * height.div_ceil(times) * width.div_ceil(times)) as u64
}

/// Returns the disparities of any view of a grid, (height, width), from its nearest neighbors. They are between the
/// ends of `range` (pixels between neighboring views). Large views are compared in fewer pixels.
pub(crate) fn view_disparities(
    grid: &ViewGrid,
    view: usize,
    [height, width]: [usize; 2],
    range: [f64; 2],
    compared: Compared,
    light: impl Fn(usize) -> Vec<f32>,
) -> Vec<f32> {
    let (counts, at) = ([grid.rows, grid.columns], [view / grid.columns, view % grid.columns]);
    let times = height.max(width).div_ceil(LARGEST);
    if times <= 1 {
        return Sweep::around(counts, at, reach_within(range, NEAR), [height, width], light)
            .disparities(range, compared);
    }
    let [rows, columns] = [height.div_ceil(times), width.div_ceil(times)];
    let shrink = Resize::new([height, width], [rows, columns], Fit::Stretch);
    let scale = columns as f64 / width as f64;
    let range = range.map(|d| d * scale);
    let sweep =
        Sweep::around(counts, at, reach_within(range, NEAR), [rows, columns], |view| shrink.apply(&light(view)));
    let found = sweep.disparities(range, compared);
    let values: Vec<f32> = found.into_iter().map(|d| (f64::from(d) / scale) as f32).collect();
    resized(&values, [rows, columns], [height, width], 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Request, load};
    use eyebox_optics::Color;

    fn depths(source: &str) -> (LightField, Vec<f32>) {
        let display = Display { height: 96, width: 120, ..Display::preset("small").unwrap() };
        let field = load(source, &Request::new(&display, &[Color::Green])).unwrap();
        let depth = central_depth(&field, &display);
        (field, depth)
    }

    #[test]
    fn a_plane_is_found_at_its_depth() {
        for mm in [-0.3, 0.0, 0.4] {
            let display = Display { height: 96, width: 120, ..Display::preset("small").unwrap() };
            let mut field =
                load(&format!("builtin:plane?depth={mm}"), &Request::new(&display, &[Color::Green])).unwrap();
            // The plane's own range would reveal its depth.
            field.depth = Some([-0.6e-3, 0.6e-3]);
            let depth = central_depth(&field, &display);
            let mut off: Vec<f32> = depth.iter().map(|z| (z * 1e3 - mm as f32).abs()).collect();
            off.sort_by(f32::total_cmp);
            // A depth of 0.16 mm is half a pixel between the center and the outermost view.
            let at = |share: f64| off[(off.len() as f64 * share) as usize];
            assert!(at(0.5) < 0.05 && at(0.9) < 0.16, "{mm} mm: {} and {} mm off", at(0.5), at(0.9));
        }
    }

    /// Costs that do not depend on the sampling of detail are less exact about its position. This test shows that a
    /// choice by them loses nothing.
    #[test]
    fn a_plane_is_found_as_well_where_views_are_compared_as_sampled() {
        let display = Display { height: 96, width: 120, ..Display::preset("small").unwrap() };
        for mm in [-0.3, 0.0, 0.4] {
            let field = load(&format!("builtin:plane?depth={mm}"), &Request::new(&display, &[Color::Green])).unwrap();
            let true_disparity = (field.depth.unwrap()[0] * field.cell(&display)
                / (display.focal_length * display.picture_pixel())) as f32;
            let off = |compared| {
                let (grid, range) = (field.view_grid(&display), [-0.46, 0.46]);
                let found = view_disparities(&grid, 40, [96, 120], range, compared, mean_light(&field));
                let mut off: Vec<f32> = found.iter().map(|d| (d - true_disparity).abs()).collect();
                off.sort_by(f32::total_cmp);
                [0.5, 0.9].map(|share| off[(off.len() as f64 * share) as usize])
            };
            let [exactly, sampled] = [off(Compared::Exactly), off(Compared::AsSampled)];
            let as_well = exactly.iter().zip(sampled).all(|(a, b)| b < a + 0.005);
            assert!(as_well && sampled[1] < 0.2, "{mm} mm: {sampled:?} pixels off, {exactly:?} by all that differs");
        }
    }

    #[test]
    fn near_and_far_are_told_apart() {
        let (field, depth) = depths("builtin:still-life");
        let [far, near] = field.depth.unwrap();
        let third = |k: usize| {
            let rows = depth.chunks_exact(field.width).skip(k * 32).take(32).flatten();
            rows.map(|z| f64::from(*z)).sum::<f64>() / (32 * field.width) as f64
        };
        // The wall is behind, and the cloth comes towards the eye.
        assert!(third(0) < third(2) - 0.2 * (near - far), "{} {}", third(0), third(2));
    }
}
