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
        for Layer { depth, planes, opacity } in layers {
            let [right, down] = [x, y].map(|v| v * depth * from.per_metre);
            for row in 0..height {
                let rows = between(row, down, height);
                for column in 0..width {
                    let columns = between(column, right, width);
                    let (mut covered, mut light) = (0.0, [0.0f32; 3]);
                    for (j, high) in rows {
                        for (i, wide) in columns {
                            let at = j * width + i;
                            let share = high * wide * opacity[at];
                            covered += share;
                            light.iter_mut().zip(planes).for_each(|(sum, plane)| *sum += share * plane[at]);
                        }
                    }
                    let rest = (1.0 - covered).max(0.0);
                    for (out, light) in seen.iter_mut().zip(light) {
                        let out = &mut out[row * width + column];
                        *out = *out * rest + light;
                    }
                }
            }
        }
        seen
    };
    Ok(by_color(from.places.par_iter().map(view).collect::<Vec<_>>(), colors))
}

/// Returns the two samples around `at + shift` on an axis, each with its weight. The weight is zero beyond the ends.
fn between(at: usize, shift: f64, length: usize) -> [(usize, f32); 2] {
    let place = at as f64 + shift;
    let low = place.floor();
    let share = (place - low) as f32;
    [(low, 1.0 - share), (low + 1.0, share)].map(|(index, weight)| {
        let inside = (0.0..length as f64).contains(&index);
        if inside { (index as usize, weight) } else { (0, 0.0) }
    })
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

    #[test]
    fn depths_that_no_display_shows_are_refused() {
        let (picture, deep) = (square(), vec![16.0f32; 24 * 32]);
        let from = Places { places: &[[1e-2, 0.0]], per_metre: 3e5, size: SIZE };
        assert!(views_of_depths(&[&picture], &deep, &from).unwrap_err().code() == "displacement");
        assert!(views_of_layers(&[Layer { depth: 16.0, planes: vec![&picture], opacity: &picture }], &from).is_err());
    }
}
