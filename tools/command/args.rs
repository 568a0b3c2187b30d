//! The arguments of commands. Options are in millimeters, micrometers and nanometers.

use crate::display::patterns::PatternArgs;
use crate::experiment::ExperimentArgs;
pub use crate::groups::{
    Colors, DeviceArgs, DisplayArgs, EngineArgs, EngineName, EyeArgs, ObstructedArgs, OverwriteArgs, OwnSceneArgs,
    SceneArgs, SceneOptions, scene_of,
};
use crate::jod::JodArgs;
use crate::phases::{AtArgs, EncodedArgs, PhaseArgs, PhaseUnitArgs, UnfinishedArgs};
use crate::quality::QualityArgs;
use crate::values::{
    GivenPupil, HZ, S, TermsOfModel, decibels, diameters, gaze, memory, method, model_terms, positive, positive_in,
    pupil, rate, share, size,
};
use clap::Args;
use clap::builder::TypedValueParser;
use eyebox::low_level::hologram::Start;
use eyebox::low_level::optics::Color;
use eyebox::low_level::present::Rate;
use eyebox::low_level::solve::Method;
use std::path::PathBuf;

/// The arguments of `eyebox demo`.
#[derive(Args)]
pub struct Demo {
    /// Output folder of the hologram and the pictures
    #[arg(help_heading = "Output", long, default_value = "demo", value_name = "OUT_DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Resolution of the hologram, which is a square
    #[arg(help_heading = "Display", long, default_value = "512", value_name = "HxW", value_parser = size)]
    pub size: [usize; 2],
    #[command(flatten)]
    pub quality: QualityArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

fn warm(text: &str) -> Result<Start, String> {
    if text == "cold" { Ok(Start::Cold) } else { share(text).map(Start::Warm).map_err(|e| format!("{e}, or cold")) }
}

/// The arguments of `eyebox solve`.
#[derive(Args)]
pub struct Solve {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// More scenes, which make a sequence with the first one
    #[arg(value_name = "SCENE")]
    pub more: Vec<String>,
    /// Output file NAME.zarr, or NAME.npy for the phases of one hologram
    #[arg(help_heading = "Output", short, long, value_name = "OUT", default_value = "hologram.zarr")]
    pub out: PathBuf,
    /// Holograms per second of a sequence
    #[arg(help_heading = "Time", long, value_name = "HZ", value_parser = rate, default_value = "30")]
    pub rate: Rate,
    /// Place in the step schedule at which later frames of a sequence begin, 0 to 1. They start from the frame before.
    /// With cold, they start from random phases
    #[arg(help_heading = "Steps", long, value_name = "SHARE|cold", value_parser = warm, default_value = "0")]
    pub warm_start: Start,
    #[command(flatten)]
    pub display: DisplayArgs,
    #[command(flatten)]
    pub eye: EyeArgs,
    #[command(flatten)]
    pub quality: QualityArgs,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// Memory limit of a far-field solve, which then works region by region in its file. The same command resumes an
    /// interrupted solve [default: 4GiB if the hologram is larger, otherwise no limit]
    #[arg(help_heading = "Steps", long, value_name = "AMOUNT", value_parser = memory)]
    pub memory: Option<u64>,
    #[command(flatten)]
    pub camera: CameraArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output, no progress bar
    #[arg(help_heading = "Output", long)]
    pub json: bool,
    /// Print the plan, its reasons, time and memory. Nothing is solved
    #[arg(help_heading = "Output", long)]
    pub dry_run: bool,
    /// Time the engine of this machine again, with --dry-run
    #[arg(help_heading = "Engine", long, requires = "dry_run")]
    pub time_again: bool,
    /// Time per kernel, after the solve
    #[arg(help_heading = "Output", long)]
    pub timings: bool,
}

/// The settings of a solve.
#[derive(Args)]
pub struct SettingsArgs {
    /// Sub-frames, optimized jointly on their mean intensity [default: 8]
    #[arg(help_heading = "Quality", long, value_name = "F")]
    pub frames: Option<usize>,
    /// All colors at once (simultaneous color). Every laser lights every sub-frame, and phases and laser powers are
    /// solved together. TIMES is the brightness of white relative to one color after another with the same lasers, 1
    /// to the number of colors [alone: 1]
    #[arg(help_heading = "Quality", long, value_name = "TIMES", num_args = 0..=1, require_equals = true, default_missing_value = "1", value_parser = positive, conflicts_with = "camera")]
    pub joint_color: Option<f64>,
    /// Method of supervision (slfh, lf2fs, stft, stft-unfiltered, stft-exact, smooth, dpac or pupil-aware) [default:
    /// slfh]
    #[arg(help_heading = "Quality", long, value_parser = method, value_name = "NAME")]
    pub method: Option<Method>,
    /// Terms of the display's model that the solver uses (all, auto, none, or their names with commas). With auto, a
    /// measurement of some seconds keeps terms that gain 0.05 dB on this scene, and sub-pixels that gain 0.2 dB
    #[arg(help_heading = "Display", long, value_name = "all|auto|none|LIST", value_parser = model_terms, default_value = "all")]
    pub model_terms: TermsOfModel,
    /// Pupils per step [default: 16, with adam 8]
    #[arg(help_heading = "Pupils", long, value_name = "B")]
    pub pupils: Option<usize>,
    /// Steps at most [default: 60, with adam 200]
    #[arg(help_heading = "Steps", long, value_name = "N")]
    pub steps: Option<usize>,
    /// Stop after this time, s, shared by the colors
    #[arg(help_heading = "Steps", long, value_name = "S", value_parser = positive_in(S))]
    pub duration: Option<f64>,
    /// Stop at this mean PSNR over validation pupils, dB
    #[arg(help_heading = "Steps", long, value_name = "DB", value_parser = decibels)]
    pub psnr: Option<f64>,
    /// Pupil diameters drawn, mm [default: 2..20, or what fits the eyebox]
    #[arg(help_heading = "Pupils", long, value_name = "MIN..MAX", value_parser = diameters)]
    pub pupil_diameter: Option<[f64; 2]>,
    /// Seed of the first phases and of the pupils [default: 0]
    #[arg(help_heading = "Steps", long, value_name = "S")]
    pub seed: Option<u64>,
    #[command(flatten)]
    pub experiment: ExperimentArgs,
}

/// The options of the camera for the last steps.
#[derive(Args)]
pub struct CameraArgs {
    /// Command of a camera behind the display, which takes part in --camera-steps after the solve (docs/calibrate.md)
    #[arg(help_heading = "Camera", long, value_name = "COMMAND", requires = "camera_steps")]
    pub camera: Option<String>,
    /// Steps with the camera's pictures instead of the model's images
    #[arg(help_heading = "Camera", long, value_name = "N", requires = "camera", value_parser = clap::value_parser!(u16).range(1..).map(usize::from))]
    pub camera_steps: Option<usize>,
    #[command(flatten)]
    pub patterns: PatternArgs,
    /// Keep the camera's pictures in this folder. Pictures are added to the folder of a calibration, and its dots
    /// determine where the camera looks
    #[arg(help_heading = "Camera", long, value_name = "OUT_DIR", requires = "camera")]
    pub keep: Option<PathBuf>,
}

/// The table `tiles` of the settings.
#[derive(Args)]
pub struct TilesSettings {
    /// Passes over the SLM [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..).map(usize::from))]
    pub passes: Option<usize>,
    /// Pixels along each axis of the scene's views [default: 1024, or the display's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(16..=16384).map(usize::from))]
    pub picture: Option<usize>,
}

/// The arguments of `eyebox encode`.
#[derive(Args)]
pub struct Encode {
    /// NAME.zarr, or phases as NAME.npy or a folder of PNGs
    pub hologram: PathBuf,
    #[command(flatten)]
    pub which: AtArgs,
    /// Output folder of the video frames, which appears only when it is complete
    #[arg(help_heading = "Output", short, long, value_name = "OUT_DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub display: DisplayArgs,
    #[command(flatten)]
    pub unit: PhaseUnitArgs,
    #[command(flatten)]
    pub unfinished: UnfinishedArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output, with the content of each frame
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// The arguments of `eyebox bench`.
#[derive(Args)]
pub struct Bench {
    /// The arguments of the solve. With `--dry-run` the steps are recorded and none is run. The report then has the
    /// dispatches, barriers, bytes and submissions, and the time that GPUs would take.
    #[command(flatten)]
    pub solve: Solve,
    /// Rounds of the measurement
    #[arg(help_heading = "Engine", long, default_value_t = 3, value_name = "N")]
    pub rounds: usize,
    /// Command to run in turn with each round
    #[arg(help_heading = "Engine", long, value_name = "COMMAND", conflicts_with = "dry_run")]
    pub beside: Option<String>,
    /// Pupil of a refinement whose steps --dry-run records, as x,y,diameter,focus in mm, or the focus in dioptres
    /// (0.5D)
    #[arg(help_heading = "Pupils", long, value_name = "X,Y,D,Z", value_parser = pupil, requires = "dry_run")]
    pub pupil: Option<GivenPupil>,
}

/// The arguments of `eyebox eval score`.
#[derive(Args)]
pub struct Score {
    /// NAME.zarr, phases (NAME.npy or a folder of PNGs, with --display), or the folder of encode
    pub hologram: PathBuf,
    #[command(flatten)]
    pub which: AtArgs,
    #[command(flatten)]
    pub scene: OwnSceneArgs,
    /// Ignore the display's model, as if the display were ideal
    #[arg(help_heading = "Display", long)]
    pub ideal: bool,
    #[command(flatten)]
    pub eye: EyeArgs,
    #[command(flatten)]
    pub obstructions: ObstructedArgs,
    /// Pupils of the measurement (random:N or a JSON file). The file has a list of [x, y, diameter, focus] in mm, or
    /// the focus as "0.5D"
    #[arg(help_heading = "Pupils", long, default_value = "random:16", value_name = "PUPILS")]
    pub test_pupils: String,
    /// Pupil diameters of random pupils, mm [default: 2..20, or what fits the eyebox]
    #[arg(help_heading = "Pupils", long, value_name = "MIN..MAX", value_parser = diameters)]
    pub pupil_diameter: Option<[f64; 2]>,
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    /// Seed of random pupils
    #[arg(help_heading = "Steps", long, default_value_t = 1000, value_name = "S")]
    pub seed: u64,
    #[command(flatten)]
    pub seen: JodArgs,
    /// Judge the sub-frames as a video with this rate, Hz [default: their mean, as seen by an eye that is too slow for
    /// all flicker]
    #[arg(help_heading = "Quality", long, value_name = "HZ", value_parser = positive_in(HZ))]
    pub sub_frame_rate: Option<f64>,
    /// Gaze in degrees right of and below the picture's middle. The 5 by 5 degrees around it are judged alone, too
    #[arg(help_heading = "Quality", long, value_parser = gaze, value_name = "X,Y")]
    pub gaze: Option<[f64; 2]>,
    /// Output folder of maps of the lost JOD, one picture for each judged pupil
    #[arg(help_heading = "Output", long, value_name = "OUT_DIR")]
    pub jod_maps: Option<PathBuf>,
    #[command(flatten)]
    pub phases: PhaseArgs,
    #[command(flatten)]
    pub encoded: EncodedArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

impl Colors {
    /// Returns the single color, or None for all of them.
    pub fn one(self) -> Option<Color> {
        match self {
            Self::Red => Some(Color::Red),
            Self::Green => Some(Color::Green),
            Self::Blue => Some(Color::Blue),
            Self::All => None,
        }
    }
}
