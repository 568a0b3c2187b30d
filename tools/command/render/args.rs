//! Reads and checks the arguments of `eyebox render`.

use crate::Failure;
use crate::phases::{AtArgs, BareOpticsArgs, EncodedArgs, PhaseArgs};
use crate::subject::{self, SubjectOptions};
use crate::values::{GivenPupil, positive, pupil};
use clap::{Args, ValueEnum};
use eyebox::low_level::reason;
use std::path::{Path, PathBuf};

/// The arguments of `eyebox render`.
#[derive(Args)]
#[command(group = clap::ArgGroup::new("eye_place").required(true).args(["pupil", "path"]))]
pub struct Render {
    /// NAME.zarr (a hologram or a sequence), phases (NAME.npy or a folder of PNGs), the folder of encode, or a scene
    pub what: String,
    /// Pupil as x,y,diameter,focus in mm, or the focus in dioptres (0.5D)
    #[arg(help_heading = "Pupils", long, value_name = "X,Y,D,Z", value_parser = pupil)]
    pub pupil: Option<GivenPupil>,
    /// Path of the eye in a film. It is a JSON file with keys, such as {"keys": [{"t_s": 0, "x_mm": -4}, {"t_s": 2,
    /// "x_mm": 4}]}
    #[arg(help_heading = "Pupils", long, value_name = "FILE.json")]
    pub path: Option<PathBuf>,
    /// Content (image, target, or both side by side). The image is the hologram's, and the target is the scene's. A
    /// scene is solved first if its image is rendered [default: both for a film, target for a scene, image for a
    /// hologram]
    #[arg(help_heading = "Output", long = "what", value_enum, value_name = "CONTENT", hide_possible_values = true)]
    pub content: Option<RenderedContent>,
    #[command(flatten)]
    pub which: AtArgs,
    /// Output file of a picture (PNG) or of the intensity (.npy, float32, no exposure). With --path, NAME.y4m or a
    /// folder for one PNG per frame
    #[arg(help_heading = "Output", short, long, value_name = "OUT")]
    pub out: PathBuf,
    /// Number of pixels along each axis whose mean becomes one pixel, with --path
    #[arg(help_heading = "Output", long, default_value_t = 1, value_name = "N", requires = "path")]
    pub binning: usize,
    #[command(flatten)]
    pub how: SubjectOptions,
    #[command(flatten)]
    pub optics: BareOpticsArgs,
    #[command(flatten)]
    pub encoded: EncodedArgs,
    /// Exposure of the PNG [default: the hologram's, or if it is not known, the 99th percentile becomes white]
    #[arg(help_heading = "Bare phases", long, value_parser = positive)]
    pub exposure: Option<f64>,
    /// Ignore the display's model, as if the display were ideal
    #[arg(help_heading = "Display", long)]
    pub ideal: bool,
    /// One JSON object on standard output, no progress bar
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// The content of a render.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RenderedContent {
    /// Image of the hologram
    Image,
    /// Target image of the scene
    Target,
    /// Both, the image on the left
    Both,
}

impl Render {
    /// Returns the options of bare phases.
    pub fn phases(&self) -> PhaseArgs {
        let how = &self.how;
        PhaseArgs { display: how.display.clone(), unit: how.unit, optics: self.optics.clone() }
    }

    /// Returns whether it is a hologram, bare phases or video frames, and no scene.
    pub fn is_hologram(&self) -> bool {
        subject::is_phases(&self.what, &self.how, &self.optics, &self.encoded)
    }

    /// Refuses options that a film, or a scene, does not have.
    pub fn check(&self) -> Result<(), Failure> {
        let of_pictures = [
            (self.which.at.is_some(), "--at"),
            (self.encoded.are_at(Path::new(&self.what)) || self.encoded.as_shown.is_some(), "video frames"),
            (self.optics.is_given(), "--pitch, --wavelength or --focal-length"),
            (self.exposure.is_some(), "--exposure"),
            (self.ideal, "--ideal"),
        ];
        let Some((_, option)) = of_pictures.into_iter().find(|(given, _)| *given) else { return Ok(()) };
        if self.path.is_some() {
            return Err(Failure::Arguments(reason!(
                "with-path",
                "{option} is for one picture. Leave it out, or --path"
            )));
        }
        if !self.is_hologram() {
            let what = &self.what;
            return Err(Failure::Arguments(reason!(
                "of-holograms",
                "{option} is for a hologram, and {what} is a scene"
            )));
        }
        Ok(())
    }
}

impl RenderedContent {
    /// Returns the content in words.
    pub fn in_words(self) -> &'static str {
        match self {
            Self::Image => "the image",
            Self::Target => "the target image",
            Self::Both => "left the image, right the target image",
        }
    }
}
