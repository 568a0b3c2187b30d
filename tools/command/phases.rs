//! Options for the optics and the unit of bare phases, which their files do not have.

use crate::Failure;
use crate::common;
use crate::groups::DisplayArgs;
use crate::values::{MM, NM, UM, as_shown, number_in, phase_unit};
use clap::{Args, ValueEnum};
use eyebox::low_level::encode::AsShown;
use eyebox::low_level::encoded::{Encoded, is_encoded};
use eyebox::low_level::error::Reason;
use eyebox::low_level::hologram::{BareOptics, HologramError, Opening, PhaseSource, PhaseUnit, Phases, Unfinished};
use eyebox::low_level::optics::{Color, Display, Geometry, Optics};
use eyebox::low_level::reason;
use std::path::Path;

/// The place of an SLM by its name.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GeometryName {
    /// Behind a 4f relay
    Relay,
    /// In the pupil plane
    FarField,
}

/// The unit of bare phases, in commands that have a display anyway.
#[derive(Args, Clone, Copy)]
pub struct PhaseUnitArgs {
    /// Unit of bare phases (rad, turns, deg, or the number of levels per turn) [default: rad for .npy if the values
    /// fit, 256 for pictures]
    #[arg(help_heading = "Bare phases", long, value_name = "UNIT", value_parser = phase_unit)]
    pub phase_unit: Option<PhaseUnit>,
}

/// The display, the unit and the optics of bare phases.
#[derive(Args)]
pub struct PhaseArgs {
    #[command(flatten)]
    pub display: DisplayArgs,
    #[command(flatten)]
    pub unit: PhaseUnitArgs,
    #[command(flatten)]
    pub optics: BareOpticsArgs,
}

/// Optics of bare phases without a display.
#[derive(Args, Clone)]
pub struct BareOpticsArgs {
    /// Pixel pitch, um, without --display
    #[arg(help_heading = "Bare phases", long, value_name = "UM", value_parser = number_in(UM), conflicts_with = "display")]
    pub pitch: Option<f64>,
    /// Wavelength, nm, without --display, one per color
    #[arg(help_heading = "Bare phases", long, value_name = "NM", value_parser = number_in(NM), value_delimiter = ',', conflicts_with = "display")]
    pub wavelength: Vec<f64>,
    /// Focal length, mm, without --display
    #[arg(help_heading = "Bare phases", long, value_name = "MM", value_parser = number_in(MM), conflicts_with = "display")]
    pub focal_length: Option<f64>,
    /// Place of the SLM, without --display
    #[arg(help_heading = "Bare phases", long, value_enum, default_value_t = GeometryName::Relay, conflicts_with = "display")]
    pub geometry: GeometryName,
}

impl BareOpticsArgs {
    /// Returns whether any of them is given.
    pub fn is_given(&self) -> bool {
        self.pitch.is_some() || self.focal_length.is_some() || !self.wavelength.is_empty()
    }
}

/// The choice of one hologram of a sequence.
#[derive(Args, Clone, Copy)]
pub struct AtArgs {
    /// Number of the hologram in a sequence, from 0
    #[arg(help_heading = "Output", long, value_name = "N")]
    pub at: Option<u64>,
}

/// The option for holograms that are not finished.
#[derive(Args, Clone, Copy)]
pub struct UnfinishedArgs {
    /// Accept a sequence, or a hologram in tiles, that is not finished
    #[arg(help_heading = "Scene", long)]
    pub unfinished: bool,
}

impl UnfinishedArgs {
    /// Returns the failure for an error. It names the option if the hologram is unfinished.
    pub fn failure(self, error: HologramError) -> Failure {
        match error {
            HologramError::Unfinished { .. } => {
                Failure::Arguments(reason!("unfinished", "{error}, or accept it as it is with --unfinished"))
            }
            other => other.into(),
        }
    }
}

/// Prints how much of an unfinished hologram is done. The command uses it all the same.
pub fn tell_unfinished(file: &Path) -> Result<Option<Unfinished>, Failure> {
    let unfinished = Unfinished::at(file)?;
    if let Some(how_far) = unfinished {
        eprintln!("{}: unfinished: {how_far}", file.display());
    }
    Ok(unfinished)
}

/// The options for video frames instead of a hologram.
#[derive(Args)]
pub struct EncodedArgs {
    /// Read PNGs of any origin as video frames for --display. The folder of `encode` needs no option
    #[arg(help_heading = "Video frames", long)]
    pub encoded: bool,
    /// Keep gratings, corrections, turns, or all in video frames as the SLM shows them, instead of undoing them
    #[arg(help_heading = "Video frames", long, value_name = "PARTS", num_args = 0..=1, require_equals = true, default_missing_value = "all", value_parser = as_shown)]
    pub as_shown: Option<AsShown>,
}

impl EncodedArgs {
    /// Returns whether `file` holds video frames.
    pub fn are_at(&self, file: &Path) -> bool {
        self.encoded || is_encoded(file)
    }

    /// Opens the phases in `file`. Video frames are decoded. Other files are opened with the options in `phases`, and a
    /// line states how much of an unfinished one is done.
    pub fn source(&self, phases: &PhaseArgs, file: &Path, at: Option<u64>) -> Result<PhaseSource<'static>, Failure> {
        let wrong = |reason: Reason| Err(Failure::Arguments(reason.within(file.display())));
        if !self.are_at(file) {
            if self.as_shown.is_some() {
                return wrong(reason!(
                    "as-shown-of-phases",
                    "--as-shown is for video frames. Give --encoded if it holds some"
                ));
            }
            tell_unfinished(file)?;
            return Ok(Opening { unfinished: true, ..phases.opening(file, at)? }.source(file)?);
        }
        if at.is_some() || phases.unit.phase_unit.is_some() || phases.optics.is_given() {
            return wrong(reason!("options-of-phases", "video frames take --display, --size and --color alone"));
        }
        let display = phases.display.display.is_some().then(|| common::display(&phases.display)).transpose()?;
        let encoded = Encoded::open(file, display.as_ref(), phases.display.color.one())?;
        let hologram = encoded.decode(self.as_shown.unwrap_or_default())?;
        eprintln!("{}: {}", file.display(), encoded.describe());
        Ok(hologram.into())
    }
}

impl PhaseArgs {
    /// Returns how `file` is opened. A hologram holds its own optics, so none may be given.
    pub fn opening(&self, file: &Path, at: Option<u64>) -> Result<Opening, Failure> {
        let what = file.display();
        let is_display_given = self.display.display.is_some() || self.display.size.is_some();
        if (is_display_given || self.optics.is_given()) && !Phases::are_at(file) {
            return Err(Failure::Arguments(reason!(
                "own-optics",
                "{what} holds its own optics. Leave out --display, --size, --pitch, --wavelength and --focal-length"
            )));
        }
        if self.display.size.is_some() && self.display.display.is_none() {
            return Err(Failure::Arguments(reason!(
                "size-without-display",
                "{what}: --size is the resolution of a display. Give --display, too"
            )));
        }
        let (color, bare, unit) = (self.display.color.one(), self.optics(&what.to_string())?, self.unit.phase_unit);
        Ok(Opening { at, color, bare, unit, unfinished: false })
    }

    fn optics(&self, what: &str) -> Result<Option<BareOptics>, Failure> {
        if self.display.display.is_some() {
            return Ok(Some(BareOptics::Display(Box::new(common::display(&self.display)?))));
        }
        let BareOpticsArgs { pitch, wavelength, focal_length, geometry } = &self.optics;
        match (*pitch, *focal_length, &wavelength[..]) {
            (None, None, []) => Ok(None),
            (Some(pitch), Some(focal_length), [_, ..]) => {
                let (pitch, focal_length) = (pitch * 1e-6, focal_length * 1e-3);
                let wavelengths: Vec<f64> = wavelength.iter().map(|nm| nm * 1e-9).collect();
                for wavelength in &wavelengths {
                    common::usual(
                        self.display.force,
                        Optics::new(1, 1, pitch, *wavelength, focal_length)?.check_usual(),
                    )?;
                }
                let geometry = match geometry {
                    GeometryName::Relay => Geometry::Relay,
                    GeometryName::FarField => Geometry::FarField,
                };
                Ok(Some(BareOptics::Values { pitch, focal_length, geometry, wavelengths }))
            }
            _ => Err(Failure::Arguments(reason!(
                "optics-together",
                "{what}: --pitch, --wavelength and --focal-length go together"
            ))),
        }
    }
}

impl PhaseUnitArgs {
    /// Returns how phases are opened for a display that the command has anyway.
    pub fn opening(self, display: Option<&Display>, color: Option<Color>) -> Opening {
        Opening {
            at: None,
            color,
            bare: display.cloned().map(|d| BareOptics::Display(Box::new(d))),
            unit: self.phase_unit,
            unfinished: false,
        }
    }

    /// Returns the same for the chosen display, or without a display if none is chosen.
    pub fn chosen(self, args: &DisplayArgs) -> Result<Opening, Failure> {
        let display = args.display.is_some().then(|| common::display(args)).transpose()?;
        Ok(self.opening(display.as_ref(), args.color.one()))
    }
}
