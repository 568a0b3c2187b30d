//! Built-in scenes: rendered at any resolution, number of views and colors from a few lines of description.
//!
//! The description is in scene units (see `shape`): half the display's shorter side across, half the depth span deep.
//! The span is chosen so that the whole eyebox sees the same parallax, as a share of the picture, on every display:
//! -3 to +3 mm for 512 pixels of 8 um at 440 nm, growing with the size. Parameters follow the name as in
//! `builtin:plane?depth=2&brightness=0.5`:
//!
//! - `brightness`: multiplies the light, 0.01 to 10 (1);
//! - `span`: half the depth span in millimeters, instead of the above;
//! - `camera`: the scene as a camera sees it that stands so many millimeters to the right, in the pupil plane: several of
//!   them are a moving scene (0);
//! - `shift`: of the still lifes and `plane`: so many halves of the display's shorter side to the right from where it usually is
//!   stands the fruit, or the plane's pattern: several of them are a scene in which something moves (0);
//! - `depth`: of `plane` only: its depth in millimeters (0).

mod grass;
mod render;
mod shape;
mod stage;
mod still_life;
mod targets;
mod texture;

use crate::{LightField, Request, SceneError};
use eyebox_base::error::Reason;
use eyebox_base::memory;
use eyebox_base::reason;
use eyebox_optics::Display;
use render::{Canvas, Item};
pub use stage::Stage;

/// A built-in scene: its name and what it shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Builtin {
    /// What follows `builtin:`.
    pub name: &'static str,
    /// One line for a list.
    pub about: &'static str,
}

/// The built-in scenes; the first is the demonstration's.
pub const BUILTINS: [Builtin; 7] = [
    Builtin { name: "still-life", about: "fruit, a vase and lettering on a checked cloth, from the wall to the front" },
    Builtin { name: "still-life-dark", about: "the same by lamplight: most of it is dark" },
    Builtin { name: "still-life-bright", about: "the same on white: most of it is bright" },
    Builtin { name: "dense-grass", about: "hundreds of blades at all depths in front of a painted ball and a wall" },
    Builtin { name: "points", about: "single points at several depths, on black" },
    Builtin { name: "plane", about: "one flat, finely textured plane; ?depth=MM moves it" },
    Builtin { name: "chart", about: "a resolution chart: bars of 2 to 32 pixels and a star, at three depths" },
];

/// Parallax of half the depth span over the whole eyebox, as a share of the shorter side: 3 mm on 512 pixels of 8 um
/// at 440 nm.
const PARALLAX: f64 = 3e-3 * 440e-9 / (8e-6 * 8e-6) / 512.0;

/// Half the depth span that a display shows with the usual parallax, meters: `z = parallax f p / eyebox`.
pub(super) fn half_span(display: &Display) -> f64 {
    let (height, width) = display.picture_size();
    let pixels = PARALLAX * height.min(width) as f64;
    pixels * display.focal_length * display.picture_pixel() / display.eyebox_min()
}

#[derive(PartialEq)]
struct Parameters {
    brightness: f32,
    span: Option<f64>,
    /// Meters.
    camera: f64,
    /// Scene units.
    shift: f32,
    depth: f64,
}

impl Parameters {
    /// The depth of one scene unit, meters.
    fn unit(&self, name: &str, display: &Display) -> f64 {
        match name {
            // The plane's own depth is in millimeters: it needs a span that is not zero to be said in scene units.
            "plane" => self.depth.abs().max(1e-6),
            _ => self.span.unwrap_or_else(|| half_span(display)),
        }
    }
}

/// The farthest and the nearest depth of what is in the picture, scene units.
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

/// Whether there is such a scene, with such parameters.
///
/// # Errors
/// [`SceneError::Builtin`].
pub(super) fn check(source: &str) -> Result<(), SceneError> {
    parse(source).map(|_| ())
}

/// Whether both are one scene.
pub(super) fn same(a: &str, b: &str) -> bool {
    matches!((parse(a), parse(b)), (Ok(a), Ok(b)) if a == b)
}

/// What a scene is made of, in scene units; `unit` is the depth of one.
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

/// Renders `builtin:source` at the display's resolution.
///
/// # Errors
/// [`SceneError::Builtin`]; [`SceneError::Request`] when the views lie too far apart for the depths.
pub(super) fn load(source: &str, request: &Request) -> Result<LightField, SceneError> {
    let (name, parameters) = parse(source)?;
    let display = request.display;
    let (height, width) = display.picture_size();
    // What lies on one surface: four texels a pixel, of four channels at most.
    let bytes = memory::bytes_of(&[height, width, 16], 4);
    let what = || format!("the built-in scene at {height} x {width} pixels");
    memory::check_available(what, bytes, "take a smaller `size`")?;
    let canvas = Canvas { height, width };
    let unit = parameters.unit(name, display);
    let items = items_of(name, &parameters, canvas, unit);

    let n = request.views;
    let cell = request.view_pitch.unwrap_or_else(|| display.eyebox_min() / n as f64);
    // Pixels per view that content at the near end of the span moves (OPTICS 3), then scene units.
    let disparity = unit * cell / (display.focal_length * display.picture_pixel());
    let step = disparity * f64::from(canvas.pixel());
    // Textures are made as far as views see them; and beyond this, the cloth would be seen from below.
    let limit = if name == "plane" { f64::max(1.0, 16.0 * f64::from(canvas.pixel())) } else { 0.4 };
    let middle = (n as f64 - 1.0) / 2.0;
    let must = "smaller at these depths: the outer views would see content displaced out of the picture";
    if step * middle > limit {
        let value = format!("{:.3}", cell * 1e3);
        return Err(SceneError::Request { what: "the view pitch (mm)", value, must });
    }
    // In view pitches.
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
