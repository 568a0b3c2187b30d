//! Writes the layers of a frame as the words that the kernel reads.

use super::fault::Fault;
use super::memory::Memory;
use crate::composition::{Alpha, Cylinder, DepthRange, Format, Frustum, Quad, Taps, srgb_curve, taps};
use eyebox_kernels::compose_layer as kernel;

/// A rectangle of texels.
#[derive(Clone, Copy)]
pub struct Texels<'a> {
    pub format: Format,
    /// Rows and columns of the rectangle.
    pub size: [usize; 2],
    /// The bytes from one row to the next.
    pub stride: usize,
    pub bytes: Bytes<'a>,
}

/// The place of texels.
#[derive(Clone, Copy)]
pub enum Bytes<'a> {
    /// Memory of the host, from the first texel on.
    Host(&'a [u8]),
    /// Memory of the device, with the byte of the first texel.
    Device(&'a Memory, u64),
}

/// The place of a layer's image.
#[derive(Clone, Copy)]
pub enum SeenPlace<'a> {
    /// The view of the eye, whose edges have these tangents (left, right, up, down), with its depth. Without depth, it
    /// has these dioptres.
    View {
        edges: [f64; 4],
        depth: Option<(Texels<'a>, DepthRange)>,
        dioptres: f32,
    },
    Quad(&'a Quad),
    Cylinder(&'a Cylinder),
}

/// A layer as the eye sees it.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    pub color: Texels<'a>,
    pub alpha: Alpha,
    pub place: SeenPlace<'a>,
}

/// A range of a buffer for a binding.
#[derive(Clone, Copy)]
pub(super) struct Range<'a> {
    /// The buffer, or none for the buffer of tables.
    pub buffer: Option<&'a Memory>,
    pub begin: u64,
    pub bytes: u64,
}

/// A layer for one run of the kernel.
pub(super) struct Run<'a> {
    pub record: u32,
    pub color: Range<'a>,
    pub depth: Range<'a>,
}

/// The words of a frame. Records and tables come first, then texels of the host.
pub(super) struct Tables {
    words: Vec<u32>,
    alignment: u64,
    /// The bytes of the largest range.
    most: u64,
}

impl Tables {
    pub fn new(alignment: u64, most: u64) -> Self {
        Self { words: Vec::new(), alignment, most }
    }

    /// Returns the words of the frame.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Writes the layers. Returns their runs, and the range of the tables. A layer that cannot be seen has no run.
    ///
    /// # Errors
    /// Returns [`Fault::Size`] if the texels of a layer are too many for the device.
    pub fn fill<'a>(
        &mut self,
        frustum: &Frustum,
        layers: &[Seen<'a>],
    ) -> Result<(Vec<Run<'a>>, Range<'static>), Fault> {
        self.words.clear();
        self.words.extend(srgb_curve().iter().map(|light| light.to_bits()));
        let mut records = Vec::with_capacity(layers.len());
        for layer in layers {
            let Some(record) = self.record(frustum, layer) else { continue };
            records.push((record, layer));
        }
        let firsts: Vec<u32> = records
            .iter()
            .map(|(record, _)| {
                let first = self.words.len() as u32;
                self.words.extend_from_slice(record);
                first
            })
            .collect();
        let tables = Range { buffer: None, begin: 0, bytes: 4 * self.words.len() as u64 };
        let mut runs = Vec::with_capacity(records.len());
        for (record, (_, layer)) in firsts.into_iter().zip(&records) {
            let color = self.place(record, kernel::COLOR, &layer.color)?;
            let depth = match &layer.place {
                SeenPlace::View { depth: Some((depth, _)), .. } => self.place(record, kernel::DEPTH, depth)?,
                _ => color,
            };
            runs.push(Run { record, color, depth });
        }
        Ok((runs, tables))
    }

    /// Makes the record of a layer, without the places of its texels.
    fn record(&mut self, frustum: &Frustum, layer: &Seen<'_>) -> Option<[u32; kernel::RECORD]> {
        let mut record = [0; kernel::RECORD];
        let Seen { color, alpha, place } = layer;
        let (format, srgb) = code(color.format);
        let flag = |is: bool, flag: u32| if is { flag } else { 0 };
        record[kernel::FLAGS] = flag(alpha.blends, kernel::BLENDS)
            | flag(alpha.unpremultiplied, kernel::UNPREMULTIPLIED)
            | flag(alpha.inverted, kernel::INVERTED)
            | flag(srgb, kernel::SRGB);
        let [rows, columns] = color.size.map(|n| n as u32);
        record[kernel::COLOR] = format;
        record[kernel::COLOR + 3..kernel::COLOR + 5].copy_from_slice(&[rows, columns]);
        let (kind, surface) = match place {
            SeenPlace::View { edges: [left, right, up, down], depth, dioptres } => {
                let of = |axis: usize, count: usize| {
                    let edges = if axis == 1 { [*left, *right] } else { [*up, *down] };
                    taps(frustum.tangents(axis), frustum.angle, edges, count)
                };
                record[kernel::TABLES] = self.taps(&of(1, color.size[1]));
                record[kernel::TABLES + 1] = self.taps(&of(0, color.size[0]));
                record[kernel::DIOPTRES] = dioptres.to_bits();
                if let Some((depth, range)) = depth {
                    record[kernel::DEPTH] = code(depth.format).0;
                    record[kernel::TABLES + 2] = self.nearest(&of(1, depth.size[1]));
                    record[kernel::TABLES + 3] = self.nearest(&of(0, depth.size[0]));
                    let range = range.words().map(f32::to_bits);
                    record[kernel::RANGE..kernel::RANGE + 4].copy_from_slice(&range);
                }
                (kernel::VIEW, [0.0; kernel::RECORD - kernel::SURFACE])
            }
            SeenPlace::Quad(quad) => (kernel::QUAD, quad.words()?),
            SeenPlace::Cylinder(cylinder) => (kernel::CYLINDER, cylinder.words()?),
        };
        record[kernel::KIND] = kind;
        record[kernel::SURFACE..].copy_from_slice(&surface.map(f32::to_bits));
        Some(record)
    }

    /// Writes the samples of each pixel, and returns their first word.
    fn taps(&mut self, all: &[Option<Taps>]) -> u32 {
        let first = self.words.len();
        self.words.resize(first + kernel::TAP * all.len(), 0);
        for (pixel, taps) in all.iter().enumerate() {
            let Some(Taps { first: sample, weights, .. }) = taps else { continue };
            let at = first + kernel::TAP * pixel;
            let tap = [*sample as u32, weights.len() as u32, self.words.len() as u32];
            self.words[at..at + kernel::TAP].copy_from_slice(&tap);
            self.words.extend(weights.iter().map(|weight| weight.to_bits()));
        }
        first as u32
    }

    /// Writes the nearest sample of each pixel, and returns their first word.
    fn nearest(&mut self, all: &[Option<Taps>]) -> u32 {
        let first = self.words.len() as u32;
        let nearest = |taps: &Option<Taps>| taps.as_ref().map_or(kernel::OUTSIDE, |taps| taps.nearest as u32);
        self.words.extend(all.iter().map(nearest));
        first
    }

    /// Writes the place of texels to a record, and returns their range. Texels of the host follow the tables.
    fn place<'a>(&mut self, record: u32, at: usize, texels: &Texels<'a>) -> Result<Range<'a>, Fault> {
        let [rows, columns] = texels.size;
        let length = rows.saturating_sub(1) * texels.stride + columns * texels.format.bytes();
        let (buffer, begin, end) = match texels.bytes {
            Bytes::Host(bytes) => {
                let unit = (self.alignment / 4) as usize;
                self.words.resize(self.words.len().next_multiple_of(unit), 0);
                let begin = self.words.len();
                self.words.resize(begin + length.div_ceil(4), 0);
                let to: &mut [u8] = bytemuck::cast_slice_mut(&mut self.words[begin..]);
                let bytes = &bytes[..length.min(bytes.len())];
                to[..bytes.len()].copy_from_slice(bytes);
                (None, 4 * begin as u64, 4 * self.words.len() as u64)
            }
            Bytes::Device(memory, begin) => (Some(memory), begin, memory.bytes),
        };
        let first = begin % self.alignment;
        let bytes = (first + length as u64).next_multiple_of(4);
        if bytes > self.most || begin - first + bytes > end {
            return Err(Fault::Size { found: bytes, most: self.most.min(end.saturating_sub(begin - first)) });
        }
        // The first byte, and the bytes from row to row, follow the format.
        let words = &mut self.words[record as usize + at + 1..];
        (words[0], words[1]) = (first as u32, texels.stride as u32);
        Ok(Range { buffer, begin: begin - first, bytes })
    }
}

/// Returns the kernel's name of a format, and whether it has the sRGB curve.
fn code(format: Format) -> (u32, bool) {
    match format {
        Format::Rgba8 { srgb } => (kernel::RGBA8, srgb),
        Format::Bgra8 { srgb } => (kernel::BGRA8, srgb),
        Format::Rgb10A2 => (kernel::RGB10A2, false),
        Format::Rgba16Float => (kernel::RGBA16, false),
        Format::D16 => (kernel::D16, false),
        Format::D24 => (kernel::D24, false),
        Format::D32 => (kernel::D32, false),
    }
}
