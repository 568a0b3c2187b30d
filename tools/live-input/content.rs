//! Defines offers and requests of a display, and the content of frames.

use crate::{LiveError, MOST};

/// The kinds of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Views from a grid of positions in the pupil plane.
    Views = 1,
    /// A picture and the distance of each of its pixels.
    ColorAndDepth = 2,
    /// Pictures with opacity, one in front of the other.
    Layers = 4,
}

impl Kind {
    /// All kinds of frames.
    pub const ALL: [Self; 3] = [Self::Views, Self::ColorAndDepth, Self::Layers];
}

/// The formats of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Sample {
    /// 8 bits, with 255 as full scale.
    U8 = 1,
    /// 16 bits, with 65535 as full scale.
    U16 = 2,
    /// A float of 16 bits, with 1 as full scale.
    F16 = 3,
    /// A float of 32 bits, with 1 as full scale.
    F32 = 4,
}

impl Sample {
    /// All formats of samples.
    pub const ALL: [Self; 4] = [Self::U8, Self::U16, Self::F16, Self::F32];

    /// Returns the number of bytes of a sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
        }
    }
}

/// The conversions from color samples to light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Transfer {
    /// The samples are linear light.
    Linear = 1,
    /// The samples follow the sRGB curve. Only integer samples may have it.
    Srgb = 2,
}

/// The distances of the layers of a frame in dioptres, with the farthest first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dioptres {
    pub(crate) count: u32,
    pub(crate) values: [f32; MOST as usize],
}

impl Dioptres {
    /// Takes the first 64 of `values`. They are checked at the begin of a frame.
    pub fn new(values: &[f32]) -> Self {
        let mut all = [0.0; MOST as usize];
        let count = values.len().min(all.len());
        all[..count].copy_from_slice(&values[..count]);
        Self { count: count as u32, values: all }
    }

    /// Returns one value for each layer.
    pub fn as_slice(&self) -> &[f32] {
        &self.values[..self.count as usize]
    }
}

/// The content of a frame, with the values that belong to its kind.
#[allow(clippy::large_enum_variant, reason = "layers keep their dioptres within, so that nothing is allocated")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Content {
    /// Views as (view row, view column, row, column, color).
    Views {
        /// Rows and columns of views.
        grid: [u32; 2],
        /// The distance of neighboring views in the pupil plane, in mm.
        pitch_mm: f64,
    },
    /// A picture as (row, column, color), and float32 dioptres as (row, column).
    ColorAndDepth,
    /// Layers as (layer, row, column, color and opacity), with the farthest first.
    Layers(Dioptres),
}

impl Content {
    /// Returns the kind of the content.
    pub fn kind(&self) -> Kind {
        match self {
            Self::Views { .. } => Kind::Views,
            Self::ColorAndDepth => Kind::ColorAndDepth,
            Self::Layers(_) => Kind::Layers,
        }
    }
}

/// The description of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInfo {
    /// The content with its shape.
    pub content: Content,
    /// The format of a sample.
    pub sample: Sample,
    /// The conversion from color samples to light.
    pub transfer: Transfer,
    /// The number of the request that the frame answers, or 0 for none.
    pub request: u64,
    /// The time of the content that it shows, in nanoseconds of `CLOCK_MONOTONIC`.
    pub content_time_ns: i64,
    /// The position of the middle view, or of the camera, in the pupil plane as x, y in mm.
    pub center_mm: [f64; 2],
    /// True if the samples are in the slot of the same number in the device's memory that the display shares. Otherwise
    /// they follow the header. Layers are never on the device.
    pub on_device: bool,
}

impl FrameInfo {
    /// Describes a frame from the middle of the eyebox that answers no request, for time 0, with samples in the region.
    pub fn new(content: Content, sample: Sample, transfer: Transfer) -> Self {
        Self { content, sample, transfer, request: 0, content_time_ns: 0, center_mm: [0.0; 2], on_device: false }
    }
}

/// The frames that a display accepts. It decides the size of the shared memory, whatever the application sends.
#[derive(Debug, Clone, PartialEq)]
pub struct Offer {
    /// Rows and columns of every picture.
    pub size: [u32; 2],
    /// True for each of red, green and blue that the display has.
    pub colors: [bool; 3],
    /// The accepted kinds of frames.
    pub kinds: Vec<Kind>,
    /// The largest numbers of rows and columns of views.
    pub views: [u32; 2],
    /// The largest number of layers.
    pub layers: u32,
    /// The number of frames in the ring, 3 to 8.
    pub slots: u32,
    /// The angle between neighboring pixels, in radians.
    pub pixel_angle: f64,
    /// The width and height of the eyebox, in mm.
    pub eyebox_mm: [f64; 2],
}

/// The bytes before the first slot. The distance of slots is a multiple of it.
pub(crate) const PAGE: usize = 4096;
/// The bytes of a slot before its samples.
pub(crate) const HEADER: usize = 512;
/// The largest region, in bytes.
const REGION: u64 = 16 << 30;

impl Offer {
    /// Returns the number of colors.
    pub fn channels(&self) -> usize {
        self.colors.iter().filter(|c| **c).count()
    }

    /// Returns the number of pixels of a picture.
    pub fn pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Returns the number of samples of color and opacity of a frame of this content.
    pub(crate) fn samples(&self, content: &Content) -> usize {
        let per_pixel = match content {
            Content::Views { grid, .. } => grid[0] as usize * grid[1] as usize * self.channels(),
            Content::ColorAndDepth => self.channels(),
            Content::Layers(dioptres) => dioptres.count as usize * (self.channels() + 1),
        };
        self.pixels() * per_pixel
    }

    /// Returns the bytes of a frame's samples, and the offset of its depth among them.
    pub(crate) fn bytes(&self, content: &Content, sample: Sample) -> [usize; 2] {
        let colors = self.samples(content) * sample.bytes();
        match content {
            Content::ColorAndDepth => {
                let depth = colors.next_multiple_of(64);
                [depth + self.pixels() * 4, depth]
            }
            _ => [colors, colors],
        }
    }

    /// Lists the largest accepted frame of each kind.
    pub(crate) fn largest(&self) -> impl Iterator<Item = Content> + '_ {
        self.kinds.iter().map(|kind| match kind {
            Kind::Views => Content::Views { grid: self.views, pitch_mm: 1.0 },
            Kind::ColorAndDepth => Content::ColorAndDepth,
            Kind::Layers => Content::Layers(Dioptres { count: self.layers, values: [0.0; MOST as usize] }),
        })
    }

    /// Returns the bytes of samples that a slot holds.
    pub(crate) fn slot_bytes(&self) -> usize {
        self.largest().map(|content| self.bytes(&content, Sample::F32)[0]).max().unwrap_or(0).next_multiple_of(64)
    }

    /// Returns the bytes from one slot to the next.
    pub(crate) fn slot_stride(&self) -> usize {
        (HEADER + self.slot_bytes()).next_multiple_of(PAGE)
    }

    /// Returns the bytes of a complete region.
    pub(crate) fn region_bytes(&self) -> u64 {
        (PAGE + self.slots as usize * self.slot_stride()) as u64
    }

    /// Checks all values of the offer.
    ///
    /// # Errors
    /// Returns [`LiveError::Offer`] with the accepted values.
    pub(crate) fn check(&self) -> Result<(), LiveError> {
        let wrong = |what, found: String, must| Err(LiveError::Offer { what, found, must });
        let between = |values: &[u32], most| values.iter().all(|v| (1..=most).contains(v));
        if !between(&self.size, 65_536) {
            return wrong("the size", format!("{:?}", self.size), "1 to 65536 rows and columns");
        }
        if self.channels() == 0 {
            return wrong("the list of colors", "empty".into(), "one to three of red, green and blue");
        }
        if self.kinds.is_empty() {
            return wrong("the list of kinds", "empty".into(), "one to three of them");
        }
        if !between(&self.views, MOST) || !between(&[self.layers], MOST) {
            return wrong("views or layers", format!("{:?}, {}", self.views, self.layers), "1 to 64 each");
        }
        if !(3..=8).contains(&self.slots) {
            return wrong("the number of slots", self.slots.to_string(), "3 to 8");
        }
        let positive = |v: f64| v.is_finite() && v > 0.0;
        if !positive(self.pixel_angle) || !self.eyebox_mm.iter().all(|v| positive(*v)) {
            let found = format!("{}, {:?}", self.pixel_angle, self.eyebox_mm);
            return wrong("the angle of a pixel, or the eyebox", found, "positive, finite numbers");
        }
        // The factors are at most 2^32, 2^12, 4 and 4, so nothing overflows.
        let bytes = self.region_bytes();
        if bytes > REGION {
            return wrong(
                "the shared memory",
                format!("{bytes} bytes"),
                "at most 16 GiB, with fewer views, layers or pixels",
            );
        }
        Ok(())
    }
}

/// The expected pupil at the time when the next set is lit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pupil {
    /// The center as x, y in mm.
    pub center_mm: [f64; 2],
    /// The diameter of the pupil in mm.
    pub diameter_mm: f64,
    /// The focus of the eye in dioptres.
    pub focus_dioptres: f64,
    /// The velocity as x, y in millimeters per second.
    pub velocity_mm_s: [f64; 2],
    /// True if the values come from an eye tracker.
    pub tracked: bool,
}

/// The content that suits a display best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// The kind of the content.
    pub kind: Kind,
    /// Rows and columns of views.
    pub views: [u32; 2],
    /// The distance of neighboring views, in mm.
    pub pitch_mm: f64,
    /// The position for the middle view, or for the camera, as x, y in mm.
    pub center_mm: [f64; 2],
}

/// A request of a display. Times are in nanoseconds of `CLOCK_MONOTONIC`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Request {
    /// The number of the request, which [`Display::ask`](crate::Display::ask) counts from 1.
    pub number: u64,
    /// The time at which the next set is lit.
    pub lit_ns: i64,
    /// The time from one set to the next.
    pub period_ns: u64,
    /// The expected pupil at that time.
    pub pupil: Pupil,
    /// The content that suits the display best.
    pub wanted: Wanted,
}
