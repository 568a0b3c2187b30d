//! Renders a built-in scene from anywhere in the eyebox, a few views at a time.
//!
//! This is for an eyebox that is so wide that views of all of it would be too many or too far apart.

use super::render::{Canvas, Item, Skins};
use super::{depths, items_of, parse};
use crate::SceneError;
use eyebox_optics::{Color, Display};
use rayon::prelude::*;

/// A built-in scene in one color and at a size of its own, prepared for rendering.
pub struct Stage {
    canvas: Canvas,
    items: Vec<Item>,
    skins: Skins<2>,
    channel: usize,
    /// Tilt per meter of the pupil plane.
    tilt: f64,
    /// Position of the middle of the eyebox, in meters to the right.
    camera: f64,
    depth: [f64; 2],
}

impl Stage {
    /// Prepares a scene. `source` is the name after `builtin:`. Pictures have `size` x `size` pixels for any size of
    /// the display (pictures of the far field are square).
    ///
    /// # Errors
    /// [`SceneError::Builtin`] for an unknown scene or parameter.
    pub fn new(source: &str, display: &Display, color: Color, size: usize) -> Result<Self, SceneError> {
        let (name, parameters) = parse(source)?;
        let canvas = Canvas { height: size, width: size };
        let unit = parameters.unit(name, display);
        let items = items_of(name, &parameters, canvas, unit);
        // One meter to the side moves content at one unit of depth by unit / f, and the picture is two units wide.
        let wide = display.picture_pixel() * display.picture_size().0 as f64;
        let tilt = 2.0 * unit / (display.focal_length * wide);
        let most = (tilt * (display.eyebox_min() / 2.0 + parameters.camera.abs())) as f32;
        let skins = Skins::bake(canvas, &items, most, &[color.channel()]);
        let depth = depths(&items, canvas).map(|z| f64::from(z) * unit);
        Ok(Self { canvas, items, skins, channel: color.channel(), tilt, camera: parameters.camera, depth })
    }

    /// Returns the pixels along each axis.
    pub fn size(&self) -> usize {
        self.canvas.height
    }

    /// Returns the farthest and the nearest depth in meters.
    pub fn depth(&self) -> [f64; 2] {
        self.depth
    }

    /// Returns the pixels by which content at the ends of the depth span moves over `metres` meters of the pupil plane.
    pub fn parallax(&self, metres: f64) -> f64 {
        metres * self.tilt / f64::from(self.canvas.pixel())
    }

    /// Returns views from these places (x, y) of the pupil plane in meters.
    pub fn views(&self, places: &[(f64, f64)]) -> Vec<Vec<f32>> {
        let one = |&(x, y): &(f64, f64)| {
            let tilt = [x + self.camera, y].map(|s| (s * self.tilt) as f32);
            self.skins.view(self.canvas, &self.items, tilt, &[self.channel]).swap_remove(0)
        };
        places.par_iter().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Request, ViewGrid, load};

    /// The stage renders the light field's own views at their places, also with a displaced camera.
    #[test]
    fn views_are_those_of_the_light_field() {
        ["still-life", "still-life?camera=0.5"].into_iter().for_each(views_are_those_of);
    }

    fn views_are_those_of(source: &str) {
        let display = Display { height: 64, width: 64, ..Display::preset("far-field").unwrap() };
        let field =
            load(&format!("builtin:{source}"), &Request { views: 3, ..Request::new(&display, &[Color::Green]) })
                .unwrap();
        let grid = ViewGrid { rows: 3, columns: 3, cell: field.cell(&display) };
        let stage = Stage::new(source, &display, Color::Green, 64).unwrap();
        let views = stage.views(&(0..9).map(|i| grid.position(i)).collect::<Vec<_>>());
        let far = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / 4096.0;
        assert!(far(&views[0], &field.planes[0][8]) > 1e-2, "views differ");
        for (one, other) in views.iter().zip(&field.planes[0]) {
            // Textures are made on grids with other origins because margins differ, so edges differ by a part of a
            // pixel.
            let apart = one.iter().zip(other).map(|(a, b)| (a - b).abs()).sum::<f32>() / 4096.0;
            assert!(apart < 4e-3, "{apart}");
        }
        let [far, near] = field.depth.unwrap();
        assert!((stage.depth()[0] - far).abs() < 1e-9 && (stage.depth()[1] - near).abs() < 1e-9);
    }
}
