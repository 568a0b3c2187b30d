//! Reads focal stacks, which are pictures through one aperture with different focus.
//!
//! The image that an eye sees is not a mean of neighboring pictures, because its pupil has another size and position.
//! Layers that explain all pictures (OPTICS 14) give the scene from any place within the aperture. The views are then
//! used as in any light field.

use crate::formats::tone::Reading;
use crate::light_field::light::FullScale;
use crate::read::settings::{self, Settings};
use crate::read::views::{Frame, Read};
use crate::synthesis::layers::{Layers, Stack};
use crate::{Order, OrderFound, Parallax, Request, SceneError, ViewGrid};
use crate::{formats::picture, light_field::natural, read::names};
use eyebox_base::error::Reason;
use eyebox_base::files::holds_light;
use eyebox_base::reason;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Smallest and largest number of views along an axis.
const VIEWS: [usize; 2] = [3, 9];
/// Lowest accuracy of the layers for a picture that is left out, dB.
const ENOUGH: f64 = 30.0;

/// A folder whose settings state a focal stack.
pub(crate) struct Found {
    stated: Settings,
    /// The pictures in the order of their numbers.
    paths: Vec<PathBuf>,
    /// The depth at which each picture is focused, and the diameter of the aperture, in meters.
    focus: Vec<f64>,
    aperture: f64,
}

/// Returns the focal stack that a folder states. It returns `None` if the folder states none.
///
/// # Errors
/// [`SceneError::Settings`] if the numbers of distances and pictures differ, or if nothing states the aperture.
pub(crate) fn find(folder: &Path) -> Result<Option<Found>, SceneError> {
    const NAME: &str = "lightfield.toml";
    let file = folder.join(NAME);
    if !file.exists() {
        return Ok(None);
    }
    let stated = settings::read(folder, &[NAME.into()])?;
    let wrong = |reason: Reason| Err(SceneError::Settings { file: file.display().to_string(), reason });
    let (focus, aperture) = match (&stated.focus, stated.aperture) {
        (None, None) => return Ok(None),
        (Some(focus), Some(aperture)) => (focus.clone(), aperture),
        (Some(_), None) => {
            return wrong(reason!(
                "focus-without-aperture",
                "focus_mm needs aperture_mm, the diameter of the pupil that saw the pictures, as in aperture_mm = 12"
            ));
        }
        (None, Some(_)) => {
            return wrong(reason!(
                "aperture-without-focus",
                "aperture_mm needs focus_mm, the depth at which each picture is sharp, as in focus_mm = [-3, 0, 3]"
            ));
        }
    };
    let is_one = |name: &String| match &stated.files {
        Some(files) => names::matches(files, name),
        None => !names::is_auxiliary(name),
    };
    let mut pictures = natural::files(folder)?;
    pictures.retain(|name| natural::is_picture(name) && is_one(name));
    if pictures.len() != focus.len() {
        return wrong(reason!(
            "focus-count",
            "focus_mm has {} depths, but the folder has {} pictures. Give one for each, in the order of the numbers \
             in their names",
            focus.len(),
            pictures.len()
        ));
    }
    let paths = pictures.into_iter().map(|name| folder.join(name)).collect();
    Ok(Some(Found { stated, paths, focus, aperture }))
}

impl Found {
    /// Returns the files of the stack, with its settings file first.
    pub fn into_files(self, settings: PathBuf) -> Vec<PathBuf> {
        [settings].into_iter().chain(self.paths).collect()
    }

    /// Returns rows and columns of the pictures, which have one size.
    pub fn size(&self) -> Result<[usize; 2], SceneError> {
        picture::size_of_all(&self.paths, |first| first.display().to_string())
    }

    /// Reads the pictures and makes views from them.
    pub fn read(&self, folder: &Path, request: &Request) -> Result<Read, SceneError> {
        let (own, display) = (self.size()?, request.display);
        let frame = Frame::new(own, VIEWS[1] * VIEWS[1] + self.paths.len(), request)?;
        let reading = Reading::new(self.stated.tone);
        let read = |path: &PathBuf| Ok(frame.fit(picture::read(path, picture::ONE, request.colors, &reading)?.planes));
        let pictures = self.paths.par_iter().map(read).collect::<Result<Vec<_>, SceneError>>()?;
        reading.judge(folder, FullScale::Folder)?;
        let count = pictures.len();
        // The pictures form a row of views, so that depths are in the scale of the display.
        let field = frame.field(folder, [1, count], pictures, request, &self.stated, None);
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
        let transfer = holds_light(&self.paths[0]).map_or("sRGB".into(), |kind| format!("linear ({kind})"));
        let transfer = self.stated.tone.transfer.map_or(transfer, |_| "as stated".into());
        let (order, order_found) = (Order::default(), OrderFound::AsNamed);
        Ok(Read { field, how, order, order_stated: true, order_found, parallax, cameras: None, size: own, transfer })
    }
}
