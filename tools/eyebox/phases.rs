//! Bare phases on the command line: what they do not say of themselves.

use crate::Failure;
use crate::args::{Colors, DisplayArgs};
use crate::common;
use crate::values::{phase_unit, size};
use clap::{Args, ValueEnum};
use eyebox::hologram::{BareOptics, Opening, PhaseUnit, Phases};
use eyebox::optics::{Color, Display, Geometry, Optics};
use std::path::Path;

/// Where an SLM stands, by name.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GeometryName {
    /// Behind a 4f relay
    Relay,
    /// In the pupil plane
    FarField,
}

/// What numbers of bare phases are, where a display is given anyway.
#[derive(Args, Clone, Copy)]
pub struct PhaseUnitArgs {
    /// What the numbers of bare phases are: rad, turns, deg, or how many levels are a full turn [default: rad in .npy,
    /// where they can be that; 256 in pictures]
    #[arg(long, value_name = "UNIT", value_parser = phase_unit)]
    pub phase_unit: Option<PhaseUnit>,
}

/// What bare phases do not say of themselves.
#[derive(Args)]
pub struct PhaseArgs {
    /// Of bare phases: the display that they are for, a preset or a TOML file
    #[arg(long, value_name = "PRESET|FILE")]
    pub display: Option<String>,
    /// Of bare phases: its resolution instead of its own, rows x columns
    #[arg(long, value_name = "HxW", value_parser = size, requires = "display")]
    pub size: Option<[usize; 2]>,
    /// The colour of bare phases of one colour; of more, and of holograms, the one to take
    #[arg(long, value_enum, default_value = "all")]
    pub color: Colors,
    /// What their numbers are
    #[command(flatten)]
    pub unit: PhaseUnitArgs,
    /// Without --display: pixel pitch, um
    #[arg(long, value_name = "UM", conflicts_with = "display")]
    pub pitch: Option<f64>,
    /// Without --display: wavelength, nm; one per colour
    #[arg(long, value_name = "NM", value_delimiter = ',', conflicts_with = "display")]
    pub wavelength: Vec<f64>,
    /// Without --display: focal length, mm
    #[arg(long, value_name = "MM", conflicts_with = "display")]
    pub focal_length: Option<f64>,
    /// Without --display: where the SLM stands
    #[arg(long, value_enum, default_value_t = GeometryName::Relay, conflicts_with = "display")]
    pub geometry: GeometryName,
    /// Take sizes, wavelengths and pupils that look like a mistake as they are
    #[arg(long)]
    pub force: bool,
}

impl PhaseArgs {
    /// How `file` is opened: a hologram holds its own optics, and none may be given.
    pub fn opening(&self, file: &Path, at: Option<u64>) -> Result<Opening, Failure> {
        let what = file.display();
        let given = self.display.is_some()
            || self.pitch.is_some()
            || self.focal_length.is_some()
            || !self.wavelength.is_empty();
        if given && !Phases::are_at(file) {
            return Err(Failure::Asked(format!(
                "{what} holds its own optics: leave out --display, --pitch, --wavelength and --focal-length"
            )));
        }
        Ok(Opening { at, color: self.color.one(), bare: self.optics(&what.to_string())?, unit: self.unit.phase_unit })
    }

    fn optics(&self, what: &str) -> Result<Option<BareOptics>, Failure> {
        if let Some(name) = &self.display {
            return Ok(Some(BareOptics::Display(Box::new(common::display_of_size(name, self.size, self.force)?))));
        }
        match (self.pitch, self.focal_length, &self.wavelength[..]) {
            (None, None, []) => Ok(None),
            (Some(pitch), Some(focal_length), [_, ..]) => {
                let (pitch, focal_length) = (pitch * 1e-6, focal_length * 1e-3);
                let wavelengths: Vec<f64> = self.wavelength.iter().map(|nm| nm * 1e-9).collect();
                for wavelength in &wavelengths {
                    common::usual(self.force, Optics::new(1, 1, pitch, *wavelength, focal_length)?.check_usual())?;
                }
                let geometry = match self.geometry {
                    GeometryName::Relay => Geometry::Relay,
                    GeometryName::FarField => Geometry::FarField,
                };
                Ok(Some(BareOptics::Values { pitch, focal_length, geometry, wavelengths }))
            }
            _ => Err(Failure::Asked(format!("{what}: --pitch, --wavelength and --focal-length go together"))),
        }
    }
}

impl PhaseUnitArgs {
    /// How phases for a display are opened that the command has anyway.
    pub fn opening(self, display: Option<&Display>, color: Option<Color>) -> Opening {
        Opening {
            at: None,
            color,
            bare: display.cloned().map(|d| BareOptics::Display(Box::new(d))),
            unit: self.phase_unit,
        }
    }

    /// The same; a display that nobody chose is none.
    pub fn chosen(self, args: &DisplayArgs) -> Result<Opening, Failure> {
        let display = args.display.is_some().then(|| common::display(args)).transpose()?;
        Ok(self.opening(display.as_ref(), args.color.one()))
    }
}
