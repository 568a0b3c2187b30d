//! Corrects distortion and lateral color between the display and the eye (OPTICS 10, Camera).

use super::Color;
use super::linear::least_squares;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};

/// `[picture]` of a display file, the places at which a camera saw each color's picture. Places run from -1 to 1 across
/// the widths of the picture and of the camera image. y has the same unit, and the origin is the center.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct Picture {
    /// True if the camera looked straight at the display and was not rotated. Keystone and rotation then belong to the
    /// display and are corrected. Otherwise they belong to the camera.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub straight: bool,
    /// Map of the red picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub red: Option<PictureWarp>,
    /// Map of the green picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub green: Option<PictureWarp>,
    /// Map of the blue picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blue: Option<PictureWarp>,
}

/// The place of one color's picture in a camera image, `g = (X, Y) (1 + k1 rho^2 + k2 rho^4)`. (X, Y) is the homography
/// of the place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureWarp {
    /// The homography row by row. Its ninth number is 1.
    pub homography: [f64; 8],
    /// The coefficients k1 and k2 of the radial distortion.
    #[serde(default)]
    pub distortion: [f64; 2],
}

/// A homography in row-major order.
type Homography = [f64; 9];

fn project([a, b, c, d, e, f, g, h, i]: Homography, [x, y]: [f64; 2]) -> [f64; 2] {
    let w = g * x + h * y + i;
    [(a * x + b * y + c) / w, (d * x + e * y + f) / w]
}

/// The inverse up to a factor, which changes no place.
fn adjugate([a, b, c, d, e, f, g, h, i]: Homography) -> Homography {
    let (of, by, at) = (e * i - f * h, c * h - b * i, b * f - c * e);
    [of, by, at, f * g - d * i, a * i - c * g, c * d - a * f, d * h - e * g, b * g - a * h, a * e - b * d]
}

impl PictureWarp {
    /// Makes a map from the ten numbers of a camera's map, which are the homography, k1 and k2.
    pub fn by_camera([a, b, c, d, e, f, g, h, k1, k2]: [f64; 10]) -> Self {
        Self { homography: [a, b, c, d, e, f, g, h], distortion: [k1, k2] }
    }

    fn homography(&self) -> Homography {
        let [a, b, c, d, e, f, g, h] = self.homography;
        [a, b, c, d, e, f, g, h, 1.0]
    }

    fn bend(&self, rho2: f64) -> f64 {
        1.0 + self.distortion[0] * rho2 + self.distortion[1] * rho2 * rho2
    }

    /// Maps a place in the display's picture to the camera image.
    pub fn forth(&self, at: [f64; 2]) -> [f64; 2] {
        let [x, y] = project(self.homography(), at);
        let bend = self.bend(x * x + y * y);
        [x * bend, y * bend]
    }

    /// Maps a place in the camera image to the display's picture.
    pub fn back(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let rho = u.hypot(v);
        // Newton's method finds the radius before the distortion.
        let [k1, k2] = self.distortion;
        let mut r = rho;
        for _ in 0..ROUNDS {
            let slope = 1.0 + 3.0 * k1 * r * r + 5.0 * k2 * r.powi(4);
            let step = (r * self.bend(r * r) - rho) / slope;
            r -= step;
            if step.abs() < 1e-14 || step.is_nan() {
                break;
            }
        }
        let undone = if rho > 0.0 { r / rho } else { 1.0 };
        project(adjugate(self.homography()), [u * undone, v * undone])
    }
}

/// The place of one color's picture for a viewer, who sees the whole picture at its correct place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureMap {
    seen: PictureWarp,
    /// Maps the camera image to the viewer's picture.
    camera: Homography,
}

/// Largest number of Newton steps for the inverse of the distortion.
const ROUNDS: usize = 30;
/// Places along each axis from which the camera's pose is fitted.
const PLACES: usize = 9;

impl PictureMap {
    /// Maps a place in the display's picture to the viewer's picture.
    pub fn forth(&self, at: [f64; 2]) -> [f64; 2] {
        project(self.camera, self.seen.forth(at))
    }

    /// Maps a place in the viewer's picture to the display's picture.
    pub fn back(&self, at: [f64; 2]) -> [f64; 2] {
        self.seen.back(project(adjugate(self.camera), at))
    }
}

/// Places over a picture of this many rows and columns, including its edges.
fn places([rows, columns]: [usize; 2]) -> impl Iterator<Item = [f64; 2]> {
    let high = rows as f64 / columns as f64;
    let place = |i: usize| 2.0 * i as f64 / (PLACES - 1) as f64 - 1.0;
    (0..PLACES * PLACES).map(move |i| [place(i % PLACES), high * place(i / PLACES)])
}

impl Picture {
    /// True if no color has a map.
    pub fn is_empty(&self) -> bool {
        [self.red, self.green, self.blue].iter().all(Option::is_none)
    }

    /// Stores the measured map of a color's picture.
    pub fn set(&mut self, color: Color, seen: PictureWarp) {
        *[&mut self.red, &mut self.green, &mut self.blue][color.channel()] = Some(seen);
    }

    /// The measured map of a color's picture, or none without a measurement.
    pub fn seen(&self, color: Color) -> Option<PictureWarp> {
        [self.red, self.green, self.blue][color.channel()]
    }

    /// The color to which the others are registered. It is green, or the first that was measured.
    fn reference(&self) -> Option<PictureWarp> {
        self.green.or(self.red).or(self.blue)
    }

    /// The map of the picture of `color`, for a picture of this many rows and columns. A color without a measurement
    /// uses the map of the reference (green, otherwise red). The result is none if no color was measured.
    pub fn map(&self, color: Color, [rows, columns]: [usize; 2]) -> Option<PictureMap> {
        let reference = self.reference()?;
        let pairs: Vec<_> = places([rows, columns]).map(|at| (reference.forth(at), at)).collect();
        let camera = if self.straight { upright(&pairs) } else { homography(&pairs) }?;
        Some(PictureMap { seen: self.seen(color).unwrap_or(reference), camera })
    }

    /// The largest displacement of the picture of `color`, in pixels of a picture of this many rows and columns.
    pub fn farthest(&self, color: Color, [rows, columns]: [usize; 2]) -> f64 {
        let Some(map) = self.map(color, [rows, columns]) else { return 0.0 };
        let off = |at: [f64; 2]| {
            let [x, y] = map.forth(at);
            (x - at[0]).hypot(y - at[1])
        };
        0.5 * columns as f64 * places([rows, columns]).map(off).fold(0.0, f64::max)
    }

    /// Checks the maps for a picture of this many rows and columns.
    ///
    /// # Errors
    /// A reason in words.
    pub fn check(&self, [rows, columns]: [usize; 2]) -> Result<(), Reason> {
        for color in [Color::Red, Color::Green, Color::Blue] {
            let Some(seen) = self.seen(color) else { continue };
            let numbers = seen.homography.iter().chain(&seen.distortion);
            if !numbers.clone().all(|v| v.is_finite() && v.abs() <= 100.0) {
                return Err(reason!("picture-range", "[picture.{color}] has a number beyond 100"));
            }
            let odd = || {
                Err(reason!(
                    "picture-folds",
                    "[picture.{color}] folds the picture: its map must take each place to a different one"
                ))
            };
            let Some(map) = self.map(color, [rows, columns]) else { return odd() };
            // The inverse must undo the map, and areas must keep their sign, over the whole picture.
            let mut sign = 0.0;
            for at in places([rows, columns]) {
                let step = |dx: f64, dy: f64| map.forth([at[0] + dx, at[1] + dy]);
                let ([x, y], [ax, ay], [bx, by]) = (step(0.0, 0.0), step(1e-4, 0.0), step(0.0, 1e-4));
                let area = (ax - x) * (by - y) - (ay - y) * (bx - x);
                let back = map.back([x, y]);
                let off = (back[0] - at[0]).hypot(back[1] - at[1]);
                if !(area * sign >= 0.0 && area != 0.0 && off < 1e-6) {
                    return odd();
                }
                sign = area.signum();
            }
            let moved = 2.0 * self.farthest(color, [rows, columns]) / columns as f64;
            if moved > 0.5 {
                return Err(reason!(
                    "picture-moves",
                    "[picture.{color}] moves the picture by {moved:.2} of half its width: at most 0.5"
                ));
            }
        }
        Ok(())
    }
}

/// The homography that maps the first place of each pair closest to the second.
fn homography(pairs: &[([f64; 2], [f64; 2])]) -> Option<Homography> {
    let mut found: Homography = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    // The problem is linear except for the weight of each place, which comes from the round before.
    for round in 0..10 {
        let rows = pairs.iter().flat_map(|&([x, y], [u, v])| {
            let weight = if round == 0 { 1.0 } else { 1.0 / (found[6] * x + found[7] * y + 1.0) };
            let along = ([x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y], u);
            let down = ([0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y], v);
            [along, down].map(|(row, right)| (row.map(|v| v * weight), right * weight))
        });
        let [a, b, c, d, e, f, g, h] = least_squares(rows)?;
        found = [a, b, c, d, e, f, g, h, 1.0];
    }
    Some(found)
}

/// The same fit with scale, mirroring and shift alone.
fn upright(pairs: &[([f64; 2], [f64; 2])]) -> Option<Homography> {
    let sign = |axis: usize| pairs.iter().map(|(from, to)| from[axis] * to[axis]).sum::<f64>().signum();
    let (mirror_x, mirror_y) = (sign(0), sign(1));
    let rows =
        pairs.iter().flat_map(|&([x, y], [u, v])| [([mirror_x * x, 1.0, 0.0], u), ([mirror_y * y, 0.0, 1.0], v)]);
    let [scale, x, y] = least_squares(rows)?;
    Some([mirror_x * scale, 0.0, x, 0.0, mirror_y * scale, y, 0.0, 0.0, 1.0])
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEYSTONE: [f64; 8] = [-0.9, 0.03, 0.02, -0.03, 0.91, -0.05, 0.02, -0.01];

    #[test]
    fn the_camera_s_place_is_taken_away_and_the_distortion_is_left() {
        let seen = |distortion| PictureWarp { homography: KEYSTONE, distortion };
        let mut picture = Picture { green: Some(seen([0.0, 0.0])), ..Picture::default() };
        let map = picture.map(Color::Blue, [30, 40]).unwrap();
        for at in [[0.0, 0.0], [0.9, -0.7], [-1.0, 0.75]] {
            let there = map.forth(at);
            assert!((there[0] - at[0]).hypot(there[1] - at[1]) < 1e-9, "{at:?}: {there:?}");
        }
        // The blue picture is at another place than the green one, and both are distorted.
        picture.green = Some(seen([0.05, -0.01]));
        picture.blue = Some(PictureWarp { homography: KEYSTONE.map(|v| v * 1.01), distortion: [0.06, -0.01] });
        picture.check([30, 40]).unwrap();
        let [green, blue] = [Color::Green, Color::Blue].map(|c| picture.map(c, [30, 40]).unwrap());
        for at in [[0.3, 0.1], [0.9, -0.7], [-1.0, 0.75]] {
            for map in [green, blue] {
                let back = map.back(map.forth(at));
                assert!((back[0] - at[0]).hypot(back[1] - at[1]) < 1e-12, "{at:?}: {back:?}");
            }
            let ([x, y], [u, v]) = (green.forth(at), blue.forth(at));
            let apart = (x - u).hypot(y - v);
            assert!(apart > 1e-3 && apart < 0.05, "{apart}");
        }
        let corner = green.forth([1.0, 0.75]);
        assert!((corner[0] - 1.0).hypot(corner[1] - 0.75) > 2e-3, "{corner:?}");
    }

    #[test]
    fn keystone_stays_where_the_camera_looked_straight() {
        let green = Some(PictureWarp { homography: KEYSTONE, distortion: [0.0, 0.0] });
        let map = Picture { straight: true, green, ..Picture::default() }.map(Color::Green, [40, 40]).unwrap();
        let moved = map.forth([1.0, 1.0]);
        assert!((moved[0] - 1.0).hypot(moved[1] - 1.0) > 0.02, "{moved:?}");
        let folded =
            Some(PictureWarp { homography: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], distortion: [-1.0, 0.0] });
        assert!(Picture { green: folded, ..Picture::default() }.check([40, 40]).unwrap_err().code() == "picture-folds");
    }
}
