//! Makes views of splats from anywhere in the eyebox.
//!
//! A camera sees the scene as the middle view. Views move this camera to the side by the same share of every depth, so
//! that inverse distances become depths of the display in proportion. All pictures have one plane without parallax
//! (shear projection).

use crate::light_field::field::by_color;
use crate::read::single::{SMALLER, check_parallax, enough_views};
use crate::splats::camera::{Camera, trained_file};
use crate::splats::cloud::Cloud;
use crate::splats::format::{Format, read};
use crate::splats::options::Options;
use crate::splats::picture::{draw, light};
use crate::splats::project::{Displaced, Ordered};
use crate::{LightField, Request, SceneError, SplatDrawer, builtin};
use eyebox_base::memory;
use eyebox_base::reason;
use eyebox_optics::Color;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Pixels of the middle view that count for the range of distances have at least this coverage.
const COVERED: f32 = 0.5;
/// Share of these pixels that is outside of the range on each side. Single splats often float in front of a scene.
const OUTSIDE: f64 = 0.005;

/// Splats in front of a display, for views from anywhere in the eyebox.
pub struct SplatViews {
    pub(crate) name: String,
    pub(crate) read_as: String,
    splats: Ordered,
    pub(crate) placed: Placed,
    drawer: Option<Arc<dyn SplatDrawer>>,
}

/// The views of a camera, and the depths of its picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    /// Number of views along each axis over the eyebox.
    views: usize,
    cell: f64,
    /// Farthest and nearest depth in meters.
    pub depth: [f64; 2],
    /// Inverse distances that have these depths, per unit of the scene.
    pub inverse: [f64; 2],
    /// Pixels by which content at 1 meter moves over 1 meter of the pupil plane.
    per_metre: f64,
    /// Displacement of the camera, and movement of the picture, per meter of the pupil plane.
    camera_per_metre: f64,
    moved_per_metre: f64,
    /// Position of the middle of the views to the right of the camera, in meters of the pupil plane.
    shift: f64,
}

impl Placed {
    /// Places the distances in the middle view, or the stated ones, at the depths of a request.
    fn of(
        path: &Path,
        options: &Options,
        request: &Request,
        splats: &Ordered,
        reach: impl Fn(f64) -> f64,
    ) -> Result<Self, SceneError> {
        let display = request.display;
        let stated = options.range.map(|[near, far]| [1.0 / far, 1.0 / near]);
        let Some([far, near]) = distances(splats).map(|shown| stated.unwrap_or(shown)) else {
            let reason = reason!("nothing-seen", "the camera sees no splats. State it, as in ?eye=X,Y,Z&at=X,Y,Z");
            return Err(SceneError::Options { scene: path.display().to_string(), reason });
        };
        let depth = request.depth.map_or_else(
            || {
                let half = builtin::half_span(display);
                [-half, half]
            },
            |[a, b]| [a.min(b), a.max(b)],
        );
        let views = if request.more_views { enough_views(path, request, depth) } else { request.views };
        let cell = request.view_pitch.unwrap_or_else(|| display.eyebox_min() / views as f64);
        let per_metre = 1.0 / (display.focal_length * display.picture_pixel());
        let displaced = depth[0].abs().max(depth[1].abs()) * per_metre * cell * reach(views as f64);
        let (height, width) = display.picture_size();
        check_parallax(displaced, [height, width], SMALLER)?;
        // A pixel moves by the inverse distance times this number, per meter of the pupil plane.
        let flat = near - far < 1e-4 * near;
        let gain = if flat { 0.0 } else { (depth[1] - depth[0]) * per_metre / (near - far) };
        let first = if flat { (depth[0] + depth[1]) / 2.0 * per_metre } else { depth[0] * per_metre - gain * far };
        let camera_per_metre = gain / f64::from(splats.focal());
        let (inverse, moved_per_metre, shift) = ([far, near], -first, options.shift);
        Ok(Self { views, cell, depth, inverse, per_metre, camera_per_metre, moved_per_metre, shift })
    }

    pub(crate) fn displaced(&self, (x, y): (f64, f64)) -> Displaced {
        let x = x + self.shift;
        Displaced {
            by: [x, y].map(|s| (s * self.camera_per_metre) as f32),
            moved: [x, y].map(|s| (s * self.moved_per_metre) as f32),
        }
    }

    /// Returns the light of a view in these colors, from a place (x, y) of the pupil plane in meters.
    pub fn view(
        &self,
        splats: &Ordered,
        place: (f64, f64),
        colors: &[Color],
        drawer: Option<&Arc<dyn SplatDrawer>>,
    ) -> Vec<Vec<f32>> {
        let drawn = draw(splats, &self.displaced(place), drawer);
        let pixels = drawn.len() / eyebox_kernels::draw_splats::VALUES;
        colors.iter().map(|color| light(&drawn[color.channel() * pixels..][..pixels])).collect()
    }
}

/// Returns the files that a source of splats is read from.
pub(crate) fn files(path: &Path, options: &Options) -> Vec<PathBuf> {
    let stated = options.eye.is_some() || options.at.is_some() || options.up.is_some();
    let cameras = if stated { None } else { trained_file(path) };
    [path.to_path_buf()].into_iter().chain(cameras).collect()
}

impl SplatViews {
    /// Reads a file of splats with its options after the question mark, for views at any place.
    ///
    /// # Errors
    /// [`SceneError::Corrupt`] for a file that is not valid. [`SceneError::Options`] if the camera sees nothing.
    /// [`SceneError::Request`] if the depths displace content too far. [`SceneError::Memory`].
    pub fn new(source: &str, request: &Request) -> Result<Self, SceneError> {
        request.check()?;
        let (format, options) = format_of(source)?;
        // Views are made at the requested places, so none are too far apart.
        let request = Request { more_views: false, ..*request };
        let cloud = read(crate::formats::options::parts(source).0, format)?;
        Self::of_cloud(source, (format, &options), &request, cloud, |views| views / 2.0)
    }

    /// Places splats before a display. `reach` has the number of pitches to the outermost view, of a number of views.
    pub(crate) fn of_cloud(
        source: &str,
        (format, options): (Format, &Options),
        request: &Request,
        cloud: Cloud,
        reach: impl Fn(f64) -> f64,
    ) -> Result<Self, SceneError> {
        let path = crate::formats::options::parts(source).0;
        let (count, degree) = (cloud.len(), cloud.degree);
        let (camera, how) = Camera::of(path, options, &cloud)?;
        let (height, width) = request.display.picture_size();
        let splats = Ordered::new(cloud, &camera, [height, width]);
        let [_, of_view] = splats.bytes();
        let bytes = of_view.saturating_mul(rayon::current_num_threads() as u64);
        memory::check_available(|| format!("views of {count} splats"), bytes, "take a scene with fewer splats")?;
        let placed = Placed::of(path, options, request, &splats, reach)?;
        let [x, y, z] = camera.place;
        let forward = camera.axes[2];
        let degrees = camera.field.to_degrees();
        let [far, near] = placed.inverse;
        let read_as = format!(
            "{} of {count} splats of degree {degree}, {degrees:.1} degrees from ({x:.3}, {y:.3}, {z:.3}) towards ({:.3}, {:.3}, {:.3}), {how}, \
             distances {:.3} to {:.3}",
            format.name(),
            forward[0],
            forward[1],
            forward[2],
            1.0 / near,
            1.0 / far.max(1e-9),
        );
        Ok(Self { name: name_of(source, format), read_as, splats, placed, drawer: request.drawer.cloned() })
    }

    /// Describes the splats and their camera in words.
    pub fn read_as(&self) -> &str {
        &self.read_as
    }

    /// Returns the farthest and the nearest depth in meters.
    pub fn depth(&self) -> [f64; 2] {
        self.placed.depth
    }

    /// Returns the pixels by which content at an end of the depths moves over `metres` meters of the pupil plane.
    pub fn parallax(&self, metres: f64) -> f64 {
        metres * self.placed.per_metre * self.placed.depth[0].abs().max(self.placed.depth[1].abs())
    }

    /// Returns the bytes of memory in use.
    pub fn bytes(&self) -> u64 {
        self.splats.bytes()[0]
    }

    /// Returns the light of a view in these colors.
    fn view(&self, place: (f64, f64), colors: &[Color]) -> Vec<Vec<f32>> {
        self.placed.view(&self.splats, place, colors, self.drawer.as_ref())
    }

    /// Returns views in one color from these places (x, y) of the pupil plane in meters, as (row, column) of the
    /// display's picture.
    pub fn views(&self, color: Color, places: &[(f64, f64)]) -> Vec<Vec<f32>> {
        places.par_iter().map(|place| self.view(*place, &[color]).swap_remove(0)).collect()
    }
}

/// Returns the format and the options of a source of splats.
pub(crate) fn format_of(source: &str) -> Result<(Format, Options), SceneError> {
    let (path, query) = crate::formats::options::parts(source);
    let wrong = |reason| SceneError::Options { scene: source.into(), reason };
    let format =
        Format::of(path).ok_or_else(|| wrong(reason!("not-splats", "it is no .ply, .splat or .spz file of splats")))?;
    Ok((format, format.options(query).map_err(wrong)?))
}

/// Returns the name of the scene of a source.
fn name_of(source: &str, format: Format) -> String {
    match crate::formats::options::parts(source).0.file_name() {
        Some(name) if format != Format::BuiltIn => name.to_string_lossy().into_owned(),
        _ => source.to_owned(),
    }
}

/// Returns the smallest and the largest inverse distance in the middle view. It returns `None` if the picture is empty.
fn distances(splats: &Ordered) -> Option<[f64; 2]> {
    let drawn = draw(splats, &Displaced::default(), None);
    let pixels = drawn.len() / eyebox_kernels::draw_splats::VALUES;
    let (inverse, coverage) = (&drawn[3 * pixels..4 * pixels], &drawn[4 * pixels..]);
    let seen = inverse.iter().zip(coverage).filter(|(_, coverage)| **coverage > COVERED);
    let mut values: Vec<f32> = seen.map(|(inverse, coverage)| inverse / coverage).collect();
    values.sort_unstable_by(f32::total_cmp);
    let outside = (OUTSIDE * values.len() as f64) as usize;
    let far = values.get(outside)?;
    let near = values.get(values.len() - 1 - outside)?;
    Some([f64::from(*far), f64::from(*near)])
}

/// Reads splats and renders `views` x `views` views at the size of the display.
pub(crate) fn load(
    source: &str,
    format: Format,
    options: &Options,
    request: &Request,
) -> Result<(LightField, String), SceneError> {
    let cloud = read(crate::formats::options::parts(source).0, format)?;
    let from = SplatViews::of_cloud(source, (format, options), request, cloud, |views| (views - 1.0) / 2.0)?;
    let Placed { views: n, cell, depth, per_metre, .. } = from.placed;
    let middle = (n as f64 - 1.0) / 2.0;
    let place = |k: usize| ((k % n) as f64 - middle, (k / n) as f64 - middle);
    let views: Vec<Vec<Vec<f32>>> = (0..n * n)
        .into_par_iter()
        .map(|k| {
            let (x, y) = place(k);
            from.view((x * cell, y * cell), request.colors)
        })
        .collect();
    let (height, width) = request.display.picture_size();
    let field = LightField {
        name: from.name,
        grid: [n, n],
        height,
        width,
        colors: request.colors.to_vec(),
        planes: by_color(views, request.colors.len()),
        view_pitch: Some(cell),
        disparity: Some(depth.map(|z| z * per_metre * cell)),
        depth: Some(depth),
        made: None,
    };
    Ok((field, from.read_as))
}
