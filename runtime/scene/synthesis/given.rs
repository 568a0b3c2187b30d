//! Makes views from a picture with its depths, or from pictures one in front of the other.

use crate::light_field::field::by_color;
use crate::synthesis::reproject::relief;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use rayon::prelude::*;

/// The largest displacement of content, as a share of the picture's shorter side.
const MOST: f64 = 0.25;

/// The places from which views of given pictures are made.
pub struct Places<'a> {
    /// Positions (x, y) relative to the place of the pictures, in meters of the pupil plane.
    pub places: &'a [[f64; 2]],
    /// Pixels by which content moves per meter of depth and per meter of the pupil plane, which is 1 / (f p).
    pub per_metre: f64,
    /// Rows and columns of every picture.
    pub size: [usize; 2],
}

impl Places<'_> {
    /// Returns the largest distance along an axis in meters.
    pub fn reach(&self) -> f64 {
        self.places.iter().flatten().fold(0.0, |far, v| v.abs().max(far))
    }

    /// Checks depths in meters.
    ///
    /// # Errors
    /// The reason in words, for depths that displace content by more than a quarter of the picture.
    pub fn check(&self, depths: impl Iterator<Item = f64>) -> Result<(), Reason> {
        let deepest = depths.fold(0.0, |far: f64, z| z.abs().max(far));
        let moved = deepest * self.per_metre * self.reach();
        let most = (MOST * self.size[0].min(self.size[1]) as f64).max(2.0);
        if moved <= most {
            return Ok(());
        }
        Err(reason!(
            "displacement",
            "its depths displace content by {moved:.0} pixels at the farthest position of the eye, but at most \
             {most:.0} are allowed"
        ))
    }
}

/// Returns views of a picture (one plane per color, one to three) whose pixels have these depths in meters, as (color,
/// place).
///
/// # Errors
/// The reason in words, for depths that displace content too far.
pub fn views_of_depths(planes: &[&[f32]], depths: &[f32], from: &Places<'_>) -> Result<Vec<Vec<Vec<f32>>>, Reason> {
    from.check(depths.iter().map(|z| f64::from(*z)))?;
    // Three colors together show the mixture at edges.
    let three: Vec<Vec<f32>> = (0..3).map(|i| planes[i.min(planes.len() - 1)].to_vec()).collect();
    // Disparities are per millimeter of the pupil plane.
    let disparity: Vec<f32> = depths.iter().map(|z| (f64::from(*z) * from.per_metre * 1e-3) as f32).collect();
    let relief = relief(&three, &disparity, from.size, (from.reach() * 1e3) as f32);
    let views: Vec<Vec<Vec<f32>>> =
        from.places.par_iter().map(|[x, y]| relief.view((x * 1e3) as f32, (y * 1e3) as f32)).collect();
    Ok(by_color(views, planes.len()))
}

/// A picture with opacity.
pub struct Layer<'a> {
    /// Depth of the layer in meters.
    pub depth: f64,
    /// One plane per color, not multiplied by the opacity.
    pub planes: Vec<&'a [f32]>,
    /// Share of the content behind that the layer covers, per pixel.
    pub opacity: &'a [f32],
}

/// Returns views of layers, which come with the farthest first, as (color, place).
///
/// # Errors
/// The reason in words, for depths that displace content too far.
pub fn views_of_layers(layers: &[Layer<'_>], from: &Places<'_>) -> Result<Vec<Vec<Vec<f32>>>, Reason> {
    from.check(layers.iter().map(|layer| layer.depth))?;
    let colors = layers.first().map_or(0, |layer| layer.planes.len());
    let [height, width] = from.size;
    let view = |[x, y]: &[f64; 2]| {
        let mut seen = vec![vec![0.0f32; height * width]; colors];
        let mut row = Row { share: vec![0.0; width], covered: vec![0.0; width], light: vec![vec![0.0; width]; colors] };
        for layer in layers {
            let moved = [x, y].map(|v| v * layer.depth * from.per_metre);
            (0..height).for_each(|at| row.cover(&mut seen, layer, at, moved));
        }
        seen
    };
    Ok(by_color(from.places.par_iter().map(view).collect::<Vec<_>>(), colors))
}

/// A row of a layer as a view sees it.
struct Row {
    /// The part of one sample in each pixel.
    share: Vec<f32>,
    /// The part of each pixel that the layer covers.
    covered: Vec<f32>,
    /// The light of the layer, per color.
    light: Vec<Vec<f32>>,
}

impl Row {
    /// Puts a row of a layer in front of the view. The view sees content by `moved` pixels to the right and below.
    fn cover(&mut self, seen: &mut [Vec<f32>], layer: &Layer<'_>, row: usize, [right, down]: [f64; 2]) {
        let width = self.covered.len();
        self.covered.fill(0.0);
        self.light.iter_mut().for_each(|light| light.fill(0.0));
        // The sum of four neighbors is a bilinear interpolation. Pixels beyond the ends are transparent.
        for (below, high) in samples(down) {
            let from = row.checked_add_signed(below).filter(|from| from * width < layer.opacity.len());
            let Some(from) = from.filter(|_| high > 0.0) else { continue };
            let line = from * width..(from + 1) * width;
            for (beside, wide) in samples(right) {
                let [skipped, empty] = [beside.max(0), (-beside).max(0)].map(|n| (n as usize).min(width));
                let (source, target) = (skipped..width - empty, empty..width - skipped);
                let opacity = &layer.opacity[line.clone()][source.clone()];
                let (share, covered) = (&mut self.share[target.clone()], &mut self.covered[target.clone()]);
                for ((share, covered), opacity) in share.iter_mut().zip(covered).zip(opacity) {
                    *share = high * wide * opacity;
                    *covered += *share;
                }
                for (light, plane) in self.light.iter_mut().zip(&layer.planes) {
                    let plane = &plane[line.clone()][source.clone()];
                    let of_sample = self.share[target.clone()].iter().zip(plane);
                    light[target.clone()].iter_mut().zip(of_sample).for_each(|(sum, (share, v))| *sum += share * v);
                }
            }
        }
        for (out, light) in seen.iter_mut().zip(&self.light) {
            let out = &mut out[row * width..(row + 1) * width];
            for ((out, light), covered) in out.iter_mut().zip(light).zip(&self.covered) {
                *out = *out * (1.0 - covered).max(0.0) + light;
            }
        }
    }
}

/// Returns the two samples around a displacement on an axis, each with its weight.
fn samples(moved: f64) -> [(isize, f32); 2] {
    let low = moved.floor();
    let share = (moved - low) as f32;
    [(low as isize, 1.0 - share), (low as isize + 1, share)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [24, 32];

    /// Makes a square around (row 12, column 16) on a gray ground.
    fn square() -> Vec<f32> {
        let inside = |i: usize| (i / 32).abs_diff(12) <= 3 && (i % 32).abs_diff(16) <= 3;
        (0..24 * 32).map(|i| if inside(i) { 1.0 } else { 0.25 }).collect()
    }

    fn middle(view: &[f32]) -> [f64; 2] {
        let (mut sum, mut at) = (0.0, [0.0; 2]);
        for (i, v) in view.iter().enumerate().filter(|(_, v)| **v > 0.6) {
            sum += f64::from(*v);
            at[0] += f64::from(*v) * (i % 32) as f64;
            at[1] += f64::from(*v) * (i / 32) as f64;
        }
        at.map(|v| v / sum)
    }

    /// A near square in front of a far ground is given as depths and as layers. Seen from the right and from below, it
    /// moves to the left and up (OPTICS 3), equally far in both.
    #[test]
    fn depths_and_layers_show_the_same() {
        let picture = square();
        let near: Vec<f32> = picture.iter().map(|v| if *v > 0.6 { 2e-3 } else { 0.0 }).collect();
        let places = [[0.0, 0.0], [1e-3, 0.0], [0.0, 2e-3]];
        // Two millimeters of depth and one of the pupil plane move content by 2 pixels.
        let from = Places { places: &places, per_metre: 1e6, size: SIZE };
        let depths = views_of_depths(&[&picture], &near, &from).unwrap();
        let (ground, full) = (vec![0.25f32; 24 * 32], vec![1.0f32; 24 * 32]);
        let opacity: Vec<f32> = picture.iter().map(|v| f32::from(*v > 0.6)).collect();
        let layers = [
            Layer { depth: 0.0, planes: vec![&ground], opacity: &full },
            Layer { depth: 2e-3, planes: vec![&picture], opacity: &opacity },
        ];
        let layers = views_of_layers(&layers, &from).unwrap();
        for views in [&depths[0], &layers[0]] {
            for (view, moved) in views.iter().zip([[0.0, 0.0], [-2.0, 0.0], [0.0, -4.0]]) {
                let [x, y] = middle(view);
                assert!((x - 16.0 - moved[0]).abs() < 0.2 && (y - 12.0 - moved[1]).abs() < 0.2, "{x}, {y}: {moved:?}");
            }
        }
        assert_eq!((depths.len(), layers.len(), &layers[0][0]), (1, 1, &picture));
    }

    /// Pixels of two layers by hand in float64, for displacements in all directions and beyond the ends.
    #[test]
    fn layers_are_interpolated_between_their_pixels() {
        let [height, width] = SIZE;
        let mut random = fastrand::Rng::with_seed(5);
        let mut plane = || (0..height * width).map(|_| random.f32()).collect::<Vec<f32>>();
        let (far, near, far_opacity, near_opacity) = (plane(), plane(), plane(), plane());
        let layers = [
            Layer { depth: -1e-3, planes: vec![&far], opacity: &far_opacity },
            Layer { depth: 2e-3, planes: vec![&near], opacity: &near_opacity },
        ];
        let places = [[0.3e-3, 1.2e-3], [-1.7e-3, -0.4e-3], [2.6e-3, -2.2e-3], [0.0, 0.0]];
        let from = Places { places: &places, per_metre: 1e6, size: SIZE };
        let views = views_of_layers(&layers, &from).unwrap();
        for ([x, y], view) in places.iter().zip(&views[0]) {
            for (i, found) in view.iter().enumerate() {
                let mut light = 0.0;
                for Layer { depth, planes, opacity } in &layers {
                    let [column, row] = [(x, i % width), (y, i / width)].map(|(v, at)| at as f64 + v * depth * 1e6);
                    let (mut covered, mut own) = (0.0, 0.0);
                    for at in 0..height * width {
                        let off = [column - (at % width) as f64, row - (at / width) as f64];
                        let share =
                            off.iter().map(|d| (1.0 - d.abs()).max(0.0)).product::<f64>() * f64::from(opacity[at]);
                        (covered, own) = (covered + share, own + share * f64::from(planes[0][at]));
                    }
                    light = light * (1.0 - covered) + own;
                }
                assert!((f64::from(*found) - light).abs() < 1e-5, "{i} at {x}, {y}: {found} {light}");
            }
        }
    }

    #[test]
    fn depths_that_no_display_shows_are_refused() {
        let (picture, deep) = (square(), vec![16.0f32; 24 * 32]);
        let from = Places { places: &[[1e-2, 0.0]], per_metre: 3e5, size: SIZE };
        assert!(views_of_depths(&[&picture], &deep, &from).unwrap_err().code() == "displacement");
        assert!(views_of_layers(&[Layer { depth: 16.0, planes: vec![&picture], opacity: &picture }], &from).is_err());
    }
}
