//! Renders built-in scenes at any resolution, number of views and colors from short descriptions.
//!
//! The description is in scene units (see `shape`). One unit is half the display's shorter side across, and half the
//! depth span deep. The span is chosen so that the whole eyebox sees the same parallax, as a share of the picture, on
//! every display. It is -3 to +3 mm for 512 pixels of 8 um at 440 nm, and grows with the size. Parameters follow the
//! name as in `builtin:plane?depth=2&brightness=0.5`:
//!
//! - `brightness` multiplies the light, 0.01 to 10 (1).
//! - `span` is half the depth span in millimeters, instead of the span above.
//! - `camera` moves the camera by this many millimeters to the right in the pupil plane. Several values make a moving
//!   scene (0).
//! - `shift` moves the fruit of the still lifes, or the pattern of `plane`, to the right, in halves of the display's
//!   shorter side. Several values make a scene in which content moves (0).
//! - `depth` is the depth of `plane` in millimeters (0).

#[cfg(test)]
mod as_splats;
mod grass;
mod render;
mod shape;
mod stage;
mod still_life;
mod targets;
mod texture;

use crate::formats::options::with_length;
use crate::{LightField, Request, SceneError};
use eyebox_base::error::Reason;
use eyebox_base::memory;
use eyebox_base::reason;
use eyebox_optics::Display;
use render::{Canvas, Item};
pub use stage::Stage;

/// A built-in scene with its name and its content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Builtin {
    /// The name after `builtin:`.
    pub name: &'static str,
    /// The content in one line for a list.
    pub about: &'static str,
}

/// The scene of splats, which this module does not render.
const SPLATS: &str = "still-life-splats";

/// The built-in scenes. The first one is the scene of the demonstration.
pub const BUILTINS: [Builtin; 8] = [
    Builtin { name: "still-life", about: "fruit, a vase and lettering on a checked cloth, from the wall to the front" },
    Builtin { name: "still-life-dark", about: "the same by lamplight, mostly dark" },
    Builtin { name: "still-life-bright", about: "the same on white, mostly bright" },
    Builtin { name: "dense-grass", about: "hundreds of blades at all depths in front of a painted ball and a wall" },
    Builtin { name: "points", about: "single points at several depths, on black" },
    Builtin { name: "plane", about: "one flat, finely textured plane, and ?depth=MM moves it" },
    Builtin { name: "chart", about: "a resolution chart with bars of 2 to 32 pixels and a star, at three depths" },
    Builtin { name: SPLATS, about: "the still life as splats" },
];

/// Parallax of half the depth span over the whole eyebox, as a share of the shorter side. It is 3 mm on 512 pixels of 8
/// um at 440 nm.
const PARALLAX: f64 = 3e-3 * 440e-9 / (8e-6 * 8e-6) / 512.0;

/// Returns half the depth span that a display shows with the usual parallax in meters, `z = parallax f p / eyebox`.
pub(super) fn half_span(display: &Display) -> f64 {
    let (height, width) = display.picture_size();
    let pixels = PARALLAX * height.min(width) as f64;
    pixels * display.focal_length * display.picture_pixel() / display.eyebox_min()
}

#[derive(PartialEq)]
struct Parameters {
    brightness: f32,
    span: Option<f64>,
    /// Position of the camera in meters.
    camera: f64,
    /// Movement of content in scene units.
    shift: f32,
    depth: f64,
}

impl Parameters {
    /// Returns the depth of one scene unit in meters.
    fn unit(&self, name: &str, display: &Display) -> f64 {
        match name {
            // The depth of the plane is in millimeters, and its conversion to scene units needs a span above zero.
            "plane" => self.depth.abs().max(1e-6),
            _ => self.span.unwrap_or_else(|| half_span(display)),
        }
    }
}

/// Returns the farthest and the nearest depth of the items in the picture, in scene units.
fn depths(items: &[Item], canvas: Canvas) -> [f32; 2] {
    let ends = items.iter().map(|item| item.depths(canvas.half()[1]));
    ends.fold([f32::INFINITY, f32::NEG_INFINITY], |a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

fn unknown(name: &str, reason: Reason) -> SceneError {
    let known = BUILTINS.map(|b| b.name).join(", ");
    SceneError::Builtin { name: format!("builtin:{name}"), reason, known }
}

fn parse(source: &str) -> Result<(&'static str, Parameters), SceneError> {
    let (name, query) = source.split_once('?').unwrap_or((source, ""));
    let found = BUILTINS
        .iter()
        .find(|b| b.name == name)
        .ok_or_else(|| unknown(source, reason!("no-such-scene", "there is no such scene")))?;
    if name == SPLATS {
        return Err(unknown(source, reason!("splats", "its splats are not rendered here")));
    }
    let mut read = Parameters { brightness: 1.0, span: None, camera: 0.0, shift: 0.0, depth: 0.0 };
    for pair in query.split('&').filter(|p| !p.is_empty()) {
        let wrong = |must: &str| unknown(source, reason!("parameter", "'{pair}': {must}"));
        let (key, value) = pair.split_once('=').ok_or_else(|| wrong("parameters are written key=value"))?;
        let number = value.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| wrong("not a number"))?;
        match key {
            "brightness" if (0.01..=10.0).contains(&number) => read.brightness = number as f32,
            "brightness" => return Err(wrong("it must be 0.01 to 10")),
            "span" if (0.0..=1e3).contains(&number) => read.span = Some(number * 1e-3),
            "span" => return Err(wrong("it must be 0 to 1000 mm")),
            "camera" if number.abs() <= 1e4 => read.camera = number * 1e-3,
            "camera" => return Err(wrong("it must be -10000 to 10000 mm")),
            "shift" if (-2.0..=2.0).contains(&number) && (name == "plane" || name.starts_with("still-life")) => {
                read.shift = number as f32;
            }
            "shift" => {
                return Err(wrong("it must be -2 to 2, of still-life, still-life-dark, still-life-bright or plane"));
            }
            "depth" if name == "plane" => read.depth = number * 1e-3,
            _ => return Err(wrong("the parameters are brightness, span, camera, shift and, for plane, depth")),
        }
    }
    Ok((found.name, read))
}

/// Refuses an unknown scene or parameter.
///
/// # Errors
/// [`SceneError::Builtin`] for an unknown scene or parameter.
pub(super) fn check(source: &str) -> Result<(), SceneError> {
    parse(source).map(|_| ())
}

/// Returns true if both sources are one scene.
pub(super) fn same(a: &str, b: &str) -> bool {
    a == b || matches!((parse(a), parse(b)), (Ok(a), Ok(b)) if a == b)
}

/// Returns the items of a scene in scene units. `unit` is the depth of one scene unit.
fn items_of(name: &str, parameters: &Parameters, canvas: Canvas, unit: f64) -> Vec<Item> {
    let aspect = canvas.half();
    let mut items: Vec<Item> = match name {
        "still-life" => still_life::items(aspect, still_life::Mood::Day, parameters.shift),
        "still-life-dark" => still_life::items(aspect, still_life::Mood::Lamp, parameters.shift),
        "still-life-bright" => still_life::items(aspect, still_life::Mood::Studio, parameters.shift),
        "dense-grass" => grass::items(aspect),
        "points" => targets::points(aspect, canvas.pixel()),
        "plane" => targets::plane((parameters.depth / unit) as f32, parameters.shift),
        _ => targets::chart(aspect, canvas.pixel()),
    };
    items.iter_mut().for_each(|item| item.brighten(parameters.brightness));
    items
}

/// The largest displacement of content at one unit of depth, in scene units. Beyond it, the cloth would be seen from
/// below.
const LARGEST_TILT: f64 = 0.4;

/// Returns the same scene for cameras that are moved by these distances (meters to the right). Without a stated span,
/// the depth span is so small that all of them see the scene.
///
/// # Errors
/// [`SceneError::Builtin`] for an unknown scene or parameter.
pub(super) fn from_places<const N: usize>(
    source: &str,
    request: &Request,
    places: [f64; N],
) -> Result<[String; N], SceneError> {
    let (name, parameters) = parse(source)?;
    let (display, n) = (request.display, request.views as f64);
    let (head, query) = source.split_once('?').unwrap_or((source, ""));
    let mut query = query.to_owned();
    let cameras = places.map(|place| parameters.camera + place);
    if name != "plane" && parameters.span.is_none() {
        let (height, width) = display.picture_size();
        let cell = request.view_pitch.unwrap_or_else(|| display.eyebox_min() / n);
        let reach = cameras.iter().map(|camera| camera.abs()).fold(0.0, f64::max) + cell * (n - 1.0) / 2.0;
        let per_metre = f64::from(Canvas { height, width }.pixel()) / (display.focal_length * display.picture_pixel());
        let span = half_span(display).min(LARGEST_TILT / (per_metre * reach).max(f64::MIN_POSITIVE));
        // It is rounded down, so that the scene stays within the limit.
        query.push_str(&format!("&span={}", (span * 1e7).floor() / 1e4));
    }
    Ok(cameras.map(|camera| format!("builtin:{head}?{}", with_length(&query, "camera", camera))))
}

/// Renders `builtin:source` at the display's resolution.
///
/// # Errors
/// [`SceneError::Builtin`] for an unknown scene or parameter. [`SceneError::Request`] if the views are too far apart
/// for the depths.
pub(super) fn load(source: &str, request: &Request) -> Result<LightField, SceneError> {
    let (name, parameters) = parse(source)?;
    let display = request.display;
    let (height, width) = display.picture_size();
    // One surface needs four texels per pixel, with four channels at most.
    let bytes = memory::bytes_of(&[height, width, 16], 4);
    let what = || format!("the built-in scene at {height} x {width} pixels");
    memory::check_available(what, bytes, "take a smaller `size`")?;
    let canvas = Canvas { height, width };
    let unit = parameters.unit(name, display);
    let items = items_of(name, &parameters, canvas, unit);

    let n = request.views;
    let cell = request.view_pitch.unwrap_or_else(|| display.eyebox_min() / n as f64);
    // The disparity is in pixels per view at the near end of the span (OPTICS 3), and the step is in scene units.
    let disparity = unit * cell / (display.focal_length * display.picture_pixel());
    let step = disparity * f64::from(canvas.pixel());
    // Textures extend as far as views see them.
    let limit = if name == "plane" { f64::max(1.0, 16.0 * f64::from(canvas.pixel())) } else { LARGEST_TILT };
    let middle = (n as f64 - 1.0) / 2.0;
    let must = "smaller at these depths, because the outer views would see content displaced out of the picture";
    if step * middle > limit {
        let value = format!("{:.3}", cell * 1e3);
        return Err(SceneError::Request { what: "the view pitch (mm)", value, must });
    }
    // The unit is the view pitch.
    let camera = parameters.camera / cell;
    if step * (middle + camera.abs()) > limit {
        let value = format!("{:.3}", parameters.camera * 1e3);
        return Err(SceneError::Request { what: "the camera's place (mm)", value, must });
    }
    let tilt = |i: usize, camera: f64| ((i as f64 - middle + camera) * step) as f32;
    let tilts: Vec<[f32; 2]> = (0..n * n).map(|v| [tilt(v % n, camera), tilt(v / n, 0.0)]).collect();
    let planes = render::render(canvas, &items, &tilts, request.colors);
    let ends = depths(&items, canvas);
    let range = |per_unit: f64| Some(ends.map(|z| f64::from(z) * per_unit));
    Ok(LightField {
        name: format!("builtin:{source}"),
        grid: [n, n],
        height,
        width,
        colors: request.colors.to_vec(),
        planes,
        view_pitch: Some(cell),
        disparity: range(disparity),
        depth: range(unit),
        made: None,
    })
}
