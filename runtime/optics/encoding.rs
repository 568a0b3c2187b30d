//! Describes how a display receives its phases, as plain data that the module `encode` reads.

use super::color::Color;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::PathBuf};

/// The `[encoding]` table of a display file. `docs/displays.md` explains every key.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Encoding {
    /// The map from sub-frames to video frames.
    pub packing: Packing,
    /// Channel of packings that fill one channel.
    #[serde(skip_serializing_if = "super::is_default")]
    pub channel: Channel,
    /// Order in which the display shows the channels, for packings that fill all three.
    #[serde(skip_serializing_if = "super::is_default")]
    pub channel_order: ChannelOrder,
    /// The entries of a user-defined packing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub map: Vec<Place>,
    /// Gray level of 2 pi. The default is the number of levels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub two_pi_level: Option<TwoPi>,
    /// Phase of each level in turns, if the levels are not evenly spaced.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub phases_turns: Vec<f64>,
    /// Files with the phase of each level, per color.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub look_up: BTreeMap<Color, PathBuf>,
    /// Code in memory for each level, if it is not the number of the level.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub codes: Vec<u16>,
    /// Memory cells of a pixel, row by row. Each entry is the bit of the code that the cell holds.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cells: Vec<Vec<u8>>,
    /// Flip of the video frame, after all other steps. In a larger video frame, the SLM's part of it is flipped.
    #[serde(skip_serializing_if = "super::is_default")]
    pub flip_video: Flip,
    /// The place of the SLM in a larger video frame. By default the SLM is all of the video frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub active_area: Option<ActiveArea>,
    /// Flip of the hologram.
    #[serde(skip_serializing_if = "super::is_default")]
    pub flip: Flip,
    /// Clockwise rotation of the hologram after the flip, a multiple of 90 degrees.
    #[serde(skip_serializing_if = "super::is_default")]
    pub rotation_deg: u16,
    /// Shift of the hologram down and to the right, after the rotation. Pixels that leave at one edge enter at the
    /// other.
    #[serde(skip_serializing_if = "super::is_default")]
    pub offset_px: [i32; 2],
    /// Phase images that are added or subtracted.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub correction: Vec<Correction>,
    /// Blazed gratings that are added.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub grating: Vec<Grating>,
}

/// A packing, which maps (color, sub-frame) to (video frame, channel, bits).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Packing {
    /// One gray image per video frame. The colors of each sub-frame follow each other.
    #[default]
    Grey8,
    /// One sub-frame per video frame, with its colors in the channels.
    Fields,
    /// Eight sub-frames of one color per video frame. Sub-frame `j` is in bit `j` of one channel.
    Planes8,
    /// 24 bit planes per video frame. Plane `n` is in the channel `n / 8` of the order, in bit `n % 8`. The planes of
    /// the first color come first.
    Planes24,
    /// The packing that [`Encoding::map`] defines.
    Map,
}

/// A channel of a video frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    /// The only channel of a gray frame.
    #[default]
    Grey,
    /// The red channel of an RGB frame.
    Red,
    /// The green channel of an RGB frame.
    Green,
    /// The blue channel of an RGB frame.
    Blue,
    /// All three channels of an RGB frame as a word of 24 bits, with red lowest.
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
    /// The numbers of the channels in the order in which they are shown.
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

/// An entry of a user-defined packing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Color of the hologram.
    pub color: Color,
    /// Sub-frame of the color.
    pub sub_frame: u32,
    /// Video frame in the set.
    pub video_frame: u32,
    /// Channel of the video frame.
    pub channel: Channel,
    /// Bits of the channel that hold the bits of the level, from the lowest on.
    pub bits: Vec<u8>,
}

/// The gray level of 2 pi.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum TwoPi {
    /// One level for all colors.
    One(f64),
    /// A level for each color.
    Each(BTreeMap<Color, f64>),
}

/// A flip along one axis or along both.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Flip {
    /// The image stays unchanged.
    #[default]
    None,
    /// Left and right are exchanged.
    Horizontal,
    /// Up and down are exchanged.
    Vertical,
    /// Both axes are flipped.
    Both,
}

impl Flip {
    /// True if left and right are exchanged.
    pub fn mirrors(self) -> bool {
        matches!(self, Self::Horizontal | Self::Both)
    }

    /// True if up and down are exchanged.
    pub fn overturns(self) -> bool {
        matches!(self, Self::Vertical | Self::Both)
    }
}

/// The place of the SLM in a video frame that is larger than the SLM.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActiveArea {
    /// Rows and columns of the video frame, 1 to 65536 each.
    pub video_size: [usize; 2],
    /// Row and column of the video frame at which the SLM begins.
    #[serde(default)]
    pub offset: [usize; 2],
    /// Value of each channel outside the SLM, 0 to 255.
    #[serde(default)]
    pub fill: u8,
}

/// A phase image, as an 8- or 16-bit gray PNG or BMP, or as an `.npy` of radians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Correction {
    /// The file, relative to the display file.
    pub file: PathBuf,
    /// 1 adds the phase, -1 subtracts it.
    pub sign: i8,
    /// The color of this correction. The default is all colors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<Color>,
    /// Gray level of 2 pi of a picture. The default is 256 for 8 bits and 65536 for 16 bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub two_pi_level: Option<f64>,
    /// Orientation of the correction, as the hologram before its rotation or as the SLM's pixels.
    #[serde(default)]
    pub orientation: Orientation,
}

/// The orientation of a correction.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Orientation {
    /// The orientation of the hologram. The correction is flipped, rotated and moved with it.
    #[default]
    Hologram,
    /// The orientation of the SLM's pixels.
    Slm,
}

/// A blazed grating in the orientation of the hologram.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grating {
    /// Pixels per turn of phase.
    pub period_px: f64,
    /// Direction in which the phase grows. 0 is right, 90 is down.
    pub direction_deg: f64,
    /// The color of this grating. The default is all colors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<Color>,
}

impl Encoding {
    /// Returns the rows and columns that an SLM of this size takes of the video frame, with its memory cells.
    pub fn area_size(&self, [height, width]: [usize; 2]) -> [usize; 2] {
        let cells = [self.cells.len().max(1), self.cells.first().map_or(1, Vec::len).max(1)];
        [height.saturating_mul(cells[0]), width.saturating_mul(cells[1])]
    }

    /// Returns the place of an SLM of this size in the video frame.
    ///
    /// # Errors
    /// [`Reason`] if the SLM exceeds the video frame.
    pub fn area(&self, size: [usize; 2]) -> Result<ActiveArea, Reason> {
        let [rows, columns] = self.area_size(size);
        let Some(area) = self.active_area else {
            return Ok(ActiveArea { video_size: [rows, columns], offset: [0; 2], fill: 0 });
        };
        let ActiveArea { video_size: [height, width], offset: [top, left], .. } = area;
        if ![height, width].iter().all(|side| (1..=65536).contains(side)) {
            return Err(reason!(
                "video-size",
                "active_area has a video_size of {height}x{width}, but each side must be 1 to 65536"
            ));
        }
        if rows > height.saturating_sub(top) || columns > width.saturating_sub(left) {
            return Err(reason!(
                "active-area",
                "the SLM takes {rows}x{columns} pixels from row {top}, column {left} on, but active_area has a \
                 video_size of {height}x{width}. Give a larger video_size or a smaller offset"
            ));
        }
        Ok(area)
    }

    /// Returns the largest rows and columns of an SLM that fits the video frame, if the video frame has its own size.
    pub fn most_pixels(&self) -> Option<[usize; 2]> {
        let area = self.active_area?;
        let cells = self.area_size([1, 1]);
        Some(std::array::from_fn(|axis| area.video_size[axis].saturating_sub(area.offset[axis]) / cells[axis]))
    }

    /// Rejects values that no display file may have. The reason includes the remedy.
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
                "packing = \"map\" and map belong together, but one is given without the other: give both"
            ));
        }
        Ok(())
    }
}
