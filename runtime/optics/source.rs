//! Light with a source: incoherent modes (OPTICS 12).
//!
//! A source point at an angle, or a wavelength beside the main one, is a *mode*: the same spectrum seen through a pupil that
//! stands elsewhere. Modes add as intensities (mutual intensity in coherent modes, Wolf 1982).

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
    /// Meters.
    pub wavelength: f64,
    /// Its share of the light.
    pub weight: f64,
    /// Which of the display's switchable sources it belongs to, by its place.
    pub source: usize,
    /// `[k, n]`: it is lit in each sub-frame whose number leaves k when it is divided by n; never where n is 0.
    pub turn: [usize; 2],
}

impl SourceMode {
    /// The [turn](Self::turn) of what is lit in every sub-frame.
    pub const ALWAYS: [usize; 2] = [0, 1];
    /// That of what is lit in none.
    pub const NEVER: [usize; 2] = [0, 0];

    /// A laser on the axis: no source at all.
    pub fn centred(wavelength: f64) -> Self {
        Self { angle: [0.0; 2], wavelength, weight: 1.0, source: 0, turn: Self::ALWAYS }
    }

    /// Whether it is lit in any sub-frame.
    pub fn is_lit(&self) -> bool {
        self.turn[1] > 0
    }

    /// Its power in one of so many sub-frames, over its mean: what takes turns shines so much brighter in its own.
    pub fn power(&self, frame: usize, frames: usize) -> f64 {
        let [place, count] = self.turn;
        let is_own = |frame: usize| frame.checked_rem(count) == Some(place);
        match (0..frames).filter(|f| is_own(*f)).count() {
            own if own > 0 && is_own(frame) => frames as f64 / own as f64,
            _ => 0.0,
        }
    }

    /// The same where these switchable sources are lit, by their places, all the time, and no others.
    #[must_use]
    pub fn lit_among(self, sources: &[usize]) -> Self {
        let turn = if sources.contains(&self.source) { Self::ALWAYS } else { Self::NEVER };
        Self { turn, ..self }
    }

    /// The same where one of so many sub-frames is seen alone.
    #[must_use]
    pub fn in_frame(self, frame: usize, frames: usize) -> Self {
        let power = self.power(frame, frames);
        let turn = if power > 0.0 { Self::ALWAYS } else { Self::NEVER };
        Self { weight: if power > 0.0 { self.weight * power } else { self.weight }, turn, ..self }
    }

    /// The middle of its eyebox, (x, y), meters.
    pub(super) fn eyebox(&self, focal_length: f64) -> [f64; 2] {
        self.angle.map(|t| focal_length * t)
    }

    /// Where, in the SLM's own light, the pupil stands that sees this mode: moved by `-f t`.
    pub fn pupil(&self, pupil: &Pupil, focal_length: f64) -> Pupil {
        let [x, y] = self.eyebox(focal_length);
        Pupil { x: pupil.x - x, y: pupil.y - y, ..*pupil }
    }
}

/// Kinds of sources, each a preset: what a file does not say of its source is as the kind has it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum SourceKind {
    /// A point of one wavelength.
    #[default]
    Laser,
    /// A superluminescent diode behind a single-mode fiber: a point, 6 nm wide.
    Sled,
    /// A light-emitting diode behind a band-pass filter of 10 nm, its image a disc of 1 mm in the eyebox.
    Led,
}

impl SourceKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Laser, Self::Sled, Self::Led];

    /// The name by which it is chosen.
    pub fn name(self) -> &'static str {
        ["laser", "sled", "led"][self as usize]
    }

    /// Millimeters of its image in the eyebox, nanometers of its line (full width at half maximum).
    fn preset(self) -> [f64; 2] {
        [[0.0, 0.0], [0.0, 6.0], [1.0, 10.0]][self as usize]
    }
}

/// Shapes of sources.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum SourceShape {
    /// Even, of this diameter.
    #[default]
    Disc,
    /// Even, of this side.
    Square,
    /// Gaussian, of this full width at half maximum.
    Gaussian,
}

/// A mode as a file has it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GivenMode {
    /// Direction of its light on the SLM, milliradians (x, y) [default: on the axis].
    #[serde(default)]
    pub angle_mrad: [f64; 2],
    /// Nanometers, within 2 % of the color's [default: the color's].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Its light, in whatever unit: shares of the sum are taken.
    pub weight: f64,
}

/// A section of `[source]` in a display file: the light of one color, or of all.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct SourceTerms {
    /// Which preset the rest stands at: laser, sled or led.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<SourceKind>,
    /// How wide the source's image in the eyebox is, millimeters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_mm: Option<f64>,
    /// The same as the whole angle under which the SLM sees the source, milliradians.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_mrad: Option<f64>,
    /// Its shape: disc, square or gaussian [default: disc].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<SourceShape>,
    /// How wide its line is, nanometers at half of the maximum (Gaussian).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub linewidth_nm: Option<f64>,
    /// Points that stand for its size, along an axis, 1 to 5 (of a disc 1, 4, 7 or 12 in all) [default: as few as a scene
    /// requires].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<usize>,
    /// Wavelengths that stand for its line, 1 to 5 [default: as few as a scene requires].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lines: Option<usize>,
    /// All of its modes, instead of a size and a line.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub modes: Vec<GivenMode>,
}

/// `[source]` of a display file.
pub type SourceSections = BTreeMap<ModelOf, SourceTerms>;

/// Wavelengths this near to their color's are taken: over the line, the SLM's phase counts as constant (OPTICS 12).
const NEAR: f64 = 0.02;
/// Wavelengths that stand for a line at most, where a file does not say.
pub(super) const LINES: usize = 3;
/// Full width at half maximum over standard deviation of a Gaussian.
pub(super) const WIDTHS: f64 = 2.354_820_045_030_949;

impl SourceTerms {
    /// These, and those of `others` that are not known here. A list of modes stands for itself, and so do an image and an angle
    /// for each other.
    pub(super) fn or(&self, others: &Self) -> Self {
        if !self.modes.is_empty() {
            return self.clone();
        }
        let sized = self.image_mm.is_some() || self.angle_mrad.is_some();
        // A kind of its own stands for what it presets.
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

    /// Radians of the whole source; twice the standard deviation of a Gaussian one.
    pub(super) fn angle(&self, focal_length: f64) -> f64 {
        let preset = self.kind.unwrap_or_default().preset()[0];
        let image = self.angle_mrad.map_or(self.image_mm.unwrap_or(preset) * 1e-3 / focal_length, |mrad| mrad * 1e-3);
        if self.shape == Some(SourceShape::Gaussian) { 2.0 * image / WIDTHS } else { image }
    }

    /// Meters, the standard deviation of its line.
    pub(super) fn line(&self) -> f64 {
        self.linewidth_nm.unwrap_or(self.kind.unwrap_or_default().preset()[1]) * 1e-9 / WIDTHS
    }

    /// Its modes around a wavelength (meters), whose weights add up to 1.
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

    /// What is wrong with it at a color of these optics, in words.
    pub(super) fn check(&self, optics: &Optics) -> Result<(), Reason> {
        if self.image_mm.is_some() && self.angle_mrad.is_some() {
            return Err(reason!(
                "source-place-twice",
                "image_mm and angle_mrad say the same of a source: give one of them"
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
            return Err(reason!("source-modes", "{} modes: at most 256 are taken", self.modes.len()));
        }
        let nm = optics.wavelength * 1e9;
        // As many samples as there may be reach farthest.
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
