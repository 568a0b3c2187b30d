//! What should be seen from a region: views of the scene from around it, no larger and no more than the region needs.

use super::VastError;
use crate::optics::{Color, Display};
use crate::plan;
use crate::scene::{self, LightField, Pyramid, Request, Stage, ViewGrid, shrink_to_share};
use rayon::prelude::*;
use std::sync::Arc;

/// Most views around a region, both axes together.
pub(super) const MOST_VIEWS: usize = 81;
/// Pixels that content may move between neighbouring views before there are more of them.
const APART: f64 = 1.5;

/// A scene in one colour of a far-field display, seen from wherever it is asked for.
pub struct Views {
    kind: Kind,
    share: f64,
    size: usize,
    depth: Option<[f64; 2]>,
}

enum Kind {
    /// Rendered from around each region: parallax over the whole eyebox is exact.
    Stage(Stage),
    /// A light field of its own, at the picture's size.
    Field(Arc<Pyramid>, ViewGrid),
}

impl Views {
    /// `source` as [`scene::load`] takes it, in pictures of `size` x `size` pixels: the field of view of the display's
    /// shortest wavelength.
    ///
    /// # Errors
    /// Those of loading the scene.
    pub fn new(source: &str, request: &Request, color: Color, size: usize) -> Result<Self, VastError> {
        let display = request.display;
        let share = display.picture_share(display.optics(color)?.wavelength);
        if let Some(name) = source.strip_prefix("builtin:") {
            let stage = Stage::new(name, display, color, size)?;
            let depth = Some(stage.depth());
            return Ok(Self { kind: Kind::Stage(stage), share, size, depth });
        }
        let small = small(display, size);
        let field = scene::load(source, &Request { display: &small, colors: &[color], ..*request })?;
        let depth = field.depth_range(&small);
        let grid = ViewGrid { rows: field.grid[0], columns: field.grid[1], cell: field.cell(&small) };
        Ok(Self { kind: Kind::Field(Arc::new(pyramid(&first_color(field), size, share)), grid), share, size, depth })
    }

    /// Pixels along each axis of a picture.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Share of the field of view that the picture takes (OPTICS 9).
    pub fn share(&self) -> f64 {
        self.share
    }

    /// Farthest and nearest depth, metres, where it is known.
    pub fn depth(&self) -> Option<[f64; 2]> {
        self.depth
    }

    /// What is seen from a square of `extent` metres around `center` (x, y): the views, and where they stand.
    pub fn around(&self, center: [f64; 2], extent: f64) -> (Arc<Pyramid>, plan::Views) {
        match &self.kind {
            Kind::Field(pyramid, grid) => (Arc::clone(pyramid), plan::Views::new(*grid, pyramid)),
            Kind::Stage(stage) => {
                let most = (MOST_VIEWS as f64).sqrt() as usize;
                // An odd number: one of them stands in the middle.
                let wanted = (stage.parallax(extent) / APART).ceil() as usize | 1;
                let n = wanted.clamp(3, most);
                let grid = ViewGrid { rows: n, columns: n, cell: extent / n as f64 };
                let place = |i| {
                    let (x, y) = grid.position(i);
                    (x + center[0], y + center[1])
                };
                let views = stage.views(&(0..n * n).map(place).collect::<Vec<_>>());
                let pyramid = Arc::new(pyramid(&views, self.size, self.share));
                let views = plan::Views { center, ..plan::Views::new(grid, &pyramid) };
                (pyramid, views)
            }
        }
    }
}

/// The same eyebox and field of view in fewer, larger pixels: what a scene is loaded for.
fn small(display: &Display, size: usize) -> Display {
    let rate = size as f64 / display.picture_size().0 as f64;
    // Eyebox: pixels times pitch; field of view: wavelength times f over pitch. Both stay, and so does what a depth means,
    // for that is said in the picture's pixels.
    let pitch = display.pitch / rate;
    let (focal_length, shortest) = (display.focal_length, 1.0 / rate);
    let wavelengths = (display.wavelengths.iter())
        .map(|w| crate::optics::Wavelength { wavelength: w.wavelength * shortest, ..*w })
        .collect();
    Display { height: size, width: size, pitch, focal_length, wavelengths, ..display.clone() }
}

fn first_color(mut field: LightField) -> Vec<Vec<f32>> {
    field.planes.swap_remove(0)
}

fn pyramid(views: &[Vec<f32>], size: usize, share: f64) -> Pyramid {
    if share >= 1.0 {
        return Pyramid::new(views, size, size);
    }
    let shrunk: Vec<Vec<f32>> = views.par_iter().map(|v| shrink_to_share(v, size, size, share)).collect();
    Pyramid::new(&shrunk, size, size)
}
