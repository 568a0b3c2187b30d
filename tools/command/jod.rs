//! Options of commands that judge in JOD (just-objectionable differences).

use crate::Failure;
use crate::values::{CD_M2, not_negative_in, positive, positive_in};
use clap::{Args, ValueEnum};
use eyebox::low_level::optics::Viewing;

/// Pupils that are judged in JOD.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum JudgedPupils {
    /// All of the pupils
    All,
    /// Some, spread evenly over the others
    #[default]
    Some,
    /// No pupil at all
    None,
}

/// The pupils whose pictures are judged by visible differences.
#[derive(Args, Clone, Copy, Default, PartialEq)]
pub struct JodArgs {
    /// Pupils judged in just-objectionable differences (ColorVideoVDP), which are all, some (spread evenly over the
    /// others), or none (PSNR and SSIM alone, which is faster)
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

/// The table `viewing` of the settings. Its values replace the viewing conditions of the display file.
#[derive(Args, Clone, Copy, Default, PartialEq)]
pub struct ViewingArgs {
    /// Luminance of white for JOD and contrast, cd/m2 [default: the display file's, otherwise 200]
    #[arg(help_heading = "Quality", long, value_name = "CD/M2", value_parser = positive_in(CD_M2))]
    pub luminance: Option<f64>,
    /// Luminance of black, cd/m2 [default: the display file's, otherwise 0.2]
    #[arg(help_heading = "Quality", long, value_name = "CD/M2", value_parser = not_negative_in(CD_M2))]
    pub black: Option<f64>,
    /// Pixels per degree at which the picture is seen [default: the display file's, otherwise of its optics]
    #[arg(help_heading = "Quality", long, value_name = "N", value_parser = positive)]
    pub pixels_per_degree: Option<f64>,
}

impl JodArgs {
    /// Returns the number of judged pupils. `some` is the number for [`JudgedPupils::Some`].
    pub fn pupils(&self, some: usize) -> usize {
        match self.jod {
            JudgedPupils::None => 0,
            JudgedPupils::All => usize::MAX,
            JudgedPupils::Some => some,
        }
    }
}

impl ViewingArgs {
    /// Returns the known values, replaced by the given ones.
    pub fn over(&self, known: Viewing) -> Result<Viewing, Failure> {
        Ok(known.with(self.luminance, self.black, self.pixels_per_degree)?)
    }
}
