//! A static phase mask in front of the SLM, with finer pixels than the SLM's (OPTICS 12): it spreads the light of every SLM
//! pixel, so that the eyebox is that of the mask's pixels.
//!
//! Random masks are those of étendue expansion by scattering (Kuo et al. 2020, Park et al. 2019); designed ones send their light
//! evenly into a square of directions and nowhere else (phase-only diffusers by iterated Fourier transforms, Wyrowski and
//! Bryngdahl 1988).

use super::mask_design::{PARTS, designed, random_part};
use super::units::within;
use eyebox_base::error::Reason;
use eyebox_base::files::{read_grey, read_npy};
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// The most of its pixels that cover one of the SLM's, along an axis.
const MOST: usize = 4;

/// `[mask]` of a display file: a known phase mask that stands at the SLM, or a little way behind it.
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
    /// Its pixels along an axis of an SLM pixel, 1 to 4.
    pub factor: usize,
    /// Seed of random phases.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Of a designed mask, made from the seed: the share of the mask's own eyebox, along an axis, that its light goes to, above 0,
    /// at most 1 [default: random phases, which send it everywhere].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band: Option<f64>,
    /// A file beside the display's: radians in a `.npy`, or a gray picture (PNG, BMP) whose levels are a turn; factor times as many
    /// rows and columns as the SLM.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Phases that were read from such a file, as holograms keep them: in 4096ths of a turn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phases: Option<MaskPhases>,
    /// How far it stands behind the SLM, millimeters, 0 to 50 [default: 0].
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub distance_mm: f64,
    /// Wavelength that its phases are meant at, nanometers [default: the display's longest].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
}

/// Phases of a mask, in 4096ths of a turn. In files two characters each, behind `ROWSxCOLUMNS:`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct MaskPhases {
    size: [usize; 2],
    values: Arc<[u16]>,
}

/// Six bits a character.
const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";

impl MaskPhases {
    /// Of turns (whole ones count as none), row by row.
    fn new(size: [usize; 2], turns: impl Iterator<Item = f64>) -> Self {
        let part = |turn: f64| ((turn - turn.floor()) * f64::from(PARTS)).round() as u32 % PARTS;
        Self { size, values: turns.map(|turn| part(turn) as u16).collect() }
    }

    /// Rows and columns.
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
        Self::read(&text)
            .ok_or("expected ROWSxCOLUMNS: and two characters for each of so many phases, as eyebox writes them")
    }
}

impl Mask {
    /// Reads the phases that its file holds, which lies `beside` the display's, for an SLM of so many rows and columns.
    pub(super) fn resolve(&mut self, beside: &Path, slm: [usize; 2]) -> Result<(), Reason> {
        let Some(name) = self.file.take() else { return Ok(()) };
        let wrong = |reason: Reason| reason.within(format!("file {name}"));
        if self.seed.is_some() || self.phases.is_some() {
            return Err(wrong(reason!(
                "mask-seed-and-phases",
                "a seed or phases are given as well: leave out one of them"
            )));
        }
        let file = beside.join(&name);
        let size = slm.map(|n| n.saturating_mul(self.factor));
        let other = |[h, w]: [usize; 2]| {
            wrong(reason!(
                "mask-size",
                "{h} x {w} phases: {} x {} are needed, {} times the SLM's",
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
                    "it has {} axes: rows and columns are needed",
                    array.shape.len()
                )));
            };
            if [rows, columns] != size {
                return Err(other([rows, columns]));
            }
            if array.integers {
                return Err(wrong(reason!("mask-integers", "it holds integers: radians are needed, as floats")));
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

    /// Random phases made from a seed, or designed ones for this band, at the SLM.
    pub fn of_seed(factor: usize, seed: u64, band: Option<f64>) -> Self {
        Self { factor, seed: Some(seed), band, ..Self::default() }
    }

    /// What is wrong with it, in words.
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
                "a band is of a designed mask, which is made from a seed: give it one"
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

    /// Whether it does nothing: no finer pixels, and no phases.
    pub(super) fn is_clear(&self) -> bool {
        let flat = self.phases.as_ref().is_some_and(|phases| phases.values.iter().all(|v| *v == 0));
        self.factor == 1 && flat
    }

    /// Meters from the SLM.
    pub fn distance(&self) -> f64 {
        self.distance_mm * 1e-3
    }

    /// Its phases over so many rows and columns of its own pixels, turns from 0 to 1. Phases that were given for another size begin
    /// in the same corner, and repeat themselves where they end.
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
