//! Reads the arguments of `eyebox preview`.

use crate::args::{EngineArgs, EyeArgs, ObstructedArgs, SceneOptions};
use crate::phases::{AtArgs, EncodedArgs, PhaseArgs};
use crate::values::{GivenPupil, positive, pupil, rate, size};
use clap::Args;
use eyebox::low_level::present::Rate;
use std::path::PathBuf;

/// The arguments of `eyebox preview`.
#[derive(Args)]
pub struct Preview {
    /// NAME.zarr (a hologram or a sequence), or phases (NAME.npy or a folder of PNGs)
    pub file: PathBuf,
    #[command(flatten)]
    pub which: AtArgs,
    /// Pupil to begin with, as x,y,diameter,focus in mm, or the focus in dioptres (0.5D)
    #[arg(help_heading = "Pupils", long, value_name = "X,Y,D,Z", value_parser = pupil, default_value = "0,0,4,0")]
    pub pupil: GivenPupil,
    /// Scene of the hologram (a folder of views, a picture, or builtin:NAME) for its target image and the PSNR
    #[arg(help_heading = "Scene", long, value_name = "SCENE")]
    pub scene: Option<String>,
    #[command(flatten)]
    pub options: SceneOptions,
    /// Inside of the window, rows x columns [default: fitted to the hologram and the monitor]
    #[arg(help_heading = "Window", long, value_name = "HxW", value_parser = size, conflicts_with = "zoom")]
    pub window: Option<[usize; 2]>,
    /// Pixels of the window per pixel of the hologram, along each axis
    #[arg(help_heading = "Window", long, value_name = "FACTOR", value_parser = positive)]
    pub zoom: Option<f64>,
    /// Holograms per second [default: of the sequence]
    #[arg(help_heading = "Time", long, value_name = "HZ", value_parser = rate)]
    pub rate: Option<Rate>,
    /// Output folder of the PNGs of the key s
    #[arg(help_heading = "Output", short, long, value_name = "OUT_DIR", default_value = ".")]
    pub out: PathBuf,
    #[command(flatten)]
    pub phases: PhaseArgs,
    #[command(flatten)]
    pub encoded: EncodedArgs,
    /// Exposure of the picture [default: the hologram's, or if it is not known, the 99th percentile of the first
    /// picture becomes white]
    #[arg(help_heading = "Bare phases", long, value_parser = positive)]
    pub exposure: Option<f64>,
    #[command(flatten)]
    pub eye: EyeArgs,
    #[command(flatten)]
    pub obstructions: ObstructedArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// Check the use of Vulkan, and print the faults
    #[arg(help_heading = "Display", long)]
    pub validation: bool,
}
