//! The views on the device: each level of the pyramid in blocks of whole views.

use super::super::EngineError;
use crate::gpu::{Block, Commands};
use crate::scene::Pyramid;

/// Largest block: several of them let memory be found where it is in pieces.
const LARGEST: u64 = 256 << 20;

/// One resolution of all views.
pub(super) struct Level {
    pub(super) height: usize,
    pub(super) width: usize,
    /// u16 values from one view to the next.
    pub(super) stride: usize,
    /// Views per block.
    share: usize,
    pub(super) blocks: Vec<Block>,
}

impl Level {
    /// Which block holds a view.
    pub(super) fn chunk_of(&self, view: usize) -> usize {
        view / self.share
    }

    /// Per block, its number and its first view.
    pub(super) fn firsts(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let share = self.share;
        (0..self.blocks.len()).map(move |chunk| (chunk, chunk * share))
    }
}

/// All views.
pub(super) struct Views {
    pub(super) count: usize,
    pub(super) levels: Vec<Level>,
}

impl Views {
    /// Uploads a pyramid.
    pub(super) fn new(gpu: &mut Commands, pyramid: &Pyramid) -> Result<Self, EngineError> {
        let largest = gpu.limits().storage_range.min(gpu.limits().allocation).min(LARGEST);
        let mut levels = Vec::with_capacity(pyramid.levels.len());
        for level in &pyramid.levels {
            let values = level.height * level.width;
            let stride = values.next_multiple_of(128);
            let share = (largest / (2 * stride as u64)) as usize;
            if share == 0 {
                return Err(EngineError::Unsuitable {
                    device: gpu.report().name.clone(),
                    reason: format!("a view takes {} bytes, a kernel may see {largest}", 2 * stride),
                });
            }
            let mut blocks = Vec::new();
            for views in level.views.chunks((share * values).max(1)) {
                let count = views.len() / values;
                let block = gpu.block((2 * stride * count) as u64, "views")?;
                let piece = |i: usize| ((2 * i * values) as u64, (2 * i * stride) as u64, 2 * values as u64);
                gpu.upload(&block, bytemuck::cast_slice(views), (0..count).map(piece))?;
                blocks.push(block);
            }
            levels.push(Level { height: level.height, width: level.width, stride, share, blocks });
        }
        Ok(Self { count: pyramid.count, levels })
    }
}
