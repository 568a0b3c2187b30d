//! Represents a light source by incoherent modes (OPTICS 12).
//!
//! A *mode* is a source point at an angle, or a wavelength next to the main one. It has the same spectrum, seen through
//! a pupil at another place. Modes add as intensities (mutual intensity in coherent modes, Wolf 1982).

use super::quadrature::{self, MOST};
use super::units::within;
use super::{ModelOf, Optics, Pupil};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One incoherent mode of a source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SourceMode {
    /// Direction sines of its light on the SLM, (x, y).
    pub angle: [f64; 2],
    /// Wavelength of the mode in meters.
    pub wavelength: f64,
    /// Share of the mode in the light.
    pub weight: f64,
    /// Place of its switchable source in the list of the display.
    pub source: usize,
    /// `[k, n]` means that it is lit in each sub-frame whose number has the remainder k modulo n. It is never lit if n
    /// is 0.
    pub turn: [usize; 2],
}

impl SourceMode {
    /// The [turn](Self::turn) of a mode that is lit in every sub-frame.
    pub const ALWAYS: [usize; 2] = [0, 1];
    /// The [turn](Self::turn) of a mode that is never lit.
    pub const NEVER: [usize; 2] = [0, 0];

    /// The mode of a laser on the axis.
    pub fn centred(wavelength: f64) -> Self {
        Self { angle: [0.0; 2], wavelength, weight: 1.0, source: 0, turn: Self::ALWAYS }
    }

    /// True if it is lit in any sub-frame.
    pub fn is_lit(&self) -> bool {
        self.turn[1] > 0
    }

    /// Power of the mode in one of `frames` sub-frames, over its mean. A mode that takes turns is brighter in its own
    /// sub-frames by the inverse of its share.
    pub fn power(&self, frame: usize, frames: usize) -> f64 {
        let [place, count] = self.turn;
        let is_own = |frame: usize| frame.checked_rem(count) == Some(place);
        match (0..frames).filter(|f| is_own(*f)).count() {
            own if own > 0 && is_own(frame) => frames as f64 / own as f64,
            _ => 0.0,
        }
    }

    /// The same mode if only these switchable sources, by their places, are lit, all the time.
    #[must_use]
    pub fn lit_among(self, sources: &[usize]) -> Self {
        let turn = if sources.contains(&self.source) { Self::ALWAYS } else { Self::NEVER };
        Self { turn, ..self }
    }

    /// The same mode if only one of `frames` sub-frames is visible.
    #[must_use]
    pub fn in_frame(self, frame: usize, frames: usize) -> Self {
        let power = self.power(frame, frames);
        let turn = if power > 0.0 { Self::ALWAYS } else { Self::NEVER };
        Self { weight: if power > 0.0 { self.weight * power } else { self.weight }, turn, ..self }
    }

    /// The middle of the mode's eyebox, (x, y), in meters.
    pub(super) fn eyebox(&self, focal_length: f64) -> [f64; 2] {
        self.angle.map(|t| focal_length * t)
    }

    /// The pupil in the SLM's own light that sees this mode, moved by `-f t`.
    pub fn pupil(&self, pupil: &Pupil, focal_length: f64) -> Pupil {
        let [x, y] = self.eyebox(focal_length);
        Pupil { x: pupil.x - x, y: pupil.y - y, ..*pupil }
    }
}

/// Kinds of sources. Each is a preset for the values that a file does not have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum SourceKind {
    /// A point source of one wavelength.
    #[default]
    Laser,
    /// A superluminescent diode behind a single-mode fiber, which is a point with a line of 6 nm.
    Sled,
    /// A light-emitting diode behind a band-pass filter of 10 nm. Its image in the eyebox is a disc of 1 mm.
    Led,
}

impl SourceKind {
    /// All kinds of sources.
    pub const ALL: [Self; 3] = [Self::Laser, Self::Sled, Self::Led];

    /// The name in display files.
    pub fn name(self) -> &'static str {
        ["laser", "sled", "led"][self as usize]
    }

    /// Millimeters of the image in the eyebox, and nanometers of the line (full width at half maximum).
    fn preset(self) -> [f64; 2] {
        [[0.0, 0.0], [0.0, 6.0], [1.0, 10.0]][self as usize]
    }
}

/// The shapes of sources.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum SourceShape {
    /// An even disc of this diameter.
    #[default]
    Disc,
    /// An even square of this side.
    Square,
    /// A Gaussian of this full width at half maximum.
    Gaussian,
}

/// A mode in a display file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GivenMode {
    /// Direction of its light on the SLM in milliradians (x, y). The default is on the axis.
    #[serde(default)]
    pub angle_mrad: [f64; 2],
    /// Wavelength in nanometers, within 2 % of the color's. The default is the color's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Light of the mode in any unit, because only shares of the sum matter.
    pub weight: f64,
}

/// A section of `[source]` in a display file with the light of one color or of all colors.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct SourceTerms {
    /// Preset for the other values, laser, sled or led.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<SourceKind>,
    /// Width of the source's image in the eyebox in millimeters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_mm: Option<f64>,
    /// The same width as the full angle of the source at the SLM, in milliradians.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_mrad: Option<f64>,
    /// Shape of the source, disc, square or gaussian. The default is disc.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<SourceShape>,
    /// Width of the line in nanometers at half of the maximum (Gaussian).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub linewidth_nm: Option<f64>,
    /// Points along an axis that represent its size, 1 to 5 (of a disc 1, 4, 7 or 12 in all). The default is the fewest
    /// that a scene requires.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<usize>,
    /// Wavelengths that represent its line, 1 to 5. The default is the fewest that a scene requires.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lines: Option<usize>,
    /// All modes of the source, instead of a size and a line.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub modes: Vec<GivenMode>,
}

/// The table `[source]` of a display file.
pub type SourceSections = BTreeMap<ModelOf, SourceTerms>;

/// Wavelengths must be this near to their color's, because the SLM's phase counts as constant over the line (OPTICS
/// 12).
const NEAR: f64 = 0.02;
/// The most wavelengths that represent a line, if a file has no number.
pub(super) const LINES: usize = 3;
/// Full width at half maximum over standard deviation of a Gaussian.
pub(super) const WIDTHS: f64 = 2.354_820_045_030_949;

impl SourceTerms {
    /// These terms, and the terms of `others` that are not set here. A list of modes replaces all terms of `others`. An
    /// image and an angle replace each other.
    pub(super) fn or(&self, others: &Self) -> Self {
        if !self.modes.is_empty() {
            return self.clone();
        }
        let sized = self.image_mm.is_some() || self.angle_mrad.is_some();
        // A kind of its own replaces the values that it presets.
        let (others, has_kind) = (others.clone(), self.kind.is_some());
        let size = |value: Option<f64>| value.filter(|_| !sized && !has_kind);
        let describes = sized || has_kind || self.shape.is_some() || self.linewidth_nm.is_some();
        Self {
            kind: self.kind.or(others.kind),
            image_mm: self.image_mm.or(size(others.image_mm)),
            angle_mrad: self.angle_mrad.or(size(others.angle_mrad)),
            shape: self.shape.or(others.shape),
            linewidth_nm: self.linewidth_nm.or(others.linewidth_nm.filter(|_| !has_kind)),
            samples: self.samples.or(others.samples),
            lines: self.lines.or(others.lines),
            modes: if describes { Vec::new() } else { others.modes },
        }
    }

    /// Full angle of the source in radians. It is twice the standard deviation for a Gaussian source.
    pub(super) fn angle(&self, focal_length: f64) -> f64 {
        let preset = self.kind.unwrap_or_default().preset()[0];
        let image = self.angle_mrad.map_or(self.image_mm.unwrap_or(preset) * 1e-3 / focal_length, |mrad| mrad * 1e-3);
        if self.shape == Some(SourceShape::Gaussian) { 2.0 * image / WIDTHS } else { image }
    }

    /// Standard deviation of the line in meters.
    pub(super) fn line(&self) -> f64 {
        self.linewidth_nm.unwrap_or(self.kind.unwrap_or_default().preset()[1]) * 1e-9 / WIDTHS
    }

    /// The modes around a wavelength (meters). Their weights add up to 1.
    pub(super) fn modes(&self, wavelength: f64, focal_length: f64) -> Vec<SourceMode> {
        if !self.modes.is_empty() {
            let sum: f64 = self.modes.iter().map(|mode| mode.weight).sum();
            let one = |mode: &GivenMode| SourceMode {
                angle: mode.angle_mrad.map(|mrad| mrad * 1e-3),
                wavelength: mode.wavelength_nm.map_or(wavelength, |nm| nm * 1e-9),
                weight: if self.modes.len() == 1 { 1.0 } else { mode.weight / sum },
                ..SourceMode::centred(wavelength)
            };
            return self.modes.iter().filter(|mode| mode.weight > 0.0).map(one).collect();
        }
        let (angle, line) = (self.angle(focal_length), self.line());
        let samples = if angle > 0.0 { self.samples.unwrap_or(3).clamp(1, MOST) } else { 1 };
        let lines = if line > 0.0 { self.lines.unwrap_or(1).clamp(1, MOST) } else { 1 };
        let places = match self.shape.unwrap_or_default() {
            SourceShape::Disc => quadrature::disc(samples),
            SourceShape::Square => quadrature::square(&quadrature::even(samples)),
            SourceShape::Gaussian => quadrature::square(&quadrature::normal(samples)),
        };
        let lines = quadrature::normal(lines);
        let each = |(place, share): ([f64; 2], f64)| {
            let one = move |(off, part): &(f64, f64)| SourceMode {
                angle: place.map(|at| 0.5 * angle * at),
                wavelength: wavelength + line * off,
                weight: share * part,
                ..SourceMode::centred(wavelength)
            };
            lines.iter().map(one).collect::<Vec<_>>()
        };
        places.into_iter().flat_map(each).collect()
    }

    /// Checks the terms at a color of these optics.
    pub(super) fn check(&self, optics: &Optics) -> Result<(), Reason> {
        if self.image_mm.is_some() && self.angle_mrad.is_some() {
            return Err(reason!(
                "source-place-twice",
                "image_mm and angle_mrad both give the size of a source: leave out one of them"
            ));
        }
        within("image_mm", self.image_mm.unwrap_or(0.0), 0.0, 100.0)?;
        within("angle_mrad", self.angle_mrad.unwrap_or(0.0), 0.0, 1000.0)?;
        within("linewidth_nm", self.linewidth_nm.unwrap_or(0.0), 0.0, 100.0)?;
        within("samples", self.samples.unwrap_or(1) as f64, 1.0, MOST as f64)?;
        within("lines", self.lines.unwrap_or(1) as f64, 1.0, MOST as f64)?;
        for (i, mode) in self.modes.iter().enumerate() {
            let name = |what: &str| format!("{what} of mode {}", i + 1);
            within(&name("the weight"), mode.weight, 0.0, 1e9)?;
            within(&name("angle_mrad"), mode.angle_mrad[0], -1000.0, 1000.0)?;
            within(&name("angle_mrad"), mode.angle_mrad[1], -1000.0, 1000.0)?;
        }
        if !self.modes.is_empty() && self.modes.iter().all(|mode| mode.weight == 0.0) {
            return Err(reason!("source-without-light", "no mode has any light: one weight must be above 0"));
        }
        if self.modes.len() > 256 {
            return Err(reason!("source-modes", "{} modes: give at most 256", self.modes.len()));
        }
        let nm = optics.wavelength * 1e9;
        // The largest number of samples has the widest modes.
        let widest = Self { samples: Some(MOST), lines: self.lines.or(Some(LINES)), ..self.clone() };
        let reach = 0.5 * optics.wavelength / optics.pitch;
        for mode in widest.modes(optics.wavelength, optics.focal_length) {
            if (mode.wavelength / optics.wavelength - 1.0).abs() > NEAR {
                return Err(reason!(
                    "line-width",
                    "a wavelength of {:.1} nm is more than {:.0} % from the color's {nm:.1} nm: the SLM's phase would \
                     change over the line",
                    mode.wavelength * 1e9,
                    NEAR * 100.0
                ));
            }
            if let Some(angle) = mode.angle.into_iter().find(|t| t.abs() > reach) {
                return Err(reason!(
                    "source-angle",
                    "an angle of {:.2} mrad is beyond what the SLM diffracts to, {:.2} mrad at {nm:.0} nm",
                    angle * 1e3,
                    reach * 1e3
                ));
            }
        }
        Ok(())
    }
}
