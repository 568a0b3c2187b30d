//! Reads the arguments of `eyebox preview`.

use crate::args::ObstructedArgs;
use crate::phases::{AtArgs, BareOpticsArgs, EncodedArgs, PhaseArgs};
use crate::subject::{self, SubjectOptions};
use crate::values::{GivenPupil, positive, pupil, rate, size};
use clap::Args;
use eyebox::low_level::present::Rate;
use std::path::PathBuf;

/// The arguments of `eyebox preview`.
#[derive(Args)]
pub struct Preview {
    /// NAME.zarr (a hologram or a sequence), phases (NAME.npy or a folder of PNGs), or a scene, which is solved first
    pub what: String,
    #[command(flatten)]
    pub which: AtArgs,
    /// Pupil to begin with, as x,y,diameter,focus in mm, or the focus in dioptres (0.5D)
    #[arg(help_heading = "Pupils", long, value_name = "X,Y,D,Z", value_parser = pupil, default_value = "0,0,4,0")]
    pub pupil: GivenPupil,
    #[command(flatten)]
    pub how: SubjectOptions,
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
    pub optics: BareOpticsArgs,
    #[command(flatten)]
    pub encoded: EncodedArgs,
    /// Exposure of the picture [default: the hologram's, or if it is not known, the 99th percentile of the first
    /// picture becomes white]
    #[arg(help_heading = "Bare phases", long, value_parser = positive)]
    pub exposure: Option<f64>,
    #[command(flatten)]
    pub obstructions: ObstructedArgs,
    /// Check the use of Vulkan, and print the faults
    #[arg(help_heading = "Display", long)]
    pub validation: bool,
}

impl Preview {
    /// Returns the options of bare phases.
    pub fn phases(&self) -> PhaseArgs {
        let how = &self.how;
        PhaseArgs { display: how.display.clone(), unit: how.unit, optics: self.optics.clone() }
    }

    /// Returns whether it is a hologram, bare phases or video frames, and no scene.
    pub fn is_hologram(&self) -> bool {
        subject::is_phases(&self.what, &self.how, &self.optics, &self.encoded)
    }
}
