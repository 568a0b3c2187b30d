//! Reads focal stacks, which are pictures through one aperture with different focus.
//!
//! The image that an eye sees is not a mean of neighboring pictures, because its pupil has another size and position.
//! Layers that explain all pictures (OPTICS 14) give the scene from any place within the aperture. The views are then
//! used as in any light field.

use crate::formats::picture;
use crate::formats::tone::Reading;
use crate::light_field::light::FullScale;
use crate::read::pictures::Pictures;
use crate::read::views::{Frame, Read};
use crate::synthesis::layers::{Layers, Stack};
use crate::{Order, OrderFound, Parallax, Request, SceneError, ViewGrid};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Smallest and largest number of views along an axis.
const VIEWS: [usize; 2] = [3, 9];
/// Lowest accuracy of the layers for a picture that is left out, dB.
const ENOUGH: f64 = 30.0;

/// A focal stack in a folder.
pub(crate) struct FocalStack {
    pub pictures: Pictures,
    /// The depth at which each picture is focused, and the diameter of the aperture, in meters.
    pub focus: Vec<f64>,
    pub aperture: f64,
}

impl FocalStack {
    /// Reads the pictures and makes views from them.
    pub fn read(&self, folder: &Path, request: &Request) -> Result<Read, SceneError> {
        let (own, display) = (self.pictures.size()?, request.display);
        let Pictures { stated, paths, .. } = &self.pictures;
        let frame = Frame::new(own, VIEWS[1] * VIEWS[1] + paths.len(), request)?;
        let reading = Reading::new(stated.tone);
        let read = |path: &PathBuf| Ok(frame.fit(picture::read(path, picture::ONE, request.colors, &reading)?.planes));
        let pictures = paths.par_iter().map(read).collect::<Result<Vec<_>, SceneError>>()?;
        reading.judge(folder, FullScale::Folder)?;
        let count = pictures.len();
        // The pictures form a row of views, so that depths are in the scale of the display.
        let field = frame.field(folder, [1, count], pictures, request, stated, None);
        let focus = self.focus.iter().map(|z| frame.scale([*z; 2])[0]).collect();
        let stack = Stack { focus, aperture: self.aperture };
        let ends = stack.focus.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], z| [a.min(*z), b.max(*z)]);
        let depth = field.depth.unwrap_or(ends);
        let layers = Layers::of_stack(&field, &stack, display, depth)?;
        let span = self.aperture.min(display.eyebox_min());
        let moved = span * (depth[1] - depth[0]) / (display.focal_length * display.picture_pixel());
        let n = (moved.ceil() as usize).clamp(VIEWS[0], VIEWS[1]);
        let grid = ViewGrid { rows: n, columns: n, cell: span / n as f64 };
        let places: Vec<(f64, f64)> = (0..n * n).map(|view| grid.position(view)).collect();
        let planes = (0..request.colors.len()).map(|color| layers.views(color, &places)).collect();
        let left_out = layers.residual().into_iter().fold(f64::INFINITY, f64::min);
        if left_out < ENOUGH {
            tracing::warn!(
                "{}: the layers predict a picture that is left out with {left_out:.1} dB only. Check aperture_mm and \
                 focus_mm, and align the pictures",
                folder.display()
            );
        }
        let how = format!(
            "a focal stack of {count} pictures through {:.4} mm, from which {} Fourier disparity layers make views. \
             They predict a picture that is left out with {left_out:.1} dB",
            self.aperture * 1e3,
            layers.count()
        );
        let field = field.with_made(grid, planes, depth);
        let parallax = Parallax::of(&field);
        let transfer = self.pictures.transfer();
        let (order, order_found) = (Order::default(), OrderFound::AsNamed);
        Ok(Read { field, how, order, order_stated: true, order_found, parallax, cameras: None, size: own, transfer })
    }
}
