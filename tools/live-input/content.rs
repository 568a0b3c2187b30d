//! What a display takes and wants, and what a frame is.

use crate::{LiveError, MOST};

/// What a frame is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Views from a grid of places in the pupil plane.
    Views = 1,
    /// A picture and how far each of its pixels is.
    ColorAndDepth = 2,
    /// Pictures with opacity, one before the other.
    Layers = 4,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Views, Self::ColorAndDepth, Self::Layers];
}

/// How a sample is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Sample {
    /// 8 bits, 255 is full scale.
    U8 = 1,
    /// 16 bits, 65535 is full scale.
    U16 = 2,
    /// Float of 16 bits, 1 is full scale.
    F16 = 3,
    /// Float of 32 bits, 1 is full scale.
    F32 = 4,
}

impl Sample {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::U8, Self::U16, Self::F16, Self::F32];

    /// Bytes of one.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
        }
    }
}

/// How colour samples become light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Transfer {
    /// They are linear light.
    Linear = 1,
    /// By the sRGB curve; of whole numbers alone.
    Srgb = 2,
}

/// How far the layers of a frame are: dioptres, the farthest first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dioptres {
    pub(crate) count: u32,
    pub(crate) values: [f32; MOST as usize],
}

impl Dioptres {
    /// Of the first 64 of `values`; whether they are right is judged where a frame begins.
    pub fn new(values: &[f32]) -> Self {
        let mut all = [0.0; MOST as usize];
        let count = values.len().min(all.len());
        all[..count].copy_from_slice(&values[..count]);
        Self { count: count as u32, values: all }
    }

    /// One for each layer.
    pub fn as_slice(&self) -> &[f32] {
        &self.values[..self.count as usize]
    }
}

/// What a frame is made of, with what belongs to its kind.
#[allow(clippy::large_enum_variant, reason = "layers keep their dioptres within, so that nothing is allocated")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Content {
    /// (view row, view column, row, column, colour).
    Views {
        /// Rows and columns of views.
        grid: [u32; 2],
        /// Between neighbouring views in the pupil plane.
        pitch_mm: f64,
    },
    /// (row, column, colour), and float32 dioptres of (row, column).
    ColorAndDepth,
    /// (layer, row, column, colour and opacity), the farthest first.
    Layers(Dioptres),
}

impl Content {
    /// Which kind it is.
    pub fn kind(&self) -> Kind {
        match self {
            Self::Views { .. } => Kind::Views,
            Self::ColorAndDepth => Kind::ColorAndDepth,
            Self::Layers(_) => Kind::Layers,
        }
    }
}

/// All that a frame says of itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInfo {
    /// What it is made of.
    pub content: Content,
    /// How a sample is stored.
    pub sample: Sample,
    /// How colour samples become light.
    pub transfer: Transfer,
    /// The number of the request that it answers; 0 for none.
    pub request: u64,
    /// The moment of the content that it shows, nanoseconds of `CLOCK_MONOTONIC`.
    pub content_time_ns: i64,
    /// Where the middle view, or the camera, stands in the pupil plane: x, y.
    pub center_mm: [f64; 2],
    /// Whether its samples are in the device's memory that the display shares, in the slot of the same number; else they stand
    /// behind the header. Of views alone.
    pub on_device: bool,
}

impl FrameInfo {
    /// From the middle of the eyebox, in answer to no request, at the moment 0, with samples in the region.
    pub fn new(content: Content, sample: Sample, transfer: Transfer) -> Self {
        Self { content, sample, transfer, request: 0, content_time_ns: 0, center_mm: [0.0; 2], on_device: false }
    }
}

/// What a display takes. It decides the size of the shared memory, whatever an application gives.
#[derive(Debug, Clone, PartialEq)]
pub struct Offer {
    /// Rows and columns of every picture.
    pub size: [u32; 2],
    /// Red, green, blue: which of them.
    pub colors: [bool; 3],
    /// The kinds that are taken.
    pub kinds: Vec<Kind>,
    /// Most rows and columns of views.
    pub views: [u32; 2],
    /// Most layers.
    pub layers: u32,
    /// How many frames the ring holds, 3 to 8.
    pub slots: u32,
    /// Angle between neighbouring pixels, radians.
    pub pixel_angle: f64,
    /// Width and height of the eyebox.
    pub eyebox_mm: [f64; 2],
}

/// Bytes before the first slot; slots are multiples of it apart.
pub(crate) const PAGE: usize = 4096;
/// Bytes of a slot before its samples.
pub(crate) const HEADER: usize = 512;
/// The largest region, bytes.
const REGION: u64 = 16 << 30;

impl Offer {
    /// How many colours.
    pub fn channels(&self) -> usize {
        self.colors.iter().filter(|c| **c).count()
    }

    /// Pixels of a picture.
    pub fn pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Samples of colour and opacity of a frame of this content.
    pub(crate) fn samples(&self, content: &Content) -> usize {
        let per_pixel = match content {
            Content::Views { grid, .. } => grid[0] as usize * grid[1] as usize * self.channels(),
            Content::ColorAndDepth => self.channels(),
            Content::Layers(dioptres) => dioptres.count as usize * (self.channels() + 1),
        };
        self.pixels() * per_pixel
    }

    /// Bytes of samples of a frame, where its depth begins among them.
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

    /// The largest frame of each kind that is taken.
    pub(crate) fn largest(&self) -> impl Iterator<Item = Content> + '_ {
        self.kinds.iter().map(|kind| match kind {
            Kind::Views => Content::Views { grid: self.views, pitch_mm: 1.0 },
            Kind::ColorAndDepth => Content::ColorAndDepth,
            Kind::Layers => Content::Layers(Dioptres { count: self.layers, values: [0.0; MOST as usize] }),
        })
    }

    /// Bytes of samples that a slot holds.
    pub(crate) fn slot_bytes(&self) -> usize {
        self.largest().map(|content| self.bytes(&content, Sample::F32)[0]).max().unwrap_or(0).next_multiple_of(64)
    }

    /// Bytes from one slot to the next.
    pub(crate) fn slot_stride(&self) -> usize {
        (HEADER + self.slot_bytes()).next_multiple_of(PAGE)
    }

    /// Bytes of a whole region.
    pub(crate) fn region_bytes(&self) -> u64 {
        (PAGE + self.slots as usize * self.slot_stride()) as u64
    }

    /// # Errors
    /// [`LiveError::Offer`], with what is right.
    pub(crate) fn check(&self) -> Result<(), LiveError> {
        let wrong = |what, found: String, must| Err(LiveError::Offer { what, found, must });
        let between = |values: &[u32], most| values.iter().all(|v| (1..=most).contains(v));
        if !between(&self.size, 65_536) {
            return wrong("the size", format!("{:?}", self.size), "1 to 65536 rows and columns");
        }
        if self.channels() == 0 {
            return wrong("the list of colours", "empty".into(), "one to three of red, green and blue");
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
        // Factors of 2^32, 2^12, 4 and 4: nothing overflows.
        let bytes = self.region_bytes();
        if bytes > REGION {
            return wrong(
                "the shared memory",
                format!("{bytes} bytes"),
                "16 GiB at most: fewer views or layers, or smaller",
            );
        }
        Ok(())
    }
}

/// Where the pupil will be when the next set lights up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pupil {
    /// Its middle: x, y.
    pub center_mm: [f64; 2],
    /// Its diameter.
    pub diameter_mm: f64,
    /// Where it is focused, dioptres.
    pub focus_dioptres: f64,
    /// How fast it moves: x, y, millimetres a second.
    pub velocity_mm_s: [f64; 2],
    /// Whether an eye tracker says so.
    pub tracked: bool,
}

/// Which content a display would like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Of which kind.
    pub kind: Kind,
    /// Rows and columns of views.
    pub views: [u32; 2],
    /// Between neighbouring views.
    pub pitch_mm: f64,
    /// Where the middle view, or the camera, should stand: x, y.
    pub center_mm: [f64; 2],
}

/// What a display asks for. Times are nanoseconds of `CLOCK_MONOTONIC`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Request {
    /// Counted by [`Display::ask`](crate::Display::ask) from 1.
    pub number: u64,
    /// When the next set will be lit.
    pub lit_ns: i64,
    /// From one set to the next.
    pub period_ns: u64,
    /// Where the pupil will be then.
    pub pupil: Pupil,
    /// Which content would fit.
    pub wanted: Wanted,
}
