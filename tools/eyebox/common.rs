//! What commands share: display, scene, engine, names of files.

use crate::Failure;
use crate::args::{DisplayArgs, EngineArgs, SceneArgs};
use eyebox::engine::{self, Backend, Engine};
use eyebox::files;
use eyebox::gpu::Options;
use eyebox::hologram::{Hologram, Sequence};
use eyebox::optics::{Color, Display};
use eyebox::preview::Opener;
use eyebox::scene::{self, LightField};
use eyebox::solve::PupilRange;
use std::path::Path;

/// The display, resized if asked.
pub fn display(args: &DisplayArgs) -> Result<Display, Failure> {
    let mut display = Display::load(&args.display)?;
    if let Some([height, width]) = args.size {
        (display.height, display.width) = (height, width);
    }
    Ok(display)
}

/// The colours asked for, that the display has.
pub fn colors(args: &DisplayArgs, display: &Display) -> Result<Vec<Color>, Failure> {
    match args.color.one() {
        None => Ok(display.wavelengths.iter().map(|w| w.color).collect()),
        Some(color) => {
            display.optics(color)?;
            Ok(vec![color])
        }
    }
}

/// The scene, fitted to the display.
pub fn scene(args: &SceneArgs, display: &Display, colors: &[Color]) -> Result<LightField, Failure> {
    let default = scene::Request::new(display, colors);
    let request = scene::Request {
        view_pitch: args.view_pitch.map(|mm| mm * 1e-3),
        views: args.views.unwrap_or(default.views),
        depth_map: args.depth_map.as_deref(),
        depth: args.depth,
        ..default
    };
    Ok(scene::load(&args.scene, &request)?)
}

/// The depths that matter: as asked, as the scene says, or what a disparity of two pixels means.
pub fn depths(args: &SceneArgs, field: &LightField, display: &Display) -> [f64; 2] {
    let assumed = || 2.0 * display.focal_length * display.picture_pixel() / field.cell(display);
    let [a, b] = args.depth.or_else(|| field.depth_range(display)).unwrap_or_else(|| [-assumed(), assumed()]);
    [a.min(b), a.max(b)]
}

/// Pupil diameters from 2 mm to most of the eyebox.
pub fn diameters(asked: Option<[f64; 2]>, display: &Display) -> [f64; 2] {
    asked.unwrap_or_else(|| PupilRange::usual_diameter(display.eyebox_min()))
}

/// Which engine is asked for.
pub fn engine_choice(args: &EngineArgs) -> engine::Choice {
    match args.engine {
        crate::args::EngineName::Auto => engine::Choice::Auto,
        crate::args::EngineName::Cpu => engine::Choice::Cpu,
        crate::args::EngineName::Vulkan => engine::Choice::Vulkan,
    }
}

/// The engine asked for.
pub fn engine(args: &EngineArgs) -> Result<Box<dyn Engine>, Failure> {
    Ok(opener(args)?()?)
}

/// What makes the engine asked for, as often as it is called, on one device.
pub fn opener(args: &EngineArgs) -> Result<Opener, Failure> {
    let (choice, options) = (engine_choice(args), Options::default());
    let Some(name) = &args.vulkan_from else {
        let backend = Backend::open(choice, &options)?;
        return Ok(Box::new(move || backend.engine()));
    };
    let names = || engine::Kernel::ALL.map(engine::Kernel::name).join(", ");
    let from = engine::Kernel::by_name(name)
        .ok_or_else(|| Failure::Asked(format!("no kernel is called '{name}': there are {}", names())))?;
    let backend = Backend::open(engine::Choice::Vulkan, &options)?;
    Ok(Box::new(move || backend.engine_from(from)))
}

/// Where a result goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// NumPy array.
    Npy,
    /// Picture.
    Png,
    /// Hologram.
    Zarr,
}

/// The form that a file's name asks for, among those allowed; says no before anything is computed.
pub fn form(out: &Path, allowed: &[Form]) -> Result<Form, Failure> {
    let extension = out.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let found = match extension.as_str() {
        "npy" => Some(Form::Npy),
        "png" => Some(Form::Png),
        "zarr" => Some(Form::Zarr),
        _ => None,
    };
    let name = |f: &Form| match f {
        Form::Npy => ".npy",
        Form::Png => ".png",
        Form::Zarr => ".zarr",
    };
    let form = found.filter(|f| allowed.contains(f)).ok_or_else(|| {
        let ends = allowed.iter().map(name).collect::<Vec<_>>().join(" or ");
        Failure::Asked(format!("{}: the name must end in {ends}", out.display()))
    })?;
    match out.parent().filter(|p| !p.as_os_str().is_empty()) {
        Some(folder) if !folder.is_dir() => {
            Err(Failure::Asked(format!("{}: there is no such folder to write into", folder.display())))
        }
        _ => Ok(form),
    }
}

/// Writes one plane per colour: `.npy` as it is, `.png` with each plane times its exposure, encoded as sRGB.
pub fn write_image(
    out: &Path,
    form: Form,
    size: [usize; 2],
    planes: &[Vec<f32>],
    colors: &[Option<Color>],
    exposures: &[f64],
) -> Result<(), Failure> {
    let [height, width] = size;
    if form == Form::Npy {
        let all: Vec<f32> = planes.concat();
        let shape = [planes.len(), height, width];
        files::write_npy(out, if planes.len() == 1 { &shape[1..] } else { &shape[..] }, &all)?;
        return Ok(());
    }
    let light: Vec<Vec<f32>> =
        planes.iter().zip(exposures).map(|(p, e)| p.iter().map(|v| v * *e as f32).collect()).collect();
    if let [one] = &light[..] {
        files::write_png(out, height, width, &[one])?;
        return Ok(());
    }
    // Colours without a name are red, green, blue in their order; a missing one is black.
    let black = vec![0.0; height * width];
    let mut rgb: [&[f32]; 3] = [&black; 3];
    for (i, (plane, color)) in light.iter().zip(colors).enumerate() {
        rgb[color.map_or(i.min(2), Color::channel)] = plane;
    }
    files::write_png(out, height, width, &rgb)?;
    Ok(())
}

/// Whether a path is meant as a hologram, with its optics, and not as bare phases.
pub fn is_hologram(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zarr"))
}

/// Largest resident set so far, as Linux tells it.
pub fn peak_memory_mib() -> Option<u64> {
    memory_kib("VmHWM").map(|kib| kib / 1024)
}

/// A line of this process's status that is an amount of memory: `VmRSS`, `VmHWM`.
pub fn memory_kib(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix(name)?.strip_prefix(':'))?;
    line.split_whitespace().next()?.parse().ok()
}

/// A hologram, or one of a sequence's.
pub fn hologram(path: &Path, at: Option<u64>) -> Result<Hologram, Failure> {
    match at {
        Some(at) => Ok(Sequence::open(path)?.load(at)?),
        None => Ok(Hologram::load(path)?),
    }
}
