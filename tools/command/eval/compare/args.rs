//! Reads the arguments of `eyebox eval compare`.

use crate::args::{DisplayArgs, EngineArgs, EyeArgs, OverwriteArgs, SceneArgs, SceneOptions};
use crate::experiment::ExperimentArgs;
use crate::jod::JodArgs;
use crate::phases::PhaseUnitArgs;
use crate::quality::QualityArgs;
use crate::values::{MM, diameters, number_in, positive};
use clap::Args;
use eyebox_lab::comparison::MaskKind;
use std::path::PathBuf;

/// The arguments of `eyebox eval compare`.
#[derive(Args)]
pub struct Compare {
    /// Scenes (folders of views, a picture with --depth-map, or builtin:NAME)
    #[arg(required = true, value_name = "SCENE")]
    pub scenes: Vec<String>,
    /// Output folder of the report and its data. Results that exist are not computed again
    #[arg(help_heading = "Output", short, long, value_name = "OUT_DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Ignore the display's model, as if the display were ideal, and solve for that
    #[arg(help_heading = "Display", long)]
    pub ideal: bool,
    #[command(flatten)]
    pub eye: EyeArgs,
    /// Methods to solve with [default: slfh,lf2fs,stft,smooth,dpac, behind a mask slfh,lf2fs,smooth, with --hologram
    /// none]
    #[arg(help_heading = "Scene", long, value_name = "LIST", value_delimiter = ',')]
    pub methods: Option<Vec<String>>,
    /// Sub-frames, or several numbers of them to compare
    #[arg(help_heading = "Quality", long, value_name = "LIST", value_delimiter = ',', default_value = "8")]
    pub frames: Vec<usize>,
    /// All colors at once are compared with one color after another, with the same lasers and number of sub-frames.
    /// TIMES is the brightness of white, and several numbers have commas between. Methods are then none by default
    /// [alone: 1,3]
    #[arg(help_heading = "Quality", long, value_name = "TIMES", value_delimiter = ',', num_args = 0..=1, require_equals = true, default_missing_value = "1,3", value_parser = positive)]
    pub joint_color: Option<Vec<f64>>,
    /// Existing hologram, or phases (.npy) for --display, with its name in the report. The option may be repeated
    #[arg(help_heading = "Scene", long, value_name = "NAME=FILE", value_parser = named)]
    pub hologram: Vec<(String, PathBuf)>,
    #[command(flatten)]
    pub display: DisplayArgs,
    #[command(flatten)]
    pub unit: PhaseUnitArgs,
    #[command(flatten)]
    pub options: SceneOptions,
    /// The quality determines steps, pupils, their diameters, window and optimizer of every iterative method. All views
    /// and sub-frames stay.
    #[command(flatten)]
    pub quality: QualityArgs,
    /// Steps of every iterative method [default: 60]
    #[arg(help_heading = "Steps", long, value_name = "N")]
    pub steps: Option<usize>,
    /// Pupils per step of every iterative method [default: 16]
    #[arg(help_heading = "Pupils", long, value_name = "B")]
    pub pupils: Option<usize>,
    /// Pupil diameters of random pupils, mm [default: 2..20, or what fits the eyebox]
    #[arg(help_heading = "Pupils", long, value_name = "MIN..MAX", value_parser = diameters)]
    pub pupil_diameter: Option<[f64; 2]>,
    /// Seed of first phases and of the pupils drawn
    #[arg(help_heading = "Steps", long, default_value_t = 0, value_name = "S")]
    pub seed: u64,
    #[command(flatten)]
    pub seen: JodArgs,
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output, no progress bar
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// The table `compare` of the settings.
#[derive(Args)]
pub struct CompareSettings {
    /// Sizes of sources to compare, mm. A size is the side of a square source's image in the eyebox, 0 for a point.
    /// Each size is solved for and seen in its own light. Methods are then none by default
    #[arg(help_heading = "Quality", long, value_name = "MM", value_parser = number_in(MM), value_delimiter = ',')]
    pub coherence: Option<Vec<f64>>,
    /// Factors of the phase masks to compare, 1 for none, 2 to 4, with a d for a designed mask. Each mask is solved for
    /// and measured over its whole eyebox. Methods are then none by default
    #[arg(help_heading = "Quality", long, value_name = "FACTOR", value_delimiter = ',')]
    pub etendue: Option<Vec<MaskKind>>,
    /// Measure across the eyebox of the display's switchable sources, too, with the sources lit for the pupil, in turn
    /// and together. Methods are then none by default
    #[arg(help_heading = "Quality", long)]
    pub sources: bool,
    /// Published numbers to draw next to the measured ones, with the columns
    /// method,category,n,mean,median,q25,q75,min,max,std
    #[arg(help_heading = "Scene", long, value_name = "CSV")]
    pub reference: Option<PathBuf>,
    /// Measure the speckle of an even plane
    #[arg(long, default_value_t = true, action = clap::ArgAction::Set, value_name = "true|false")]
    pub speckle: bool,
}

impl Compare {
    /// Returns one of the scenes with its depth map, as other commands take it.
    pub fn scene(&self, index: usize, map: Option<&PathBuf>) -> SceneArgs {
        let depth_map = map.cloned().into_iter().collect();
        SceneArgs::new(&self.scenes[index], &SceneOptions { depth_map, ..self.options.clone() })
    }
}

fn named(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, file)) if !name.trim().is_empty() && !file.is_empty() => Ok((name.trim().into(), file.into())),
        _ => Err("expected NAME=FILE".into()),
    }
}
