//! Describes a static phase mask in front of the SLM, with finer pixels than the SLM's (OPTICS 12).
//!
//! The mask spreads the light of every SLM pixel. Therefore the pixels of the mask determine the eyebox.
//!
//! Random masks expand etendue by scattering (Kuo et al. 2020, Park et al. 2019). Designed masks send their light
//! evenly into a square of directions and nowhere else. They are phase-only diffusers by iterated Fourier transforms
//! (Wyrowski and Bryngdahl 1988).

use super::mask_design::{PARTS, designed, random_part};
use super::units::within;
use eyebox_base::error::Reason;
use eyebox_base::files::{read_grey, read_npy};
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// The largest number of mask pixels per SLM pixel along an axis.
const MOST: usize = 4;

/// `[mask]` of a display file, a known phase mask at the SLM or a short distance behind it.
///
/// ```toml
/// [mask]
/// factor = 2                  # 2 x 2 mask pixels cover an SLM pixel
/// seed = 1                    # random phases; or file = "mask.npy"
/// band = 0.5                  # designed: its light goes evenly into this share of its own eyebox, along an axis
/// distance_mm = 0             # from the SLM, along the light
/// wavelength_nm = 660         # where its phases hold; other colors are turned as a path turns them
/// ```
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Mask {
    /// Mask pixels per SLM pixel along an axis, 1 to 4.
    pub factor: usize,
    /// Seed of random phases.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Band of a designed mask, which is made from the seed. It is the share of the mask's own eyebox, along an axis,
    /// that receives the light, above 0 and at most 1. The default is random phases, which send light everywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band: Option<f64>,
    /// A file relative to the display's. It holds radians in a `.npy`, or a gray picture (PNG, BMP) whose levels are a
    /// turn. It has `factor` times the rows and columns of the SLM.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Phases from such a file, in 4096ths of a turn. Holograms store them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phases: Option<MaskPhases>,
    /// Distance of the mask behind the SLM in millimeters, 0 to 50. The default is 0.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub distance_mm: f64,
    /// Wavelength in nanometers for which the phases are given. The default is the display's longest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
}

/// Phases of a mask, in 4096ths of a turn. Files hold two characters per phase, after `ROWSxCOLUMNS:`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct MaskPhases {
    size: [usize; 2],
    values: Arc<[u16]>,
}

/// Each character holds six bits.
const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";

impl MaskPhases {
    /// Makes phases from turns, row by row. Whole turns count as none.
    fn new(size: [usize; 2], turns: impl Iterator<Item = f64>) -> Self {
        let part = |turn: f64| ((turn - turn.floor()) * f64::from(PARTS)).round() as u32 % PARTS;
        Self { size, values: turns.map(|turn| part(turn) as u16).collect() }
    }

    /// Rows and columns of the phases.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    fn read(text: &str) -> Option<Self> {
        let (size, values) = text.split_once(':')?;
        let (rows, columns) = size.split_once('x')?;
        let size: [usize; 2] = [rows.parse().ok()?, columns.parse().ok()?];
        let digit = |c: &u8| DIGITS.iter().position(|d| d == c).map(|d| d as u16);
        let pair = |pair: &[u8]| Some(64 * digit(pair.first()?)? + digit(pair.get(1)?)?);
        let values: Arc<[u16]> = values.as_bytes().chunks(2).map(pair).collect::<Option<_>>()?;
        (size[0].checked_mul(size[1]) == Some(values.len()) && !values.is_empty()).then_some(Self { size, values })
    }
}

impl From<MaskPhases> for String {
    fn from(phases: MaskPhases) -> Self {
        let digit = |v: u16| char::from(DIGITS[usize::from(v) % 64]);
        let mut text = format!("{}x{}:", phases.size[0], phases.size[1]);
        text.extend(phases.values.iter().flat_map(|v| [digit(v / 64), digit(v % 64)]));
        text
    }
}

impl TryFrom<String> for MaskPhases {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        Self::read(&text).ok_or("expected ROWSxCOLUMNS:, then two characters per phase, as eyebox writes them")
    }
}

impl Mask {
    /// Reads the phases from the mask's file, relative to the folder `beside`, for an SLM of this many rows and
    /// columns.
    pub(super) fn resolve(&mut self, beside: &Path, slm: [usize; 2]) -> Result<(), Reason> {
        let Some(name) = self.file.take() else { return Ok(()) };
        let wrong = |reason: Reason| reason.within(format!("file {name}"));
        if self.seed.is_some() || self.phases.is_some() {
            return Err(wrong(reason!(
                "mask-seed-and-phases",
                "a seed or phases are also given: leave out one of them"
            )));
        }
        let file = beside.join(&name);
        let size = slm.map(|n| n.saturating_mul(self.factor));
        let other = |[h, w]: [usize; 2]| {
            wrong(reason!(
                "mask-size",
                "{h} x {w} phases, but {} x {} are needed, {} times the SLM's",
                size[0],
                size[1],
                self.factor
            ))
        };
        self.phases = Some(if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) {
            let array = read_npy(&file).map_err(|e| wrong(Reason::of(&e)))?;
            let [rows, columns] = array.shape[..] else {
                return Err(wrong(reason!(
                    "mask-axes",
                    "it has {} axes, but rows and columns are needed",
                    array.shape.len()
                )));
            };
            if [rows, columns] != size {
                return Err(other([rows, columns]));
            }
            if array.integers {
                return Err(wrong(reason!("mask-integers", "it holds integers, but radians are needed, as floats")));
            }
            MaskPhases::new(size, array.values.iter().map(|v| f64::from(*v) / std::f64::consts::TAU))
        } else {
            let grey = read_grey(&file, size)
                .map_err(|e| wrong(Reason::of(&e).reworded(|text| text.replace('\n', " "))))?
                .map_err(other)?;
            MaskPhases::new(size, grey.values.iter().map(|v| f64::from(*v) / f64::from(grey.levels)))
        });
        Ok(())
    }

    /// A mask at the SLM, with random phases from a seed, or with designed phases for this band.
    pub fn of_seed(factor: usize, seed: u64, band: Option<f64>) -> Self {
        Self { factor, seed: Some(seed), band, ..Self::default() }
    }

    /// Checks the numbers of the mask, and that phases are given in one way.
    pub fn check(&self) -> Result<(), Reason> {
        within("factor", self.factor as f64, 1.0, MOST as f64)?;
        within("distance_mm", self.distance_mm, 0.0, 50.0)?;
        within("wavelength_nm", self.wavelength_nm.unwrap_or(500.0), 200.0, 2500.0)?;
        match (self.seed, self.band, &self.phases) {
            (None, None, None) => {
                Err(reason!("mask-without-phases", "it has no phases: give it a file, or a seed for random ones"))
            }
            (None, Some(_), _) => Err(reason!(
                "mask-band-without-seed",
                "band belongs to a designed mask, which is made from a seed: give it a seed"
            )),
            (Some(_), _, Some(_)) => {
                Err(reason!("mask-seed-and-phases", "it has both a seed and phases: leave out one of them"))
            }
            (Some(_), Some(band), None) if !(band > 0.0 && band <= 1.0) => Err(reason!(
                "mask-band",
                "band is {band}: it must be above 0 and at most 1, a share of the mask's own eyebox"
            )),
            _ => Ok(()),
        }
    }

    /// True if the mask has no effect, with no finer pixels and no phases.
    pub(super) fn is_clear(&self) -> bool {
        let flat = self.phases.as_ref().is_some_and(|phases| phases.values.iter().all(|v| *v == 0));
        self.factor == 1 && flat
    }

    /// Distance from the SLM in meters.
    pub fn distance(&self) -> f64 {
        self.distance_mm * 1e-3
    }

    /// The phases over this many rows and columns of the mask's pixels, in turns from 0 to 1. Phases for another size
    /// begin in the same corner, and repeat at their end.
    pub fn turns(&self, size: [usize; 2]) -> Vec<f32> {
        let turn = |part: u32| part as f32 / PARTS as f32;
        if let Some(MaskPhases { size: [rows, columns], values }) = &self.phases {
            let at = |i: usize| (i / size[1]) % rows * columns + (i % size[1]) % columns;
            return (0..size[0] * size[1]).map(|i| turn(u32::from(values[at(i)]))).collect();
        }
        let seed = self.seed.unwrap_or_default();
        match self.band {
            Some(band) => designed(seed, band, size).iter().map(|part| turn(u32::from(*part))).collect(),
            None => (0..size[0] * size[1]).map(|i| turn(random_part(seed, i))).collect(),
        }
    }
}

#[cfg(test)]
#[path = "mask_tests.rs"]
mod tests;
