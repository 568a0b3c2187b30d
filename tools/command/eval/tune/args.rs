//! The arguments of `eyebox eval tune`.

use crate::args::{DisplayArgs, EngineArgs, OverwriteArgs, SceneArgs};
use crate::experiment::ExperimentArgs;
use crate::jod::JodArgs;
use crate::values::{S, diameters, positive_in};
use clap::Args;
use std::path::PathBuf;

/// `eyebox eval tune`
#[derive(Args)]
pub struct Tune {
    /// Scene
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Output folder of the page, the numbers, and the state that an interrupted run continues from
    #[arg(help_heading = "Output", short, long, value_name = "OUT_DIR")]
    pub out: PathBuf,
    /// Files of others
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Stop after this time, s
    #[arg(help_heading = "Quality", long, value_name = "S", value_parser = positive_in(S), default_value_t = 250.0)]
    pub duration: f64,
    /// Display; of all its colors, green is tried, or the middle one
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
    /// What else belongs to the experiment
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    /// Measure the three settings of another run (its tradeoff.json) here too, and say how far from this front they are
    #[arg(help_heading = "Quality", long, value_name = "FILE")]
    pub check: Option<PathBuf>,
    /// Do not keep the recommended settings for --quality
    #[arg(help_heading = "Quality", long)]
    pub no_store: bool,
    /// How it is judged by what people see
    #[command(flatten)]
    pub seen: JodArgs,
    /// Engine
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output, no progress bar
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}
