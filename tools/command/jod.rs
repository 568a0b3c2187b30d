//! What every command that judges in JOD asks.

use crate::Failure;
use crate::values::{CD_M2, not_negative_in, positive, positive_in};
use clap::{Args, ValueEnum};
use eyebox::low_level::optics::Viewing;

/// Pupils that are judged in JOD.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum JudgedPupils {
    /// Every pupil
    All,
    /// Some, spread evenly over the others
    #[default]
    Some,
    /// No pupil
    None,
}

/// Whether and how pictures are judged by what people see of their differences.
#[derive(Args, Clone, Copy, Default, PartialEq)]
pub struct JodArgs {
    /// Pupils that are judged in just-objectionable differences (ColorVideoVDP): all, some (spread evenly over the others), or none
    /// (PSNR and SSIM alone, which is faster)
    #[arg(
        help_heading = "Quality",
        long,
        value_enum,
        default_value = "some",
        hide_possible_values = true,
        value_name = "WHICH"
    )]
    pub jod: JudgedPupils,
}

/// The table `viewing` of the settings: how a display is seen, instead of the values of its file.
#[derive(Args, Clone, Copy, Default, PartialEq)]
pub struct ViewingArgs {
    /// Luminance of white, cd/m2, as JOD and contrast are seen [default: the display file's, else 200]
    #[arg(help_heading = "Quality", long, value_name = "CD/M2", value_parser = positive_in(CD_M2))]
    pub luminance: Option<f64>,
    /// Luminance of black, cd/m2 [default: the display file's, else 0.2]
    #[arg(help_heading = "Quality", long, value_name = "CD/M2", value_parser = not_negative_in(CD_M2))]
    pub black: Option<f64>,
    /// Pixels a degree, as if the picture were seen that large [default: the display file's, else its optics']
    #[arg(help_heading = "Quality", long, value_name = "N", value_parser = positive)]
    pub pixels_per_degree: Option<f64>,
}

impl JodArgs {
    /// How many pupils are judged, where `some` are by default.
    pub fn pupils(&self, some: usize) -> usize {
        match self.jod {
            JudgedPupils::None => 0,
            JudgedPupils::All => usize::MAX,
            JudgedPupils::Some => some,
        }
    }
}

impl ViewingArgs {
    /// What is given in the place of what is known.
    pub fn over(&self, known: Viewing) -> Result<Viewing, Failure> {
        Ok(known.with(self.luminance, self.black, self.pixels_per_degree)?)
    }
}
