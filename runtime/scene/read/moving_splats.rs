//! Makes views of splats for a camera that moves while they are shown.

use crate::light_field::field::by_color;
use crate::read::splats::{Placed, SplatViews, format_of};
use crate::splats::camera::Camera;
use crate::splats::cloud::{Cloud, NumberedCloud};
use crate::splats::format::read;
use crate::splats::path::CameraPath;
use crate::splats::picture::tiled;
use crate::splats::project::{Displaced, Ordered, args_of, may_be_seen, order};
use crate::{Request, SceneError, StoredSplats};
use eyebox_base::memory;
use eyebox_kernels::project_splats::Args;
use eyebox_optics::Color;
use rayon::prelude::*;

/// Splats in front of a display, seen by a camera that moves.
///
/// The picture of the camera at the start determines the depths of distances, so that content does not change its depth
/// because other content comes into the picture.
pub struct MovingSplats {
    name: String,
    read_as: String,
    cloud: NumberedCloud,
    start: Camera,
    placed: Placed,
    size: [usize; 2],
}

impl MovingSplats {
    /// Reads a file of splats with its options after the question mark, which place the camera at the start.
    ///
    /// # Errors
    /// The errors of [`SplatViews::new`].
    pub fn new(source: &str, request: &Request) -> Result<Self, SceneError> {
        request.check()?;
        let (format, options) = format_of(source)?;
        let path = crate::formats::options::parts(source).0;
        let cloud = read(path, format)?;
        let (start, _) = Camera::of(path, &options, &cloud)?;
        let what = || format!("{} splats for a camera that moves", cloud.len());
        let bytes = cloud.len() as u64 * Cloud::bytes_of_one(cloud.degree);
        memory::check_available(what, bytes, "take a scene with fewer splats")?;
        // Views are made at the requested places, so none are too far apart.
        let request = Request { more_views: false, ..*request };
        let views = SplatViews::of_cloud(source, (format, &options), &request, cloud.clone(), |views| views / 2.0)?;
        let SplatViews { name, read_as, placed, .. } = views;
        let (height, width) = request.display.picture_size();
        Ok(Self { name, read_as, cloud: NumberedCloud::new(cloud), start, placed, size: [height, width] })
    }

    /// Returns the name of the scene.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Describes the splats and their first camera in words.
    pub fn read_as(&self) -> &str {
        &self.read_as
    }

    /// Returns the splats for a device, in the axes of the scene.
    pub fn stored(&self) -> &dyn StoredSplats {
        &self.cloud
    }

    /// Returns the farthest and the nearest depth in meters, as the first camera sees them.
    pub fn depth(&self) -> [f64; 2] {
        self.placed.depth
    }

    /// Returns the camera at the start.
    pub fn camera(&self) -> Camera {
        self.start
    }

    /// Returns the distance that is in the middle of the depths, in units of the scene.
    pub fn distance(&self) -> f64 {
        2.0 / (self.placed.inverse[0] + self.placed.inverse[1])
    }

    /// Returns the built-in path, around the point in the middle of the first picture.
    pub fn around(&self) -> CameraPath {
        CameraPath::Around { start: self.start, distance: self.distance() }
    }

    /// Returns views of a camera from these places (x, y) of the pupil plane in meters, as (color, view, pixel).
    pub fn views(&self, camera: &Camera, colors: &[Color], places: &[(f64, f64)]) -> Vec<Vec<Vec<f32>>> {
        let splats = Ordered::of(&self.cloud, camera, self.size);
        let one = |place: &(f64, f64)| self.placed.view(&splats, *place, colors, None);
        let views: Vec<Vec<Vec<f32>>> = places.par_iter().map(one).collect();
        by_color(views, colors.len())
    }

    /// Returns the indices of the splats that may be in a picture of a camera, with the nearest first. The other value is
    /// the arguments of the kernel `project_splats` for views from these places (x, y) of the pupil plane in meters.
    pub fn cameras(&self, camera: &Camera, places: &[(f64, f64)]) -> (Vec<u32>, Vec<Args>) {
        let seen: Vec<[f32; 3]> = self.cloud.places.par_iter().map(|place| camera.seen(*place)).collect();
        let all: Vec<_> = places.iter().map(|place| self.placed.displaced(*place)).collect();
        let farthest = |of: fn(&Displaced) -> [f32; 2]| {
            [0, 1].map(|i| all.iter().fold(0.0, |far: f32, displaced| far.max(of(displaced)[i].abs())))
        };
        let reach = [farthest(|displaced| displaced.by), farthest(|displaced| displaced.moved)];
        let args = args_of(&self.cloud, camera, self.size);
        let order = order(&seen, |at| may_be_seen(&args, reach, seen[at], &self.cloud.spreads[at]));
        let args = Args { count: order.len() as u32, ..args };
        let one = |displaced: Displaced| Args { by: displaced.by, moved: displaced.moved, ..args };
        (order, all.into_iter().map(one).collect())
    }

    /// Returns the number of pairs of a splat and a tile of a picture that it touches, in all views from these places.
    pub fn entries(&self, camera: &Camera, places: &[(f64, f64)]) -> u64 {
        let splats = Ordered::of(&self.cloud, camera, self.size);
        let of = |place: &(f64, f64)| tiled(&splats, &self.placed.displaced(*place)).entries.len() as u64;
        places.par_iter().map(of).sum()
    }
}
