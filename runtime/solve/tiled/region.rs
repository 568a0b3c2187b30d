//! Chooses the size of a region, by the memory and by the largest pupil.

use super::TiledError;
use crate::optics::Optics;
use crate::plan::ModelTables;
use std::sync::Arc;

/// Total bytes that a solve or a simulation may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryLimit(pub u64);

/// Memory of the program itself, its threads, and the plans of transforms.
const PROGRAM: u64 = 160 << 20;

/// The side of a region, and its memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RegionSize {
    /// Rows in pixels, as whole tiles, or as many as the hologram has, if these are fewer.
    pub rows: usize,
    /// Columns in pixels, as for the rows.
    pub columns: usize,
    /// Peak memory in bytes.
    pub bytes: u64,
}

impl RegionSize {
    /// Chooses the size for pupils of up to `diameter` meters on the SLM of `optics`.
    ///
    /// The tiles are `side` wide, and the views have `picture` x `picture` pixels. The `models` are the display models
    /// of the colors on the whole SLM.
    ///
    /// # Errors
    /// [`TiledError::Memory`] if the memory is too small for the largest pupil.
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
        // The region has space for the largest pupil to move, if the memory allows it.
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
    /// Returns the rows and columns of a region at (row, column) that are on an SLM of `whole` pixels.
    pub(super) fn inside(&self, at: [usize; 2], whole: [usize; 2]) -> [usize; 2] {
        [self.rows.min(whole[0] - at[0]), self.columns.min(whole[1] - at[1])]
    }
}

/// Returns true if sub-frames affect each other, so that an engine has to hold all of them.
pub(super) fn lags(model: Option<&ModelTables>) -> bool {
    model.is_some_and(|model| model.model().lag > 0.0)
}

/// Returns the bytes of a visit to a region of `pixels` pixels.
fn bytes(pixels: usize, frames: usize, picture: usize, model: Option<&ModelTables>) -> u64 {
    // These are the sub-frames that an engine holds at once.
    let at_once = if lags(model) { frames as u64 } else { 1 };
    // The region needs its phases, and again as tiles while they are read or written a row at a time. A sub-frame needs
    // phases, velocity, field, change, hits and the copy that is handed over. The pupils' windows cover the region
    // about one and a half times with field, transfer function, image and target, and with their shares of a
    // transform's scratch.
    let frames = frames as u64;
    let windows = 3 * (8 * at_once + 8 + 4 + 4) / 2 + 8;
    let mut region = 4 * frames + frames + (4 + 4 + 8 + 8 + 4) * at_once + 4 + windows;
    if let Some(model) = model {
        // A sub-frame needs the values between drive value and field. The model's tables exist in the plan and in the
        // engine.
        let [driven, relay] = [model.parts().drives, model.parts().relay > 0].map(u64::from);
        region += (4 + 4) * at_once * driven + 2 * 16 * driven + 3 * 8 * relay + 4 * frames;
    }
    // Views are stored, and the textures from which they are made. While they are made as float32, no fields exist.
    let (views, making) = (crate::evaluate::MOST_VIEWS as u64 * 3 + 300, crate::evaluate::MOST_VIEWS as u64 * 4);
    let (pixels, picture) = (pixels as u64, (picture * picture) as u64);
    PROGRAM + picture * views + (pixels * region).max(5 * frames * pixels + picture * making)
}
