//! How a display takes its phases, as its file says it: plain data, read by the room `encode`.

use super::color::Color;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::PathBuf};

/// The `[encoding]` table of a display file; `docs/displays.md` explains every key.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Encoding {
    /// Which sub-frame goes where in the video frames.
    pub packing: Packing,
    /// Channel of packings that fill one.
    #[serde(skip_serializing_if = "super::is_default")]
    pub channel: Channel,
    /// Order in which the display shows the channels, of packings that fill all three.
    #[serde(skip_serializing_if = "super::is_default")]
    pub channel_order: ChannelOrder,
    /// The user's own packing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub map: Vec<Place>,
    /// Gray level of 2 pi; the number of levels if it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub two_pi_level: Option<TwoPi>,
    /// Phase of every level, turns, where levels are not even.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub phases_turns: Vec<f64>,
    /// Files with the phase of every level, per color.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub look_up: BTreeMap<Color, PathBuf>,
    /// What the memory holds for each level, where that is not the level's number.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub codes: Vec<u8>,
    /// Memory cells of a pixel, row by row: which bit of the code each holds.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cells: Vec<Vec<u8>>,
    /// Flips the video frame, after everything else.
    #[serde(skip_serializing_if = "super::is_default")]
    pub flip_video: Flip,
    /// Flips the hologram.
    #[serde(skip_serializing_if = "super::is_default")]
    pub flip: Flip,
    /// Turns it clockwise, after the flip, by a multiple of 90 degrees.
    #[serde(skip_serializing_if = "super::is_default")]
    pub rotation_deg: u16,
    /// Moves it down and to the right, after the turn; what leaves at one edge enters at the other.
    #[serde(skip_serializing_if = "super::is_default")]
    pub offset_px: [i32; 2],
    /// Phase images that are added or taken away.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub correction: Vec<Correction>,
    /// Blazed gratings that are added.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub grating: Vec<Grating>,
}

/// A packing: a map (color, sub-frame) -> (video frame, channel, bits).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Packing {
    /// One gray image a video frame; of each sub-frame the colors in turn.
    #[default]
    Grey8,
    /// One sub-frame a video frame, its colors in the channels.
    Fields,
    /// Eight sub-frames of one color a video frame, sub-frame `j` in bit `j` of one channel.
    Planes8,
    /// 24 bit-planes a video frame: plane `n` in the channel `n / 8` of the order, bit `n % 8`; the planes of the
    /// first color first.
    Planes24,
    /// As [`Encoding::map`] says.
    Map,
}

/// A channel of a video frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    /// The one channel of a gray frame.
    #[default]
    Grey,
    /// Of an RGB frame.
    Red,
    /// Of an RGB frame.
    Green,
    /// Of an RGB frame.
    Blue,
    /// All three of an RGB frame as a word of 24 bits, red lowest.
    Rgb,
}

/// Order in which a display shows the channels of a video frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub enum ChannelOrder {
    #[default]
    Rgb,
    Rbg,
    Grb,
    Gbr,
    Brg,
    Bgr,
}

impl ChannelOrder {
    /// The channels' numbers, first shown first.
    pub fn channels(self) -> [u8; 3] {
        match self {
            Self::Rgb => [0, 1, 2],
            Self::Rbg => [0, 2, 1],
            Self::Grb => [1, 0, 2],
            Self::Gbr => [1, 2, 0],
            Self::Brg => [2, 0, 1],
            Self::Bgr => [2, 1, 0],
        }
    }
}

/// An entry of the user's own packing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Color of the hologram.
    pub color: Color,
    /// Its sub-frame.
    pub sub_frame: u32,
    /// Video frame of the set.
    pub video_frame: u32,
    /// Channel of it.
    pub channel: Channel,
    /// Bits of the channel, for the level's bits from the lowest on.
    pub bits: Vec<u8>,
}

/// Gray level of 2 pi.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum TwoPi {
    /// For all colors.
    One(f64),
    /// Per color.
    Each(BTreeMap<Color, f64>),
}

/// Left-right, up-down.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Flip {
    /// As it is.
    #[default]
    None,
    /// Left-right.
    Horizontal,
    /// Up-down.
    Vertical,
    /// Both.
    Both,
}

impl Flip {
    /// Whether left and right change places.
    pub fn mirrors(self) -> bool {
        matches!(self, Self::Horizontal | Self::Both)
    }

    /// Whether up and down do.
    pub fn overturns(self) -> bool {
        matches!(self, Self::Vertical | Self::Both)
    }
}

/// A phase image: an 8- or 16-bit gray PNG or BMP, or an `.npy` of radians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Correction {
    /// The file; relative to the display's.
    pub file: PathBuf,
    /// 1 adds it, -1 takes it away.
    pub sign: i8,
    /// The color that it is for; all without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<Color>,
    /// Level of 2 pi of a picture [default: 256 of 8 bits, 65536 of 16].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub two_pi_level: Option<f64>,
    /// Whether it lies as the hologram does, before it is turned, or as the SLM's pixels do.
    #[serde(default)]
    pub orientation: Orientation,
}

/// How a correction lies.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Orientation {
    /// As the hologram: it is flipped, turned and moved with it.
    #[default]
    Hologram,
    /// As the SLM's pixels.
    Slm,
}

/// A blazed grating in the hologram's own orientation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grating {
    /// Pixels of a turn.
    pub period_px: f64,
    /// Where the phase grows: 0 is right, 90 is down.
    pub direction_deg: f64,
    /// The color that it is for; all without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<Color>,
}

impl Encoding {
    /// What no display file may say. Says what is wrong and what would be right.
    pub(super) fn check(&self, levels: u32) -> Result<(), Reason> {
        if !matches!(self.rotation_deg, 0 | 90 | 180 | 270) {
            return Err(reason!("rotation", "rotation_deg is {}: it must be 0, 90, 180 or 270", self.rotation_deg));
        }
        let two_pi = match &self.two_pi_level {
            None => vec![],
            Some(TwoPi::One(level)) => vec![*level],
            Some(TwoPi::Each(each)) => each.values().copied().collect(),
        };
        if let Some(level) = two_pi.into_iter().find(|l| !(1.0..=65536.0).contains(l)) {
            return Err(reason!("two-pi-level", "two_pi_level is {level}: it must be 1 to 65536"));
        }
        for c in &self.correction {
            let file = c.file.display();
            if c.sign != 1 && c.sign != -1 {
                return Err(reason!(
                    "correction-sign",
                    "the correction {file} has the sign {}: 1 adds it, -1 takes it away",
                    c.sign
                ));
            }
            if let Some(level) = c.two_pi_level.filter(|l| !(1.0..=65536.0).contains(l)) {
                return Err(reason!(
                    "correction-two-pi-level",
                    "the correction {file} has the two_pi_level {level}: it must be 1 to 65536"
                ));
            }
        }
        for g in &self.grating {
            if !((2.0..=1e9).contains(&g.period_px) && g.direction_deg.is_finite()) {
                let (period, direction) = (g.period_px, g.direction_deg);
                return Err(reason!(
                    "grating",
                    "a grating has period_px {period} and direction_deg {direction}: give a period of at least two \
                     pixels and a finite direction"
                ));
            }
        }
        for (name, count) in [("phases_turns", self.phases_turns.len()), ("codes", self.codes.len())] {
            if count != 0 && count != levels as usize {
                return Err(reason!(
                    "table-length",
                    "{name} has {count} entries: it must have one for each of the {levels} levels"
                ));
            }
        }
        if let Some(phase) = self.phases_turns.iter().find(|p| !p.is_finite()) {
            return Err(reason!("not-finite", "phases_turns has {phase}: every phase must be finite"));
        }
        let columns = self.cells.first().map_or(0, Vec::len);
        let even = self.cells.iter().all(|row| columns > 0 && row.len() == columns);
        if self.cells.len() * columns > 4 || !even || self.cells.iter().flatten().any(|bit| *bit > 7) {
            return Err(reason!(
                "cells",
                "cells must be rows of bit numbers, 0 to 7, all of one length, of at most 4 cells in all"
            ));
        }
        if (self.packing == Packing::Map) == self.map.is_empty() {
            return Err(reason!(
                "map-without-packing",
                "packing = \"map\" and a map belong together: one is given without the other"
            ));
        }
        Ok(())
    }
}
