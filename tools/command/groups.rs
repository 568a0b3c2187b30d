//! Groups of arguments that commands share, such as the engine, the display and the scene.
//!
//! Options are in millimeters, and the values of the library in meters.

use crate::Failure;
use crate::values::{MIN, MM, Names, S, depths, iris, not_negative_in, one_of, positive_in, prescription, size};
use clap::{Args, ValueEnum};
use eyebox::low_level::engine::Kernel;
use eyebox::low_level::error::Reason;
use eyebox::low_level::hologram::{Hologram, HologramError};
use eyebox::low_level::optics::{Depth, Display, Obstruction, Prescription};
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::{InputOptions, SceneReading, SolveInput};
use eyebox::low_level::scene::{Near, Order, ViewSynthesis};
use std::path::{Path, PathBuf};

/// The engine that computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EngineName {
    /// A real GPU if there is one, otherwise the CPU.
    Auto,
    /// All cores of the CPU.
    Cpu,
    /// Vulkan, including a software device.
    Vulkan,
    /// The kernels before this one on the CPU, and the others on Vulkan.
    VulkanFrom(Kernel),
}

/// Reads the name of an engine.
fn engine(text: &str) -> Result<EngineName, String> {
    match text.split_once(':') {
        None if text == "auto" => Ok(EngineName::Auto),
        None if text == "cpu" => Ok(EngineName::Cpu),
        None if text == "vulkan" => Ok(EngineName::Vulkan),
        Some(("vulkan-from", kernel)) => Kernel::by_name(kernel)
            .map(EngineName::VulkanFrom)
            .ok_or_else(|| format!("there is no kernel '{kernel}', only {}", Kernel::ALL.map(Kernel::name).join(", "))),
        _ => Err("expected auto, cpu, vulkan, or vulkan-from:KERNEL".into()),
    }
}

/// The colors of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Colors {
    /// Color of the longest wavelength
    Red,
    /// Color of the middle wavelength
    Green,
    /// Color of the shortest wavelength
    Blue,
    /// All colors of the display
    All,
}

/// The engine, in every command that computes.
#[derive(Args, Clone)]
pub struct EngineArgs {
    /// Engine (auto, cpu, vulkan or vulkan-from:KERNEL). With auto, a real GPU computes if there is one, otherwise the
    /// CPU. With vulkan, a software device counts, too. With vulkan-from:KERNEL, the kernels before KERNEL run on the
    /// CPU [default: auto]
    #[arg(help_heading = "Engine", long, value_parser = engine, default_value = "auto", hide_default_value = true, value_name = "ENGINE")]
    pub engine: EngineName,
    #[command(flatten)]
    pub device: DeviceArgs,
}

/// The Vulkan device, in every command that uses one.
#[derive(Args, Clone)]
pub struct DeviceArgs {
    /// Vulkan device by its number or a part of its name (eyebox device list) [default: the best one]
    #[arg(help_heading = "Engine", long, value_name = "N|NAME")]
    pub device: Option<String>,
}

impl DeviceArgs {
    /// Returns the requested engine. A named device selects Vulkan.
    pub fn engine(&self, asked: EngineName) -> Result<EngineName, Failure> {
        match (&self.device, asked) {
            (Some(_), EngineName::Auto) => Ok(EngineName::Vulkan),
            (Some(device), EngineName::Cpu) => Err(Failure::Arguments(reason!(
                "device-of-cpu",
                "--device {device} is a device for Vulkan, and --engine cpu uses none. Leave out one of them"
            ))),
            _ => Ok(asked),
        }
    }
}

/// The display, in every command that needs one.
#[derive(Args, Clone)]
pub struct DisplayArgs {
    /// Display preset (eyebox display list) or TOML file [default: the one that a hologram was solved for, otherwise
    /// paper]
    #[arg(help_heading = "Display", long, value_name = "PRESET|FILE")]
    pub display: Option<String>,
    /// Resolution instead of the display's own, rows x columns, N for a square, or a name such as 1080p
    #[arg(help_heading = "Display", long, value_name = "HxW", value_parser = size)]
    pub size: Option<[usize; 2]>,
    /// Color (red, green, blue or all)
    #[arg(help_heading = "Display", long, value_enum, default_value = "all")]
    pub color: Colors,
    /// Accept sizes, wavelengths and pupils that look like a mistake, and a scene that the hologram was not made of
    #[arg(help_heading = "Display", long)]
    pub force: bool,
}

/// The eye, in every command that computes what it sees.
#[derive(Args, Clone)]
pub struct EyeArgs {
    /// Prescription of the eye in dioptres and degrees, such as "-2 -0.5 30", or none for a perfect eye [default: the
    /// eye of the hologram or the display file]
    #[arg(help_heading = "Eye", long, value_name = "S C AXIS|none", value_parser = prescription)]
    pub prescription: Option<Prescription>,
    /// TOML file of the eye with sphere, cylinder, axis_deg, vertex_mm, zernikes_um, measured_mm
    #[arg(help_heading = "Eye", long, value_name = "FILE", conflicts_with = "prescription")]
    pub eye_file: Option<PathBuf>,
}

impl EyeArgs {
    /// Returns the given eye, if there is one.
    pub fn given(&self) -> Result<Option<Prescription>, Failure> {
        if let Some(file) = &self.eye_file {
            return Ok(Some(Prescription::load(file)?));
        }
        Ok(self.prescription.clone())
    }

    /// Replaces an eye by the given one, if there is one.
    pub fn replace(&self, eye: &mut Option<Prescription>) -> Result<(), Failure> {
        if let Some(given) = self.given()? {
            *eye = Some(given).filter(|eye| !eye.is_perfect());
        }
        Ok(())
    }
}

/// The obstructions of a pupil by their names.
const OBSTRUCTIONS: Names<Obstruction, 4> = [
    (Obstruction::Lashes.name(), "Six lashes of 0.2 mm", Obstruction::Lashes),
    (Obstruction::Floaters.name(), "Twelve dots of 0.1 to 0.4 mm", Obstruction::Floaters),
    (Obstruction::Opacity.name(), "An opacity of 1 mm over the pupil's center", Obstruction::Opacity),
    (Obstruction::Scratches.name(), "Eight scratches of a lens, 0.05 mm wide", Obstruction::Scratches),
];

/// The obstruction of the pupil, in commands that show or judge what an eye sees.
#[derive(Args, Clone, Copy)]
pub struct ObstructedArgs {
    /// Opaque marks in the eye's pupil
    #[arg(help_heading = "Pupils", long, value_parser = one_of(&OBSTRUCTIONS), value_name = "WHICH")]
    pub obstructed: Option<Obstruction>,
}

/// The near values of a depth map by their names.
const NEAR: Names<Near, 4> = [
    ("bright", "Bright pixels of a picture (every value counts)", Near::Bright),
    ("dark", "Dark pixels of a picture (every value counts)", Near::Dark),
    ("large", "Large values, as in disparities", Near::Large),
    ("small", "Small values, as in distances (0 is unknown)", Near::Small),
];

/// The views that target images are made of, by their names.
const PHOTOGRAPHS: Names<ViewSynthesis, 4> = [
    (
        "auto",
        "Its own views if they are close, otherwise layers or interpolated views, chosen from the views",
        ViewSynthesis::Auto,
    ),
    ("cells", "Its own views, however far apart", ViewSynthesis::Cells),
    ("layers", "As many views as are needed, from Fourier disparity layers", ViewSynthesis::Layers),
    ("between", "As many views as are needed, interpolated with hidden content", ViewSynthesis::Between),
];

/// The scene, in every command that takes one.
#[derive(Args, Clone)]
pub struct SceneArgs {
    /// A folder of views, an array (.npy, .npz) or picture of all of them (FILE?grid=9x9), a picture with --depth-map,
    /// or builtin:NAME
    pub scene: String,
    #[command(flatten)]
    pub options: SceneOptions,
}

/// How a scene is read, in every command that loads one.
#[derive(Args, Clone, Default, PartialEq)]
pub struct SceneOptions {
    /// Depth or disparity map of a picture (PNG, EXR, PFM or .npy). Several pictures take one map each, or the folder
    /// of their maps
    #[arg(help_heading = "Scene", long, value_name = "FILE|FOLDER")]
    pub depth_map: Vec<PathBuf>,
    /// Near values of the depth map [default: bright in 8 bits, otherwise by the file's name]
    #[arg(help_heading = "Scene", long, value_parser = one_of(&NEAR), value_name = "WHICH")]
    pub near: Option<Near>,
    /// Distance of neighboring views in the pupil plane, mm [default: of the scene, otherwise eyebox / views]
    #[arg(help_heading = "Scene", long, value_name = "MM", value_parser = positive_in(MM))]
    pub view_pitch: Option<f64>,
    /// Views per axis of scenes that are rendered or reprojected [default: 9, or the number that a depth map needs, or
    /// the number that the hologram was solved with]
    #[arg(help_heading = "Scene", long, value_name = "N")]
    pub views: Option<usize>,
    /// Depth range in mm, or dioptres as in -0.02D..0.02D. The values of a depth map span this range [default: of the
    /// scene]
    #[arg(help_heading = "Scene", long, value_name = "MIN..MAX", value_parser = depths)]
    pub depth: Option<[Depth; 2]>,
    /// Order of the views of a folder, which is as-named, or transpose, flip-rows and flip-columns with commas between
    /// [default: of its lightfield.toml, otherwise as named, and refused if the pictures clearly show another order]
    #[arg(help_heading = "Scene", long, value_name = "ORDER")]
    pub order: Option<Order>,
    /// Views of a folder that target images are made of [default: auto, or the choice that the hologram was solved
    /// with]
    #[arg(help_heading = "Scene", long, value_parser = one_of(&PHOTOGRAPHS), value_name = "WHICH")]
    pub photographs: Option<ViewSynthesis>,
}

/// Opens the scene of the hologram in `file`, which is `scene` or the one that it was solved from. `force` accepts a
/// scene that the hologram was not made of.
pub fn scene_of(
    file: &Path,
    hologram: &Hologram,
    scene: Option<&str>,
    options: &SceneOptions,
    force: bool,
) -> Result<SolveInput, Failure> {
    let reading = options.reading(hologram.focal_length);
    let asked = InputOptions { scene: scene.map(str::to_owned), other_scene: force, reading };
    SolveInput::open(hologram, &asked).map_err(|error| {
        let how = match &error {
            HologramError::OtherScene { .. } | HologramError::ChangedScene { .. } => " (--force)",
            HologramError::Scene(_) => return error.into(),
            _ => "",
        };
        Failure::Arguments(Reason::of(&error).reworded(|text| format!("{}: {text}{how}", file.display())))
    })
}

/// The scene of a hologram, in commands that compare the two.
#[derive(Args, Clone)]
pub struct OwnSceneArgs {
    /// A folder of views, an array, a picture, or builtin:NAME [default: the scene that the hologram was solved from]
    pub scene: Option<String>,
    #[command(flatten)]
    pub options: SceneOptions,
}

impl SceneArgs {
    /// Returns the arguments of a scene that is read with these options.
    pub fn new(scene: &str, options: &SceneOptions) -> Self {
        Self { scene: scene.into(), options: options.clone() }
    }
}

impl SceneOptions {
    /// Returns the given depth range before a display, meters.
    pub fn depth_before(&self, display: &Display) -> Option<[f64; 2]> {
        self.depth.map(|both| both.map(|depth| depth.metres(display.focal_length)))
    }

    /// Returns the options for the library, before a display of this focal length, meters.
    pub fn reading(&self, focal_length: f64) -> SceneReading {
        SceneReading {
            views: self.views,
            view_pitch_mm: self.view_pitch,
            depth_maps: self.depth_map.clone(),
            near: self.near,
            depth: self.depth.map(|both| both.map(|depth| depth.metres(focal_length))),
            order: self.order,
            photographs: self.photographs,
        }
    }

    /// Refuses the options if there is no scene that they could apply to.
    pub fn check(&self, scene: Option<&String>) -> Result<(), Failure> {
        if scene.is_some() || *self == Self::default() {
            return Ok(());
        }
        let line = "--depth-map, --near, --view-pitch, --views, --depth, --order and --photographs are for reading a scene. Give --scene";
        Err(Failure::Arguments(Reason::new("scene-options-without-scene", line)))
    }
}

/// The table `camera` of the settings.
#[derive(Args)]
pub struct CameraSettings {
    /// Minutes from one picture to the next while a hologram is shown
    #[arg(long, default_value_t = 30.0, value_name = "MINUTES", value_parser = positive_in(MIN))]
    pub every: f64,
    /// Time that the command may take for an answer, s [default: 60, and by exposure]
    #[arg(long, value_name = "SECONDS", value_parser = positive_in(S))]
    pub timeout: Option<f64>,
    /// Pictures of a calibration at most
    #[arg(long, default_value_t = 40, value_name = "N")]
    pub pictures: usize,
    /// Place and diameter of an iris that does not move, mm, if the command does not report them
    #[arg(long, value_name = "X,Y,DIAMETER", value_parser = iris)]
    pub iris: Option<[f64; 3]>,
    /// Time from when a pattern lit up until it is stable, s
    #[arg(long, default_value_t = 0.2, value_name = "SECONDS", value_parser = not_negative_in(S))]
    pub settle: f64,
}

/// The option that replaces files in the folder of a report.
#[derive(Args, Clone, Copy)]
pub struct OverwriteArgs {
    /// Replace files in the folder that eyebox did not write, or that were changed since
    #[arg(help_heading = "Output", long)]
    pub overwrite: bool,
}
