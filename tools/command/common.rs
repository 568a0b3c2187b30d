//! Functions that commands share for displays, scenes, engines and names of files.

use crate::Failure;
use crate::groups::{DeviceArgs, DisplayArgs, EngineArgs, EngineName, SceneArgs};
use crate::progress::{self, JobBar};
use crate::values::GivenPupil;
use eyebox::low_level::calibrate::ModelAge;
use eyebox::low_level::engine::{self, Backend, Engine, EngineError};
use eyebox::low_level::error::Reason;
use eyebox::low_level::evaluate::{Plane, Views};
use eyebox::low_level::files;
use eyebox::low_level::gpu::{Gpu, Options};
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::{Color, Display, OpticsError, Pupil, check_usual_diameters};
use eyebox::low_level::preview::Opener;
use eyebox::low_level::produce::TilesRequest;
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::drawer_for;
use eyebox::low_level::scene::{self, Inspection, LightField, SplatDrawer};
use eyebox::low_level::session::EngineSource;
use eyebox::low_level::solve::{Flow, PupilRange, Settings, StartTable};
use eyebox::low_level::trackers::now_ns;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Fits first phases of these colors of a display into the cache, so that no solve waits for them. Ctrl-C ends the fit,
/// and the next solve continues it.
pub fn prepare_first_phases(display: &Display, colors: &[Color], quiet: bool) -> Result<(), Failure> {
    let bar = JobBar::new(quiet);
    let mut observe = |share| bar.show("fitting first phases, once for this display", share) == Flow::Continue;
    let prepared = StartTable::prepare(display, colors, Settings::default().frames, &mut observe)?;
    bar.finish();
    match prepared {
        0 if progress::interrupted() => eprintln!("first phases: the next solve continues their fit"),
        0 => {}
        _ => eprintln!("first phases: fitted for {prepared} of {} colors", colors.len()),
    }
    Ok(())
}

/// Loads the display, resizes it if requested, and checks it for likely mistakes.
pub fn display(args: &DisplayArgs) -> Result<Display, Failure> {
    display_of_size(args.display.as_deref().unwrap_or("paper"), args.size, args.force)
}

/// Prints the age of the model of each color of a display.
pub fn say_model_age(display: &Display) {
    for color in display.wavelengths.iter().map(|w| w.color) {
        if let Some(age) = ModelAge::of(display, color) {
            eprintln!("the {color} model of {}: {age}", display.name);
        }
    }
}

/// Loads a display by its name, with the same resize and check.
pub fn display_of_size(name: &str, size: Option<[usize; 2]>, force: bool) -> Result<Display, Failure> {
    let mut display = Display::load(name)?;
    if let Some([height, width]) = size {
        (display.height, display.width) = (height, width);
    }
    usual(force, display.check_usual())?;
    Ok(display)
}

/// Returns the display that a hologram is sent to. It is the display of this name, or the one that the hologram was
/// solved for, in the hologram's size. A given size replaces its size.
pub fn display_of(
    name: Option<&str>,
    size: Option<[usize; 2]>,
    force: bool,
    hologram: &Hologram,
) -> Result<Display, Failure> {
    let mut display = hologram.shown_on(name)?;
    if let Some([height, width]) = size {
        (display.height, display.width) = (height, width);
    }
    usual(force, display.check_usual())?;
    Ok(display)
}

/// Returns a count with its noun, such as `1 color` or `3 colors`.
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// Checks the ending of an output file.
pub fn check_ending(file: &Path, ending: &str) -> Result<(), Failure> {
    if file.extension().is_none_or(|found| found != ending) {
        return Err(Failure::Arguments(reason!("ending", "{}: the name must end in .{ending}", file.display())));
    }
    Ok(())
}

/// Checks the ending and the place of an output file.
pub fn check_output(file: &Path, ending: &str) -> Result<(), Failure> {
    check_ending(file, ending)?;
    Ok(eyebox::low_level::files::check_place(file)?)
}

/// Refuses a likely mistake, unless `force` accepts it.
pub fn usual(force: bool, checked: Result<(), OpticsError>) -> Result<(), Failure> {
    match checked {
        Err(OpticsError::Unusual { .. } | OpticsError::OutsideEyebox { .. }) if force => Ok(()),
        Err(e @ (OpticsError::Unusual { .. } | OpticsError::OutsideEyebox { .. })) => {
            Err(Failure::Arguments(Reason::of(&e).reworded(|text| format!("{text}. --force accepts it as it is"))))
        }
        checked => Ok(checked?),
    }
}

/// Returns a given pupil before a display of this focal length (meters), checked as [`usual`] does.
pub fn pupil(
    given: &GivenPupil,
    focal_length: f64,
    check: impl Fn(Pupil) -> Result<Pupil, OpticsError>,
    force: bool,
) -> Result<Pupil, Failure> {
    let pupil = given.before(focal_length);
    usual(force, check(pupil).map(drop))?;
    Ok(pupil)
}

/// Returns a given pupil before the display of a hologram, with the same check.
pub fn pupil_of(given: &GivenPupil, hologram: &Hologram, force: bool) -> Result<Pupil, Failure> {
    pupil(given, hologram.focal_length, |pupil| hologram.check_pupil(pupil), force)
}

/// Returns the requested colors, which the display must have.
pub fn colors(args: &DisplayArgs, display: &Display) -> Result<Vec<Color>, Failure> {
    match args.color.one() {
        None => Ok(display.wavelengths.iter().map(|w| w.color).collect()),
        Some(color) => {
            display.optics(color)?;
            Ok(vec![color])
        }
    }
}

/// Returns the request for a scene with the first of these depth maps, if there is one.
pub fn request<'a>(
    args: &'a SceneArgs,
    maps: &'a [PathBuf],
    display: &'a Display,
    colors: &'a [Color],
) -> scene::Request<'a> {
    let depth_map = maps.first().map(PathBuf::as_path);
    args.options.reading(display.focal_length).request(display, colors, depth_map, false)
}

/// Returns the depth map of the one scene.
pub fn maps_of(args: &SceneArgs) -> Result<Vec<PathBuf>, Failure> {
    Ok(scene::depth_maps(std::slice::from_ref(&args.scene), &args.options.depth_map)?)
}

/// Loads the scene and fits it to the display. The device of the engine draws the views of splats.
pub fn scene_on(
    args: &SceneArgs,
    display: &Display,
    colors: &[Color],
    engine: &dyn Engine,
) -> Result<LightField, Failure> {
    scene_by(args, display, colors, drawer_for(&args.scene, engine).as_ref())
}

/// Loads the scene and fits it to the display. The drawer draws the views of splats.
pub fn scene_by(
    args: &SceneArgs,
    display: &Display,
    colors: &[Color],
    drawer: Option<&Arc<dyn SplatDrawer>>,
) -> Result<LightField, Failure> {
    let maps = maps_of(args)?;
    Ok(scene::load(&args.scene, &scene::Request { drawer, ..request(args, &maps, display, colors) })?)
}

/// Returns the sources of one scene for the left and the right eye, at these places in meters to the right.
pub fn scene_of_eyes(
    args: &SceneArgs,
    display: &Display,
    colors: &[Color],
    eyes: [f64; 2],
) -> Result<[String; 2], Failure> {
    let maps = maps_of(args)?;
    Ok(scene::of_two_eyes(&args.scene, &request(args, &maps, display, colors), eyes)?)
}

/// Loads the scene as it is read, whatever its order, with a report about it.
pub fn inspect(args: &SceneArgs, display: &Display, colors: &[Color]) -> Result<(Inspection, LightField), Failure> {
    let maps = maps_of(args)?;
    Ok(scene::inspect(&args.scene, &request(args, &maps, display, colors))?)
}

/// Loads the scene for a far field larger than memory, color by color. Reconstructions are compared with it.
pub fn scene_around(args: &SceneArgs, display: &Display, colors: &[Color]) -> Result<Vec<Views>, Failure> {
    let maps = maps_of(args)?;
    Ok(Views::of_colors(&args.scene, &request(args, &maps, display, colors), TilesRequest::default().picture)?)
}

/// Returns the depth range of the scene, meters.
pub fn depths(args: &SceneArgs, field: &LightField, display: &Display) -> Result<[f64; 2], Failure> {
    Ok(field.depths(display, args.options.depth_before(display))?)
}

/// Returns the requested pupil diameters, meters, checked as [`usual`] does. The default is 2 mm to most of the eyebox.
pub fn diameters(asked: Option<[f64; 2]>, display: &Display, force: bool) -> Result<[f64; 2], Failure> {
    let Some(asked) = asked else { return Ok(PupilRange::usual_diameter(display.eyebox_min())) };
    usual(force, check_usual_diameters(asked, display.eyebox_min()))?;
    Ok(asked)
}

/// Opens the requested engine.
pub fn engine(args: &EngineArgs) -> Result<Box<dyn Engine>, Failure> {
    Ok(Engines::new(args, &Options::default())?.open()?)
}

/// The requested engines, all on one device if they use a device.
#[derive(Clone)]
pub struct Engines {
    backend: Backend,
    from: Option<engine::Kernel>,
}

impl Engines {
    /// Opens the device, if there is one.
    pub fn new(args: &EngineArgs, options: &Options) -> Result<Self, Failure> {
        let (choice, from) = match args.device.engine(args.engine)? {
            EngineName::Auto => (engine::Choice::Auto, None),
            EngineName::Cpu => (engine::Choice::Cpu, None),
            EngineName::Vulkan => (engine::Choice::Vulkan, None),
            EngineName::VulkanFrom(kernel) => (engine::Choice::Vulkan, Some(kernel)),
        };
        let options = Options { device: args.device.device.clone(), ..options.clone() };
        Ok(Self { backend: Backend::open(choice, &options)?, from })
    }

    /// Opens one more engine.
    pub fn open(&self) -> Result<Box<dyn Engine>, EngineError> {
        self.from.map_or_else(|| self.backend.engine(), |kernel| self.backend.engine_from(kernel))
    }

    /// Returns a function that opens an engine at each call.
    pub fn opener(&self) -> Opener {
        let engines = self.clone();
        Box::new(move || engines.open())
    }

    /// Returns the source of engines for a session.
    pub fn source(&self) -> EngineSource {
        if self.from.is_some() { self.opener().into() } else { self.backend.clone().into() }
    }

    /// Returns the device of the engines.
    pub fn gpu(&self) -> Result<Option<Gpu>, EngineError> {
        self.backend.gpu()
    }

    /// Returns the backend that opens them, which decodes the views of live content.
    pub fn backend(&self) -> &Backend {
        &self.backend
    }
}

/// Opens a device that shows pictures. It is the requested device, or the best one, or a software device if there is no
/// other.
pub fn display_gpu(args: &DeviceArgs, validation: bool) -> Result<Gpu, Failure> {
    let device = args.device.clone();
    Ok(Gpu::open(&Options { device, allow_cpu: true, present: true, validation, ..Options::default() })?)
}

/// The file format of a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    Npy,
    Png,
    Zarr,
}

/// Returns the format of a file's ending, if it is among the allowed ones. Commands check it before they compute.
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
        Failure::Arguments(reason!("ending", "{}: the name must end in {ends}", out.display()))
    })?;
    match out.parent().filter(|p| !p.as_os_str().is_empty()) {
        Some(folder) if !folder.is_dir() => Err(Failure::Arguments(reason!(
            "no-such-folder",
            "{}: no such folder to write into. Create it, or give another place",
            folder.display()
        ))),
        _ => Ok(form),
    }
}

/// Writes one plane per color. A `.npy` has the values as they are. A `.png` has each plane times its exposure, encoded
/// as sRGB.
pub fn write_image(
    out: &Path,
    form: Form,
    planes: &[Plane],
    colors: &[Option<Color>],
    exposures: &[f64],
) -> Result<(), Failure> {
    let (height, width) = planes.first().map_or((0, 0), |p| (p.rows, p.columns));
    if form == Form::Npy {
        let all: Vec<f32> = planes.iter().flat_map(|p| &p.values).copied().collect();
        let shape = [planes.len(), height, width];
        files::write_npy(out, if planes.len() == 1 { &shape[1..] } else { &shape[..] }, &all)?;
        return Ok(());
    }
    let light: Vec<Vec<f32>> =
        planes.iter().zip(exposures).map(|(p, e)| p.values.iter().map(|v| v * *e as f32).collect()).collect();
    if let [one] = &light[..] {
        files::write_png(out, height, width, &[one])?;
        return Ok(());
    }
    // Colors without a name are red, green, blue in their order. A missing color is black.
    let black = vec![0.0; height * width];
    let mut rgb: [&[f32]; 3] = [&black; 3];
    for (i, (plane, color)) in light.iter().zip(colors).enumerate() {
        rgb[color.map_or(i.min(2), Color::channel)] = plane;
    }
    files::write_png(out, height, width, &rgb)?;
    Ok(())
}

/// The time at which the command began (ns on the monotonic clock of the system).
static BEGUN: OnceLock<u64> = OnceLock::new();

/// Stores the time at which the command begins.
pub fn begin() {
    BEGUN.get_or_init(now_ns);
}

/// Returns the time from the beginning of the command to a time on the monotonic clock of the system, s.
pub fn seconds_to(at_ns: u64) -> f64 {
    let begun_ns = *BEGUN.get_or_init(now_ns);
    at_ns.saturating_sub(begun_ns) as f64 * 1e-9
}

/// Returns the largest resident set so far, MiB, as Linux reports it.
pub fn peak_memory_mib() -> Option<u64> {
    memory_kib("VmHWM").map(|kib| kib / 1024)
}

/// Returns an amount of memory from this process's status, KiB, by its name, such as `VmRSS` or `VmHWM`.
pub fn memory_kib(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix(name)?.strip_prefix(':'))?;
    line.split_whitespace().next()?.parse().ok()
}
