//! Reprojects a single picture with a depth or disparity map.

use crate::{
    Fit, LightField, Near, Request, SceneError, builtin,
    depth::map::{self, Map},
    formats::options::{Options, parts},
    formats::still,
    formats::video,
    light_field::field::by_color,
    light_field::near::{Meaning, Stated},
    light_field::resize::Resize,
    synthesis::reproject::{Relief, relief},
};
use eyebox_base::memory;
use eyebox_base::reason;
use eyebox_optics::{Color, Display};
use rayon::prelude::*;
use std::path::Path;

/// A picture with its depths in front of a display, for views from anywhere in the eyebox.
pub struct Reprojection {
    name: String,
    /// The meaning of the values of the picture and of its map, in words.
    read_as: [String; 2],
    relief: Relief,
    /// Adds the letterbox around a finished view.
    place: Resize,
    size: [usize; 2],
    /// Number of views along each axis over the eyebox.
    views: usize,
    cell: f64,
    /// Position of the middle of the views, in cells to the right.
    camera: f64,
    /// Smallest and largest disparity, in pixels from one cell to the next.
    ends: [f64; 2],
    per_pixel: f64,
}

impl Reprojection {
    /// Reads the picture and its map ([`Request::depth_map`]) and scales them to the size of the display.
    ///
    /// # Errors
    /// [`SceneError::NoDepthMap`] and [`SceneError::Ambiguous`]. [`SceneError::Size`] if the map and the picture have
    /// different sizes. [`SceneError::Request`] if the depths displace content too far. The errors of reading the
    /// files.
    pub fn new(path: &Path, request: &Request) -> Result<Self, SceneError> {
        request.check()?;
        // Views are made at the requested places, so none are too far apart.
        Self::with_reach(path, &Request { more_views: false, ..*request }, |views| views / 2.0)
    }

    /// Prepares the picture for views at most `reach` cells from the middle, as a function of the number of views.
    fn with_reach(path: &Path, request: &Request, reach: impl Fn(f64) -> f64) -> Result<Self, SceneError> {
        let within = still::map_in(path);
        let map_path = match (request.depth_map, within.as_deref()) {
            (Some(map), None) | (None, Some(map)) => map,
            (None, None) => return Err(SceneError::NoDepthMap { file: path.display().to_string() }),
            (Some(map), Some(_)) => {
                let reason = reason!(
                    "two-maps",
                    "it has its depths in one half, and {} is another depth map. Leave out one",
                    map.display()
                );
                return Err(SceneError::Options { scene: path.display().to_string(), reason });
            }
        };
        let reversed = request.depth.is_some_and(|[a, b]| a > b);
        if reversed && request.near.is_some_and(Near::is_larger) {
            return Err(SceneError::Request {
                what: "the depth range (mm)",
                value: format!("{:?}, nearest first", request.depth.unwrap_or_default().map(|z| z * 1e3)),
                must: "farthest first if large or bright values are near",
            });
        }
        let map = map::read(map_path, Stated { near: request.near, depth: request.depth })?;
        let picture = still::read(path, &[Color::Red, Color::Green, Color::Blue])?;
        if (map.height, map.width) != (picture.height, picture.width) {
            let orientation = still::orientation(path)?;
            if orientation > 1 && (map.height, map.width) == (picture.width, picture.height) {
                return Err(SceneError::Turned {
                    file: map_path.display().to_string(),
                    height: map.height,
                    width: map.width,
                    other: path.display().to_string(),
                    orientation,
                });
            }
            let sizes = ([map.height, map.width], [picture.height, picture.width]);
            return Err(SceneError::size(map_path, sizes.0, path.display().to_string(), sizes.1));
        }
        if map.is_news {
            tracing::info!("{}: {}", map_path.display(), map.read_as);
        }
        let camera = camera_of(path)?;
        let display = request.display;
        // The picture has its size on the display without the letterbox, which is added around the finished views.
        let (rows, columns) = display.picture_size();
        let scale = (rows as f64 / map.height as f64).min(columns as f64 / map.width as f64);
        let [height, width] = [map.height, map.width].map(|n| ((n as f64 * scale).round() as usize).max(1));
        let resize = Resize::new([map.height, map.width], [height, width], Fit::Stretch);
        let planes: Vec<Vec<f32>> = picture.planes.par_iter().map(|plane| resize.apply(plane)).collect();
        let range = request.depth.map_or_else(
            || {
                // Views from the side see as much parallax as views from the middle, so that eyes fuse the pictures.
                let half = builtin::half_span(display).min(largest_span(display, camera));
                [-half, half]
            },
            |[a, b]| [a.min(b), a.max(b)],
        );
        let views = match map.meaning {
            Meaning::Relative(_) if request.more_views => enough_views(path, request, range),
            _ => request.views,
        };
        let cell = request.view_pitch.unwrap_or_else(|| display.eyebox_min() / views as f64);
        let reach = reach(views as f64) + camera.abs() / cell;
        let (disparity, ends) = disparities(&map, [height, width], scale, reach, range, cell, display);
        let must = match map.meaning {
            Meaning::Disparity => {
                "at most a quarter of the picture. Disparities of cameras that are far apart need the depth range that \
                 they are scaled to, as in `depth`=-3..3"
            }
            Meaning::Relative(_) => SMALLER,
        };
        check_parallax(ends[0].abs().max(ends[1].abs()) * reach, [height, width], must)?;
        let size = [height, width];
        Ok(Self {
            read_as: [picture.read_as, map.read_as],
            name: path.file_stem().map_or("picture".into(), |n| n.to_string_lossy().into_owned()),
            relief: relief(&planes, &disparity, size, reach as f32),
            place: Resize::new(size, [rows, columns], Fit::Contain),
            size: [rows, columns],
            views,
            cell,
            camera: camera / cell,
            ends,
            per_pixel: display.focal_length * display.picture_pixel() / cell,
        })
    }

    /// Returns the meaning of the values of the picture and of its map, in words.
    pub fn read_as(&self) -> &[String; 2] {
        &self.read_as
    }

    /// Returns the pixels by which content at an end of the depths moves over `metres` meters of the pupil plane.
    pub fn parallax(&self, metres: f64) -> f64 {
        metres / self.cell * self.ends[0].abs().max(self.ends[1].abs())
    }

    /// Returns the farthest and the nearest depth in meters.
    pub fn depth(&self) -> [f64; 2] {
        self.ends.map(|d| d * self.per_pixel)
    }

    /// Returns the bytes of memory in use.
    pub fn bytes(&self) -> u64 {
        self.relief.bytes()
    }

    /// Returns views in one color from these places (x, y) of the pupil plane in meters, as (row, column) of the
    /// display's picture.
    pub fn views(&self, color: Color, places: &[(f64, f64)]) -> Vec<Vec<f32>> {
        let one = |&(x, y): &(f64, f64)| {
            let view = self.relief.view((x / self.cell + self.camera) as f32, (y / self.cell) as f32);
            self.place.apply(&view[color.channel()])
        };
        places.par_iter().map(one).collect()
    }
}

/// Reads the picture and its map and reprojects it to `views` x `views` views at the size of the display.
pub(crate) fn load(path: &Path, request: &Request) -> Result<LightField, SceneError> {
    let from = Reprojection::with_reach(path, request, |views| (views - 1.0) / 2.0)?;
    let n = from.views;
    let middle = (n as f32 - 1.0) / 2.0;
    let camera = from.camera as f32;
    let views: Vec<Vec<Vec<f32>>> = (0..n * n)
        .into_par_iter()
        .map(|k| {
            let view = from.relief.view((k % n) as f32 - middle + camera, (k / n) as f32 - middle);
            request.colors.iter().map(|color| from.place.apply(&view[color.channel()])).collect()
        })
        .collect();
    let [height, width] = from.size;
    Ok(LightField {
        grid: [n, n],
        height,
        width,
        colors: request.colors.to_vec(),
        planes: by_color(views, request.colors.len()),
        view_pitch: Some(from.cell),
        disparity: Some(from.ends),
        depth: Some(from.depth()),
        made: None,
        name: from.name,
    })
}

/// Returns the position of the middle of the views that a source states, in meters to the right.
fn camera_of(path: &Path) -> Result<f64, SceneError> {
    let Some(text) = path.to_str() else { return Ok(0.0) };
    if video::named(path).is_some() {
        return Ok(0.0);
    }
    let options = Options::parse(parts(text).1, false);
    Ok(options.map_err(|reason| SceneError::Options { scene: text.into(), reason })?.camera)
}

/// Returns half the depth span for which views around a camera displace content by at most a quarter of the picture
/// (meters).
fn largest_span(display: &Display, camera: f64) -> f64 {
    let (height, width) = display.picture_size();
    let reach = camera.abs() + 0.5 * display.eyebox_min();
    0.24 * height.min(width) as f64 * display.focal_length * display.picture_pixel() / reach
}

/// The remedy for depths that displace content too far.
pub(crate) const SMALLER: &str =
    "at most a quarter of the picture. Take a smaller depth range, or fewer or closer views";

/// Refuses depths that displace content by more than a quarter of the picture in the outermost views.
///
/// # Errors
/// [`SceneError::Request`] with the displacement and `must`, the remedy.
pub(crate) fn check_parallax(pixels: f64, [height, width]: [usize; 2], must: &'static str) -> Result<(), SceneError> {
    if pixels <= (height.min(width) as f64 / 4.0).max(2.0) {
        return Ok(());
    }
    let what = "the displacement in the outermost views (pixels)";
    Err(SceneError::Request { what, value: format!("{pixels:.1}"), must })
}

/// Most bytes for views beyond the requested number.
const MEMORY: u64 = 2 << 30;

/// Returns the views along each axis with which content moves at most one pixel between neighbors over this range of
/// depths (meters), as far as memory allows. It is never below the requested number, and a log line has the number.
pub(crate) fn enough_views(path: &Path, request: &Request, [far, near]: [f64; 2]) -> usize {
    let display = request.display;
    let over_eyebox = display.eyebox_min() / (display.focal_length * display.picture_pixel());
    let needed = ((near - far) * over_eyebox - 1e-6).ceil() as usize;
    if request.view_pitch.is_some() || needed <= request.views {
        return request.views;
    }
    let (height, width) = display.picture_size();
    // `Request::check` counts the same way.
    let one = memory::bytes_of(&[request.colors.len() + 2, height, width], 4).max(1);
    let most = MEMORY.min(memory::available().unwrap_or(MEMORY) / 2);
    let fit = ((most / one) as f64).sqrt() as usize;
    let views = needed.min(fit).min(64).max(request.views);
    let why = if views < needed { "the limits allow no more" } else { "content then moves a pixel at most" };
    tracing::info!("{}: {views} x {views} views, because {why} (state `views` for another number)", path.display());
    views
}

/// Returns the disparities at the size of the picture on the display, and their smallest and largest.
fn disparities(
    map: &Map,
    size: [usize; 2],
    scale: f64,
    reach: f64,
    range: [f64; 2],
    cell: f64,
    display: &Display,
) -> (Vec<f32>, [f64; 2]) {
    let [low, high] = map.range.unwrap_or_else(|| map::ends(&map.values)).map(f64::from);
    // A value becomes the disparity first + (value - low) * gain.
    let (first, gain) = if let Meaning::Relative(near) = map.meaning {
        let [far, nearest] = range;
        let ends = if near.is_larger() { [far, nearest] } else { [nearest, far] };
        let [from, to] = ends.map(|z| z * cell / (display.focal_length * display.picture_pixel()));
        if high > low { (from, (to - from) / (high - low)) } else { ((from + to) / 2.0, 0.0) }
    } else {
        (low * scale, scale)
    };
    // A step that opens more than 1.5 pixels in the outermost view is an edge, and is not smoothed.
    let apart =
        if gain == 0.0 { f64::INFINITY } else { (1.5 / (reach.max(0.5) * gain.abs())).min(f64::from(f32::MAX)) };
    let resized = map::resized(&map.values, [map.height, map.width], size, apart as f32);
    let disparity: Vec<f32> = resized.into_iter().map(|v| (first + (f64::from(v) - low) * gain) as f32).collect();
    let found = map::ends(&disparity).map(f64::from);
    (disparity, found)
}
