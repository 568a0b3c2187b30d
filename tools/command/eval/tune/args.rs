//! Reads the arguments of `eyebox eval tune`.

use crate::args::{DisplayArgs, EngineArgs, OverwriteArgs, SceneArgs};
use crate::experiment::ExperimentArgs;
use crate::jod::JodArgs;
use crate::values::{S, diameters, positive_in};
use clap::Args;
use std::path::PathBuf;

/// The arguments of `eyebox eval tune`.
#[derive(Args)]
pub struct Tune {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Output folder of the page, the numbers, and the state that an interrupted run continues from
    #[arg(help_heading = "Output", short, long, value_name = "OUT_DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Stop after this time, s
    #[arg(help_heading = "Quality", long, value_name = "S", value_parser = positive_in(S), default_value_t = 250.0)]
    pub duration: f64,
    /// The display. If it has all colors, only green is tried, or the middle one.
    #[command(flatten)]
    pub display: DisplayArgs,
    /// Sub-frames shown [default: 8]
    #[arg(help_heading = "Quality", long, value_name = "F")]
    pub frames: Option<usize>,
    /// Pupil diameters, mm [default: 2..20, or what fits the eyebox]
    #[arg(help_heading = "Pupils", long, value_name = "MIN..MAX", value_parser = diameters)]
    pub pupil_diameter: Option<[f64; 2]>,
    /// Seed of first phases, of the pupils drawn, and of the pupils that judge [default: 0]
    #[arg(help_heading = "Steps", long, value_name = "S")]
    pub seed: Option<u64>,
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    /// Measure the three settings of another run (its tradeoff.json), too, and print their distance from this front
    #[arg(help_heading = "Quality", long, value_name = "FILE")]
    pub check: Option<PathBuf>,
    /// Do not keep the recommended settings for --quality
    #[arg(help_heading = "Quality", long)]
    pub no_store: bool,
    #[command(flatten)]
    pub seen: JodArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output, no progress bar
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}
