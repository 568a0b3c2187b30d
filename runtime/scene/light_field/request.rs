//! Defines the request for a scene.

use crate::{Near, Order, SceneError, SplatDrawer, ViewSynthesis};
use eyebox_base::memory;
use eyebox_optics::{Color, Display, check_usual_depth, check_usual_depths, check_usual_view_pitch};
use std::path::Path;
use std::sync::Arc;

/// A request for a scene.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// The display for the scene. It determines the resolution, and the depth of a disparity.
    pub display: &'a Display,
    /// The colors to load.
    pub colors: &'a [Color],
    /// Meters between neighboring views in the pupil plane. It replaces the scene's own statement.
    pub view_pitch: Option<f64>,
    /// Views per axis, for scenes that are rendered or reprojected.
    pub views: usize,
    /// True if a picture with a depth map may have more views than `views`, so that content moves at most one pixel
    /// between neighboring views.
    pub more_views: bool,
    /// The depth or disparity map of a single picture.
    pub depth_map: Option<&'a Path>,
    /// The values of the depth map that are near. `None` takes the meaning from its file.
    pub near: Option<Near>,
    /// The farthest and the nearest depth of a depth map in meters. If the nearer one is first, small values are near.
    /// `None` takes the depths of the built-in scenes.
    pub depth: Option<[f64; 2]>,
    /// The true order of the views of a folder, which replaces the statement of the folder. `None` refuses views whose
    /// pictures clearly contradict the order of their names.
    pub order: Option<Order>,
    /// True accepts a view pitch and depths that look like a mistake in their unit.
    pub force: bool,
    /// The views of a folder from which target images are made. [`ViewSynthesis::Cells`] loads the folder unchanged.
    pub photographs: ViewSynthesis,
    /// Draws the views of splats. The CPU draws them if it is `None`.
    pub drawer: Option<&'a Arc<dyn SplatDrawer>>,
}

impl<'a> Request<'a> {
    /// Returns a request for 9 x 9 views of these colors, and for a folder's own views unchanged, without other
    /// statements.
    pub fn new(display: &'a Display, colors: &'a [Color]) -> Self {
        Self {
            display,
            colors,
            view_pitch: None,
            views: 9,
            more_views: false,
            depth_map: None,
            near: None,
            depth: None,
            order: None,
            force: false,
            photographs: ViewSynthesis::Cells,
            drawer: None,
        }
    }

    /// Refuses depths (meters) that are most likely in another unit.
    pub(crate) fn check_depths(&self, depths: Option<[f64; 2]>) -> Result<(), SceneError> {
        let mut all = depths.into_iter().flatten().filter(|_| !self.force);
        Ok(all.try_for_each(|depth| check_usual_depth(depth, self.display.focal_length))?)
    }

    pub(crate) fn check(&self) -> Result<(), SceneError> {
        let wrong = |what, value: String, must| Err(SceneError::Request { what, value, must });
        if self.colors.is_empty() || (1..self.colors.len()).any(|i| self.colors[..i].contains(&self.colors[i])) {
            return wrong("the list of colors", format!("{:?}", self.colors), "one to three different colors");
        }
        if !(1..=64).contains(&self.views) {
            return wrong("the number of views per axis", self.views.to_string(), "1 to 64");
        }
        if let Some(pitch) = self.view_pitch.filter(|p| !(p.is_finite() && *p > 0.0)) {
            return wrong("the view pitch (mm)", (pitch * 1e3).to_string(), "a positive, finite number");
        }
        if let Some(depth) = self.depth.filter(|[a, b]| !(a.is_finite() && b.is_finite())) {
            return wrong("the depth range (mm)", format!("{:?}", depth.map(|v| v * 1e3)), "two finite numbers");
        }
        if !self.force {
            self.view_pitch.map_or(Ok(()), check_usual_view_pitch)?;
            self.check_depths(self.depth)?;
            self.depth.map_or(Ok(()), check_usual_depths)?;
        }
        let [height, width] = [self.display.height, self.display.width];
        if !(1..=65536).contains(&height) || !(1..=65536).contains(&width) {
            return wrong("the display's size", format!("{height}x{width}"), "1 to 65536 pixels on each axis");
        }
        // Two more copies of one color are in memory, one as levels of detail, and one while these are made.
        let counts = [self.views, self.views, self.colors.len() + 2, height, width];
        let what = || format!("{0} x {0} views of {height} x {width} pixels", self.views);
        Ok(memory::check_available(what, memory::bytes_of(&counts, 4), "take a smaller `size` or fewer `views`")?)
    }
}
