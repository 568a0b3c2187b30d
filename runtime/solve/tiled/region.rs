//! How large a region may be: as large as memory allows, and no larger than the largest pupil makes sensible.

use super::TiledError;
use crate::optics::Optics;
use crate::plan::ModelTables;
use std::sync::Arc;

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
    /// `picture` pixels; `models` are what the display does to the light of each colour, on the whole SLM.
    ///
    /// # Errors
    /// [`TiledError::Memory`] where the largest pupil has no room.
    pub fn new(
        optics: &Optics,
        models: &[Option<Arc<ModelTables>>],
        frames: usize,
        side: usize,
        diameter: f64,
        picture: usize,
        memory: MemoryLimit,
    ) -> Result<Self, TiledError> {
        let scales = models.iter().map(|model| model.as_ref().map_or(1.0, |model| model.model().iris.scale));
        let diameter = diameter * scales.reduce(f64::max).unwrap_or(1.0);
        let pupil = (diameter / optics.pitch).ceil() as usize + 2;
        let whole = |pixels: usize| pixels.div_ceil(side) * side;
        let of = |pixels: usize| {
            let (rows, columns) = (whole(pixels).min(optics.height), whole(pixels).min(optics.width));
            let of_color = |model: &Option<Arc<ModelTables>>| {
                let held = model.as_ref().map_or([rows, columns], |model| model.around([0, 0], [rows, columns]).1);
                bytes(held[0] * held[1], frames, picture, model.as_deref())
            };
            Self { rows, columns, bytes: models.iter().map(of_color).max().unwrap_or(0) }
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

impl RegionSize {
    /// Rows and columns of a region that begins at (row, column) of an SLM of `whole` pixels: those that are on it.
    pub(super) fn inside(&self, at: [usize; 2], whole: [usize; 2]) -> [usize; 2] {
        [self.rows.min(whole[0] - at[0]), self.columns.min(whole[1] - at[1])]
    }
}

/// Whether sub-frames are seen in each other, so that an engine has to hold all of them.
pub(super) fn lags(model: Option<&ModelTables>) -> bool {
    model.is_some_and(|model| model.model().lag > 0.0)
}

/// Bytes of a visit to a region of so many pixels.
fn bytes(pixels: usize, frames: usize, picture: usize, model: Option<&ModelTables>) -> u64 {
    // Sub-frames that an engine holds at once.
    let at_once = if lags(model) { frames as u64 } else { 1 };
    // The region's phases, and again as tiles while they are read or written a row at a time; of a sub-frame phases,
    // velocity, field, change, hits and the copy that is handed over; then what the pupils' windows hold, which cover the
    // region about once and a half: field, transfer function, image and target; and their shares of a transform's scratch.
    let frames = frames as u64;
    let windows = 3 * (8 * at_once + 8 + 4 + 4) / 2 + 8;
    let mut region = 4 * frames + frames + (4 + 4 + 8 + 8 + 4) * at_once + 4 + windows;
    if let Some(model) = model {
        // Of a sub-frame what lies between drive and field; then the model's tables, in the plan and in the engine.
        let [driven, relay] = [model.parts().drives, model.parts().relay > 0].map(u64::from);
        region += (4 + 4) * at_once * driven + 2 * 16 * driven + 3 * 8 * relay + 4 * frames;
    }
    // Views: as they are kept, and the textures that they are made of. While they are made, as float32, there are no fields.
    let (views, making) = (crate::evaluate::MOST_VIEWS as u64 * 3 + 300, crate::evaluate::MOST_VIEWS as u64 * 4);
    let (pixels, picture) = (pixels as u64, (picture * picture) as u64);
    PROGRAM + picture * views + (pixels * region).max(5 * frames * pixels + picture * making)
}
