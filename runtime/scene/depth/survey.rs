//! Measures the light and the depths of a scene.

use crate::LightField;
use crate::depth::range::{DepthSource, Measured};
use eyebox_optics::{Color, Display};
use rayon::prelude::*;

/// The light of one color of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// The color of this light.
    pub color: Color,
    /// The brightest value of any view, in linear light.
    pub brightest: f64,
    /// The mean over all views, in linear light.
    pub mean: f64,
}

/// Rows and columns of pixels, from each edge, that have no light in any view and color.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Black {
    /// Number of rows from the top.
    pub top: usize,
    /// Number of rows from the bottom.
    pub bottom: usize,
    /// Number of columns from the left.
    pub left: usize,
    /// Number of columns from the right.
    pub right: usize,
}

/// Returns the pixels of `display` that a pupil of this diameter (meters) distinguishes, which are the pixels of its
/// spectral window (OPTICS 5).
pub(crate) fn told_apart(display: &Display, diameter: f64) -> f64 {
    (display.eyebox_min() / diameter.max(1e-9)).max(1.0)
}

/// Light below this share of the brightest value counts as none, because a view is stored in 65535 steps.
pub const DARK: f64 = 0.5 / 65535.0;

impl LightField {
    /// Returns the light per color, in the order of `colors`.
    pub fn light(&self) -> Vec<Light> {
        let one = |(color, views): (&Color, &Vec<Vec<f32>>)| {
            let sums = views.par_iter().map(|view| {
                let brightest = view.iter().copied().fold(0.0f32, f32::max);
                (f64::from(brightest), view.iter().map(|v| f64::from(*v)).sum::<f64>())
            });
            let (brightest, sum) = sums.reduce(|| (0.0, 0.0), |a, b| (a.0.max(b.0), a.1 + b.1));
            let count = (views.len() * self.height * self.width).max(1) as f64;
            Light { color: *color, brightest, mean: sum / count }
        };
        self.colors.iter().zip(&self.planes).map(one).collect()
    }

    /// Returns the margins without light.
    pub fn black(&self) -> Black {
        let views: Vec<&Vec<f32>> = self.planes.iter().flatten().collect();
        let least = (f64::from(self.brightest()) * DARK) as f32;
        let nothing = || (vec![false; self.height], vec![false; self.width]);
        let either = |mut a: (Vec<bool>, Vec<bool>), b: (Vec<bool>, Vec<bool>)| {
            a.0.iter_mut().zip(b.0).for_each(|(a, b)| *a |= b);
            a.1.iter_mut().zip(b.1).for_each(|(a, b)| *a |= b);
            a
        };
        let lit = views.par_iter().fold(nothing, |(mut rows, mut columns), view| {
            for (lit, row) in rows.iter_mut().zip(view.chunks_exact(self.width)) {
                *lit |= row.iter().any(|v| *v > least);
                columns.iter_mut().zip(row).for_each(|(lit, v)| *lit |= *v > least);
            }
            (rows, columns)
        });
        let (rows, columns) = lit.reduce(nothing, either);
        let dark = |lit: &mut dyn Iterator<Item = &bool>| lit.take_while(|l| !**l).count();
        Black {
            top: dark(&mut rows.iter()),
            bottom: dark(&mut rows.iter().rev()),
            left: dark(&mut columns.iter()),
            right: dark(&mut columns.iter().rev()),
        }
    }

    /// Returns the mean square of the light in the outermost `pixels` rows and columns of all views, over the whole
    /// picture. It is the error power if all of this light left the picture and entered again on the other side. The
    /// brightest value is 1.
    pub fn edge_power(&self, pixels: usize) -> f64 {
        let (h, w) = (self.height, self.width);
        let brightest = self.brightest();
        if brightest <= 0.0 || pixels == 0 {
            return 0.0;
        }
        let power = |values: &[f32]| values.iter().map(|v| f64::from(v / brightest).powi(2)).sum::<f64>();
        let of = |view: &&Vec<f32>| {
            let row = |(y, row): (usize, &[f32])| {
                let inside = y >= pixels && y + pixels < h && 2 * pixels < w;
                if inside { power(&row[..pixels]) + power(&row[w - pixels..]) } else { power(row) }
            };
            view.chunks_exact(w).enumerate().map(row).sum::<f64>() / (h * w) as f64
        };
        let views: Vec<&Vec<f32>> = self.planes.iter().flatten().collect();
        views.par_iter().map(of).sum::<f64>() / views.len().max(1) as f64
    }

    /// Returns the brightest value of any view and color.
    pub(crate) fn brightest(&self) -> f32 {
        let views: Vec<&Vec<f32>> = self.planes.iter().flatten().collect();
        views.par_iter().map(|v| v.iter().copied().fold(0.0, f32::max)).reduce(|| 0.0, f32::max)
    }

    /// Returns the pixels of `display` by which the ends of `depth` (meters) move against each other from view to view.
    /// If this is more than a pupil distinguishes, the pupil sees each edge out of focus once per view that it covers
    /// (OPTICS 14).
    pub fn aliasing(&self, display: &Display, [far, near]: [f64; 2]) -> f64 {
        let views = self.grid[0].max(self.grid[1]);
        if views < 2 {
            0.0
        } else {
            (near - far).abs() * self.cell(display) / (display.focal_length * display.picture_pixel())
        }
    }

    /// Describes [`aliasing`](Self::aliasing) and its effect on pupils up to `widest` (meters) for people. The flag is
    /// true if they see it.
    pub fn aliasing_in_words(&self, display: &Display, depth: [f64; 2], widest: f64) -> ([String; 2], bool) {
        let pixels = self.aliasing(display, depth);
        let least = told_apart(display, widest);
        let seen = pixels > least;
        let mm = widest * 1e3;
        let why = if seen {
            let views = self.views_without_aliasing(display, depth, widest);
            format!("pupils of {mm:.1} mm see ghosts out of focus, and {views} x {views} views would not show them")
        } else {
            format!("pupils of up to {mm:.1} mm distinguish {least:.1} pixels and see no ghosts out of focus")
        };
        ([format!("{pixels:.1} pixels from view to view"), why], seen)
    }

    /// Returns the views per axis, over the same area of the pupil plane, with which a pupil `widest` meters wide would
    /// see no [`aliasing`](Self::aliasing).
    pub fn views_without_aliasing(&self, display: &Display, depth: [f64; 2], widest: f64) -> usize {
        let views = self.grid[0].max(self.grid[1]);
        (views as f64 * (self.aliasing(display, depth) / told_apart(display, widest)).max(1.0)).min(1e6).ceil() as usize
    }

    /// Returns the farthest and the nearest depth on `display` in meters. They are stated by the scene, otherwise
    /// measured in the central view. They are 0 if nothing can be measured.
    pub fn reach(&self, display: &Display) -> ([f64; 2], DepthSource) {
        if let Some([a, b]) = self.depth_range(display) {
            return ([a.min(b), a.max(b)], DepthSource::Stated);
        }
        let per_pixel = display.focal_length * display.picture_pixel() / self.cell(display);
        let Measured { range, trust } = self.measured();
        (range.unwrap_or_default().map(|d| d * per_pixel), trust)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Request, load};

    fn scene(source: &str) -> (LightField, Display) {
        let display = Display { height: 60, width: 80, ..Display::preset("small").unwrap() };
        let field = load(source, &Request::new(&display, &[Color::Red, Color::Green])).unwrap();
        (field, display)
    }

    #[test]
    fn light_is_found_where_it_is() {
        let (mut field, _) = scene("builtin:plane");
        field.planes[0].iter_mut().flatten().for_each(|v| *v = 0.0);
        for view in &mut field.planes[1] {
            view.iter_mut().enumerate().filter(|(i, _)| i / 80 < 5 || i % 80 >= 77).for_each(|(_, v)| *v = 0.0);
        }
        let light = field.light();
        assert_eq!((light[0].color, light[0].brightest, light[0].mean), (Color::Red, 0.0, 0.0));
        assert!(light[1].brightest > 0.1 && light[1].mean > 0.01);
        assert_eq!(field.black(), Black { top: 5, bottom: 0, left: 0, right: 3 });
        // One speck of light in one view ends the margin.
        field.planes[1][7][2 * 80 + 79] = 0.5;
        assert_eq!(field.black(), Black { top: 2, bottom: 0, left: 0, right: 0 });
        assert_eq!(field.edge_power(0), 0.0);
        assert!(field.edge_power(2) > 0.0 && field.edge_power(2) < field.edge_power(10));
        field.planes.iter_mut().flatten().flatten().for_each(|v| *v = 0.0);
        assert_eq!((field.black().top, field.edge_power(10)), (60, 0.0));
    }

    #[test]
    fn depth_is_measured_where_it_is_not_stated() {
        let (field, display) = scene("builtin:plane?depth=0.3");
        assert_eq!(field.reach(&display).1, DepthSource::Stated);
        let silent = LightField { depth: None, disparity: None, ..field };
        let ([far, near], source) = silent.reach(&display);
        assert_eq!(source, DepthSource::Measured);
        // Candidates are an eighth of a pixel apart, and the tolerance is two of them.
        let least = 0.25 * display.focal_length * display.pitch / silent.cell(&display);
        assert!((far - 3e-4).abs() < least && (near - 3e-4).abs() < least, "{far} .. {near}");
    }
}
