//! How large a region may be: as large as memory allows, and no larger than the largest pupil makes sensible.

use super::TiledError;
use crate::optics::Optics;

/// Bytes that a solve or a look may take in all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryLimit(pub u64);

/// The program itself, threads, transforms' plans.
const PROGRAM: u64 = 160 << 20;

/// A region's side, and what it takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RegionSize {
    /// Pixels along each axis; whole tiles, or the hologram's own where that is smaller.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Bytes at its peak.
    pub bytes: u64,
}

impl RegionSize {
    /// For pupils of up to `diameter` metres on the SLM of `optics`, whose tiles are `side` wide, with views of `picture` x
    /// `picture` pixels.
    ///
    /// # Errors
    /// [`TiledError::Memory`] where the largest pupil has no room.
    pub fn new(
        optics: &Optics,
        frames: usize,
        side: usize,
        diameter: f64,
        picture: usize,
        memory: MemoryLimit,
    ) -> Result<Self, TiledError> {
        let pupil = (diameter / optics.pitch).ceil() as usize + 2;
        let whole = |pixels: usize| pixels.div_ceil(side) * side;
        let of = |pixels: usize| {
            let (rows, columns) = (whole(pixels).min(optics.height), whole(pixels).min(optics.width));
            Self { rows, columns, bytes: bytes(rows * columns, frames, picture) }
        };
        // Room for the largest pupil to move in, where there is any to spare.
        let wanted = of(pupil + pupil / 4);
        if wanted.bytes <= memory.0 {
            return Ok(wanted);
        }
        let least = of(pupil);
        let mut best = None;
        let mut pixels = pupil;
        while of(pixels).bytes <= memory.0 && pixels <= pupil + pupil / 4 {
            best = Some(of(pixels));
            pixels += side;
        }
        best.ok_or(TiledError::Memory {
            diameter_mm: diameter * 1e3,
            frames,
            needed_mib: least.bytes.div_ceil(1 << 20),
            given_mib: memory.0 >> 20,
        })
    }
}

/// Bytes of a visit to a region of so many pixels.
fn bytes(pixels: usize, frames: usize, picture: usize) -> u64 {
    // The region's phases, and again as tiles while they are read or written a row at a time; one sub-frame's phases,
    // velocity, field, change, hits and the copy that is handed over; then what the pupils' windows hold, which cover the
    // region about once and a half: field, transfer function, image and target; and their shares of a transform's scratch.
    let region = 4 * frames as u64 + frames as u64 + (4 + 4 + 8 + 8 + 4 + 4) + 3 * (8 + 8 + 4 + 4) / 2 + 8;
    // Views: as they are kept, and the textures that they are made of. While they are made, as float32, there are no fields.
    let (views, making) = (crate::evaluate::MOST_VIEWS as u64 * 3 + 300, crate::evaluate::MOST_VIEWS as u64 * 4);
    let (pixels, picture) = (pixels as u64, (picture * picture) as u64);
    PROGRAM + picture * views + (pixels * region).max(5 * frames as u64 * pixels + picture * making)
}
