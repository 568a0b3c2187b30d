//! Describes packings as data, a map from color and sub-frame to video frame, channel and bits.

use crate::optics::{Channel, Color, Encoding, Packing, Place};
use eyebox_base::{Reason, reason};

/// The position of the levels of one sub-frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PackedSlot {
    /// Index of the color among those encoded.
    pub color: usize,
    /// Index of the sub-frame.
    pub sub_frame: usize,
    /// Index of the video frame.
    pub video_frame: usize,
    /// Bits of the pixel's word that hold the level's bits, from the lowest on. A channel has 8 bits, and red is
    /// lowest.
    pub bits: Vec<u8>,
}

/// A packing for some colors and sub-frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packed {
    /// Number of sub-frames per color.
    pub sub_frames: usize,
    /// Number of video frames in the packing.
    pub video_frames: usize,
    /// Number of bytes per pixel, 1 or 3.
    pub channels: usize,
    /// The slots in the order of the video frames.
    pub slots: Vec<PackedSlot>,
}

/// Returns the first bit of a channel, its number of bits, and the number of channels of its frames.
fn place(channel: Channel) -> (u8, u8, usize) {
    match channel {
        Channel::Grey => (0, 8, 1),
        Channel::Red => (0, 8, 3),
        Channel::Green => (8, 8, 3),
        Channel::Blue => (16, 8, 3),
        Channel::Rgb => (0, 24, 3),
    }
}

impl Packed {
    /// Returns the packing for these colors with `sub_frames` each. If they do not fit, the error states a number that
    /// fits.
    pub fn new(encoding: &Encoding, colors: &[Color], sub_frames: usize) -> Result<Self, Reason> {
        let one = Self::set(encoding, colors)?;
        if sub_frames == 0 || !sub_frames.is_multiple_of(one.sub_frames) {
            let (n, per) = (colors.len(), one.sub_frames);
            let (video, plural) = (one.video_frames, if one.video_frames == 1 { "" } else { "s" });
            return Err(reason!(
                "sub-frames",
                "it has {sub_frames} sub-frames, and {video} video frame{plural} of this packing hold{} {per} of each \
                 of {n} color{}. Use {per} sub-frames or a multiple of it",
                if video == 1 { "s" } else { "" },
                if n == 1 { "" } else { "s" },
            ));
        }
        let sets = sub_frames / one.sub_frames;
        let slots = (0..sets).flat_map(|set| {
            one.slots.iter().map(move |s| PackedSlot {
                sub_frame: s.sub_frame + set * one.sub_frames,
                video_frame: s.video_frame + set * one.video_frames,
                ..s.clone()
            })
        });
        Ok(Self { sub_frames, video_frames: sets * one.video_frames, channels: one.channels, slots: slots.collect() })
    }

    /// Returns the content of a video frame in the form of a display file's map, as bits of one channel or of the whole
    /// word.
    pub(crate) fn places(&self, colors: &[Color], video_frame: usize) -> Vec<Place> {
        let place = |s: &PackedSlot| {
            let one = s.bits.iter().all(|b| b / 8 == s.bits[0] / 8);
            let channel = match (self.channels, one, s.bits[0] / 8) {
                (1, ..) => Channel::Grey,
                (_, false, _) => Channel::Rgb,
                (_, true, 0) => Channel::Red,
                (_, true, 1) => Channel::Green,
                _ => Channel::Blue,
            };
            let bits = s.bits.iter().map(|b| if one { b % 8 } else { *b }).collect();
            let [sub_frame, video_frame] = [s.sub_frame, s.video_frame].map(|n| n as u32);
            Place { color: colors[s.color], sub_frame, video_frame, channel, bits }
        };
        self.slots.iter().filter(|s| s.video_frame == video_frame).map(place).collect()
    }

    /// Returns the packing of `video_frames` video frames of these colors. If they are not whole sets, the error states
    /// the remedy.
    pub fn of_video_frames(encoding: &Encoding, colors: &[Color], video_frames: usize) -> Result<Self, Reason> {
        let one = Self::set(encoding, colors)?;
        if video_frames == 0 || !video_frames.is_multiple_of(one.video_frames) {
            let names: Vec<_> = colors.iter().map(Color::to_string).collect();
            return Err(reason!(
                "video-frames",
                "there are {video_frames} video frames, but a set of {} takes {}. Give whole sets, or set `color` \
                 to their color",
                names.join(", "),
                one.video_frames
            ));
        }
        Self::new(encoding, colors, video_frames / one.video_frames * one.sub_frames)
    }

    /// Returns the shortest run of sub-frames that fills whole video frames.
    fn set(encoding: &Encoding, colors: &[Color]) -> Result<Self, Reason> {
        let count = colors.len();
        if count == 0 {
            return Err(reason!("no-colors", "it has no colors"));
        }
        let order = encoding.channel_order.channels();
        let whole = |first: u8| (first..first + 8).collect::<Vec<u8>>();
        let slot = |color, sub_frame, video_frame, bits| PackedSlot { color, sub_frame, video_frame, bits };
        match encoding.packing {
            Packing::Grey8 | Packing::Planes8 => {
                let (first, bits, channels) = place(encoding.channel);
                if bits != 8 {
                    return Err(reason!(
                        "channel",
                        "channel = \"rgb\" is not a single channel. Use grey, red, green or blue"
                    ));
                }
                if encoding.packing == Packing::Grey8 {
                    let slots = (0..count).map(|c| slot(c, 0, c, whole(first))).collect();
                    return Ok(Self { sub_frames: 1, video_frames: count, channels, slots });
                }
                let of = |c| (0..8u8).map(move |f| slot(c, usize::from(f), c, vec![first + f]));
                Ok(Self { sub_frames: 8, video_frames: count, channels, slots: (0..count).flat_map(of).collect() })
            }
            Packing::Fields => {
                let field = |(c, color): (usize, &Color)| slot(c, 0, 0, whole(8 * order[color.channel()]));
                let slots = colors.iter().enumerate().map(field).collect();
                Ok(Self { sub_frames: 1, video_frames: 1, channels: 3, slots })
            }
            Packing::Planes24 => {
                if !24usize.is_multiple_of(count) {
                    return Err(reason!(
                        "colors-of-planes",
                        "it has {count} colors, but 24 planes hold 1, 2 or 3 evenly"
                    ));
                }
                let each = 24 / count;
                let plane = |n: usize| slot(n / each, n % each, 0, vec![8 * order[n / 8] + (n % 8) as u8]);
                Ok(Self { sub_frames: each, video_frames: 1, channels: 3, slots: (0..24).map(plane).collect() })
            }
            Packing::Map => Self::of_map(encoding, colors),
        }
    }

    fn of_map(encoding: &Encoding, colors: &[Color]) -> Result<Self, Reason> {
        // The largest number of sub-frames and of video frames in a set. It bounds the size of a map's packing.
        const MOST: u32 = 4096;
        let wanted: Vec<_> = encoding.map.iter().filter(|p| colors.contains(&p.color)).collect();
        let channels = place(encoding.map[0].channel).2;
        let (mut slots, mut taken) = (Vec::new(), std::collections::HashSet::new());
        for p in wanted {
            let what = format!("the map's entry for {} sub-frame {}", p.color, p.sub_frame);
            let (first, width, of) = place(p.channel);
            if p.sub_frame >= MOST || p.video_frame >= MOST {
                return Err(reason!("too-many", "{what} is beyond {MOST} sub-frames or video frames"));
            }
            if of != channels {
                return Err(reason!(
                    "mixed-frames",
                    "{what} is in a gray frame, but others are in a color frame. Use one kind for all"
                ));
            }
            if p.bits.is_empty() || p.bits.len() > 16 || p.bits.iter().any(|bit| *bit >= width) {
                return Err(reason!("map-bits", "{what} must have 1 to 16 bits, each below {width}"));
            }
            let bits: Vec<u8> = p.bits.iter().map(|bit| first + bit).collect();
            if let Some(bit) = bits.iter().find(|bit| !taken.insert((p.video_frame, **bit))) {
                return Err(reason!(
                    "bit-taken",
                    "{what} takes bit {bit} of video frame {}, which is taken already",
                    p.video_frame
                ));
            }
            let color = colors.iter().position(|c| *c == p.color).expect("only these colors were kept");
            slots.push(PackedSlot {
                color,
                sub_frame: p.sub_frame as usize,
                video_frame: p.video_frame as usize,
                bits,
            });
        }
        slots.sort_by_key(|s| (s.video_frame, s.bits[0]));
        let sub_frames = slots.iter().map(|s| s.sub_frame + 1).max().unwrap_or(0);
        for (index, color) in colors.iter().enumerate() {
            for f in 0..sub_frames {
                let count = slots.iter().filter(|s| (s.color, s.sub_frame) == (index, f)).count();
                if count != 1 {
                    return Err(reason!(
                        "map-entries",
                        "the map has {count} entries for {color} sub-frame {f}, but it must have one for each of \
                         {sub_frames} sub-frames of each color of the hologram"
                    ));
                }
            }
        }
        let video_frames = 1 + encoding.map.iter().map(|p| p.video_frame as usize).max().unwrap_or(0);
        if sub_frames == 0 {
            return Err(reason!("map-without-color", "the map has no entry for the hologram's colors"));
        }
        Ok(Self { sub_frames, video_frames, channels, slots })
    }
}
