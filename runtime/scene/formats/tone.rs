//! Converts stored values to linear light, by transfer function and full scale, and checks them.

use crate::SceneError;
use crate::light_field::light::{FullScale, Transfer, srgb_to_linear, table};
use eyebox_optics::Color;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// The statements about how stored values become light.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Tone {
    /// The stated transfer function.
    pub transfer: Option<Transfer>,
    /// The stored value of white.
    pub full_scale: Option<f32>,
}

/// 16-bit values up to this may also have 14 bits or fewer.
const FOURTEEN_BITS: u16 = 16383;
/// A picture of 8 bits that was stretched to 16 bits has only multiples of this.
const STRETCHED: u16 = 257;
/// Light below zero down to this share of full scale is a rounding error of a filter.
const LEAST: f32 = -0.01;
/// Light above full scale up to this share is a rounding error.
const ROUNDED: f32 = 1.001;
/// Values below this share of full scale are not counted as lit.
const LIT: f32 = 1.0 / 4096.0;
/// The largest share of lit values above full scale that counts as highlights.
const HIGHLIGHTS: f64 = 0.05;
/// A scene whose brightest value is below this share of full scale looks black.
const BLACK: f32 = 1.0 / 256.0;

/// Counts of the stored values of one or several pictures of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tally {
    /// The largest 16-bit value, `None` for other kinds.
    word: Option<u16>,
    /// True if all 16-bit values are multiples of 257.
    stretched: bool,
    /// The largest value as a share of full scale.
    most: f32,
    /// Lit values, and the number of them above full scale.
    lit: u64,
    above: u64,
    /// Negative values that were set to zero.
    negative: u64,
    /// True for each kind that occurs: 8 bits, 16 bits, floats.
    kinds: [bool; 3],
    /// True if there is transparency, and true if any pixel is not fully transparent.
    has_alpha: bool,
    opaque: bool,
}

impl Default for Tally {
    fn default() -> Self {
        let (lit, above, negative, kinds) = (0, 0, 0, [false; 3]);
        Self { word: None, stretched: true, most: 0.0, lit, above, negative, kinds, has_alpha: false, opaque: false }
    }
}

impl Tally {
    /// Adds the counts of another picture.
    pub fn and(self, other: Self) -> Self {
        Self {
            word: self.word.max(other.word),
            stretched: self.stretched && other.stretched,
            most: self.most.max(other.most),
            lit: self.lit + other.lit,
            above: self.above + other.above,
            negative: self.negative + other.negative,
            kinds: [0, 1, 2].map(|i| self.kinds[i] || other.kinds[i]),
            has_alpha: self.has_alpha || other.has_alpha,
            opaque: self.opaque || other.opaque,
        }
    }

    /// Counts the 16-bit values of a picture.
    pub fn words(&mut self, values: impl Iterator<Item = u16>) {
        let mut most = self.word.unwrap_or(0);
        for v in values {
            most = most.max(v);
            self.stretched &= v.is_multiple_of(STRETCHED);
        }
        self.word = Some(most);
    }

    /// Counts the opacity of pixels, 0 to 1.
    pub fn alpha(&mut self, mut values: impl Iterator<Item = f32>) {
        self.has_alpha = true;
        self.opaque = self.opaque || values.any(|v| v > 0.0);
    }

    /// Clamps values that are shares of full scale to 0 to 1, and counts the values beyond. It returns the index of a
    /// value that is not valid light, because it is not finite or clearly negative.
    pub fn shares(&mut self, values: &mut [f32]) -> Result<(), usize> {
        for (i, v) in values.iter_mut().enumerate() {
            if !v.is_finite() || *v < LEAST {
                return Err(i);
            }
            self.most = self.most.max(*v);
            if *v < 0.0 {
                self.negative += 1;
                *v = 0.0;
            } else if *v > LIT {
                self.lit += 1;
                if *v > ROUNDED {
                    self.above += 1;
                }
                *v = v.min(1.0);
            }
        }
        Ok(())
    }

    /// Refuses a scene whose full scale is unknown, and warns of changed values. `how` is the way in which
    /// the caller can state it.
    ///
    /// # Errors
    /// [`SceneError::FullScale`] if the full scale is not known, [`SceneError::MixedScales`] or
    /// [`SceneError::Transparent`].
    pub fn judge(&self, place: &Path, tone: Tone, how: FullScale) -> Result<(), SceneError> {
        let file = || place.display().to_string();
        if self.has_alpha && !self.opaque {
            return Err(SceneError::Transparent { file: file() });
        }
        let refuse = |found: String, white: f32| Err(SceneError::FullScale { file: file(), found, white, how });
        let may_be_fewer =
            self.word.filter(|most| (1..=FOURTEEN_BITS).contains(most) && tone.full_scale.is_none() && !self.stretched);
        let is_mixed = self.kinds.iter().filter(|is_there| **is_there).count() > 1;
        if is_mixed && (tone.full_scale.is_some() || may_be_fewer.is_some()) {
            return Err(SceneError::MixedScales { file: file() });
        }
        if let Some(most) = may_be_fewer {
            let bits = (16 - most.leading_zeros()).max(8);
            let white = f32::from(u16::MAX >> (16 - bits));
            return refuse(format!("16-bit values up to {most}, as of {bits} bits or of a dark picture"), white);
        }
        let full = tone.full_scale.unwrap_or(1.0);
        let share = self.above as f64 / self.lit.max(1) as f64;
        if share > HIGHLIGHTS {
            let most = self.most * full;
            return refuse(format!("{:.0} % of its values are above {full}, up to {most}", 100.0 * share), white(most));
        }
        if self.above > 0 {
            tracing::warn!(
                "{}: {} values above full scale, up to {} times, are shown as white ({})",
                place.display(),
                self.above,
                self.most,
                how.states(&file(), white(self.most * full))
            );
        }
        if self.negative > 0 {
            tracing::warn!("{}: {} values slightly below 0 are shown as black", place.display(), self.negative);
        }
        Ok(())
    }
}

/// Returns the likely value of white of floats up to `most`. It is the full scale of integers that became floats, or
/// the largest value.
fn white(most: f32) -> f32 {
    let of_bits = [8, 10, 12, 14, 16].map(|bits| ((1u32 << bits) - 1) as f32);
    of_bits.into_iter().find(|white| (0.125 * white..=*white).contains(&most)).unwrap_or(most.ceil())
}

/// The stored values of a picture, interleaved.
#[derive(Clone, Copy)]
pub(crate) enum Stored<'a> {
    /// Unsigned integers of 8 bits.
    Bytes(&'a [u8]),
    /// Unsigned integers of 16 bits.
    Words(&'a [u16]),
    /// Floating-point values of any size.
    Floats(&'a [f32]),
    /// Shares of full scale, for any stated full scale.
    Shares(&'a [f32]),
}

/// The conversion of the pictures of one scene to light, with the statements about all of them and the counts of their
/// values.
#[derive(Debug, Default)]
pub(crate) struct Reading {
    pub tone: Tone,
    tally: Mutex<Tally>,
}

impl Reading {
    /// Begins to read pictures with these statements.
    pub fn new(tone: Tone) -> Self {
        Self { tone, tally: Mutex::default() }
    }

    /// Converts a picture to planes of linear light in these colors. `says` is the transfer function that its file
    /// states. A picture of two or four `channels` has transparency in the last one. The picture is then composited
    /// over black, unless it is `premultiplied`.
    ///
    /// # Errors
    /// The index of the first pixel that is not valid light, and its value.
    pub fn light(
        &self,
        stored: Stored<'_>,
        channels: usize,
        premultiplied: bool,
        says: Transfer,
        colors: &[Color],
    ) -> Result<Vec<Vec<f32>>, (usize, f32)> {
        let transfer = self.tone.transfer.unwrap_or(says);
        let mut tally = Tally { kinds: stored.kinds(), ..Tally::default() };
        let alpha = (channels.is_multiple_of(2) && !premultiplied).then_some(channels - 1);
        let alpha = alpha.map(|channel| stored.channel(channel, channels, stored.most()));
        if let Some(alpha) = &alpha {
            tally.alpha(alpha.iter().copied());
        }
        let plane = |color: &Color| {
            let channel = if channels >= 3 { color.channel() } else { 0 };
            let mut plane = match (stored, self.tone.full_scale) {
                (Stored::Bytes(v), None) => {
                    let table = table(u8::MAX.into(), transfer);
                    v.iter().skip(channel).step_by(channels).map(|v| table[usize::from(*v)]).collect()
                }
                (Stored::Words(v), None) => {
                    let table = table(u16::MAX, transfer);
                    v.iter().skip(channel).step_by(channels).map(|v| table[usize::from(*v)]).collect()
                }
                (_, full) => {
                    let full = if matches!(stored, Stored::Shares(_)) { None } else { full };
                    let mut plane = stored.channel(channel, channels, full.unwrap_or(1.0));
                    let wrong = |i: usize| stored.channel(channel, channels, 1.0)[i];
                    tally.shares(&mut plane).map_err(|i| (i, wrong(i)))?;
                    if transfer == Transfer::Srgb {
                        plane.iter_mut().for_each(|v| *v = srgb_to_linear(f64::from(*v)) as f32);
                    }
                    plane
                }
            };
            if let Some(alpha) = &alpha {
                plane.iter_mut().zip(alpha).for_each(|(v, a)| *v *= a);
            }
            Ok(plane)
        };
        let planes = colors.iter().map(plane).collect();
        self.add(tally);
        self.count_words(stored, channels);
        planes
    }

    /// Counts the stored values of 16 bits. Values that were converted before [`light`](Self::light) are counted
    /// separately.
    pub fn count_words(&self, stored: Stored<'_>, channels: usize) {
        if let Stored::Words(values) = stored {
            let colors = channels.div_ceil(2) * 2 - 1;
            let mut tally = Tally::default();
            tally.words(values.chunks_exact(channels).flat_map(|p| &p[..colors]).copied());
            self.add(tally);
        }
    }

    fn add(&self, tally: Tally) {
        let mut sum = self.tally.lock().unwrap_or_else(PoisonError::into_inner);
        *sum = sum.and(tally);
    }

    /// Describes the meaning of such values in words.
    pub fn in_words(&self, stored: Stored<'_>, says: Transfer) -> String {
        let kind = match stored {
            Stored::Bytes(_) => "8 bits",
            Stored::Words(_) => "16 bits",
            Stored::Floats(_) | Stored::Shares(_) => "floats",
        };
        let transfer = if self.tone.transfer.unwrap_or(says) == Transfer::Srgb { "sRGB" } else { "linear" };
        let stated = if self.tone.transfer.is_some() { ", as stated" } else { "" };
        let white = self.tone.full_scale.map_or(String::new(), |v| format!(", white is {v}, as stated"));
        format!("{kind}, {transfer}{stated}{white}")
    }

    /// Refuses pictures whose full scale is unknown, and warns of changed values.
    ///
    /// # Errors
    /// [`SceneError::FullScale`] if the full scale is not known, [`SceneError::MixedScales`] or
    /// [`SceneError::Transparent`].
    pub fn judge(&self, place: &Path, how: FullScale) -> Result<(), SceneError> {
        self.tally.lock().unwrap_or_else(PoisonError::into_inner).judge(place, self.tone, how)
    }
}

impl Stored<'_> {
    /// Returns true for the kind of the values: 8 bits, 16 bits, floats.
    fn kinds(self) -> [bool; 3] {
        [matches!(self, Self::Bytes(_)), matches!(self, Self::Words(_)), matches!(self, Self::Floats(_))]
    }

    /// Returns the largest value of the kind, which is 1 for floats.
    pub fn most(self) -> f32 {
        match self {
            Self::Bytes(_) => 255.0,
            Self::Words(_) => 65535.0,
            Self::Floats(_) | Self::Shares(_) => 1.0,
        }
    }

    /// Returns one channel as shares of `full`.
    fn channel(self, channel: usize, channels: usize, full: f32) -> Vec<f32> {
        match self {
            Self::Bytes(v) => v.iter().skip(channel).step_by(channels).map(|v| f32::from(*v) / full).collect(),
            Self::Words(v) => v.iter().skip(channel).step_by(channels).map(|v| f32::from(*v) / full).collect(),
            Self::Floats(v) | Self::Shares(v) => v.iter().skip(channel).step_by(channels).map(|v| v / full).collect(),
        }
    }
}

/// Warns of a scene that is almost black.
pub(crate) fn warn_of_black(name: &str, brightest: f32) {
    if brightest < BLACK {
        tracing::warn!("{name}: its brightest value is {brightest} of full scale, so it appears black or almost black");
    }
}
