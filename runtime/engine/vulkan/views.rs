//! The views on the device: the levels of the pyramid one behind the other, in blocks of whole views.

use super::super::EngineError;
use crate::gpu::{Block, Commands};
use crate::scene::Pyramid;
use std::ops::Range;

/// Largest block: several of them let memory be found where it is in pieces.
const LARGEST: u64 = 512 << 20;

/// Views of one level, in one block.
pub(super) struct Piece {
    /// Which block.
    pub(super) block: usize,
    pub(super) views: Range<usize>,
    /// Where they start in it, u16 values.
    pub(super) offset: usize,
}

/// One resolution of all views.
pub(super) struct Level {
    pub(super) height: usize,
    pub(super) width: usize,
    /// u16 values from one view to the next.
    pub(super) stride: usize,
    /// All views, in order.
    pub(super) pieces: Vec<Piece>,
}

/// All views.
pub(super) struct Views {
    pub(super) count: usize,
    pub(super) levels: Vec<Level>,
    pub(super) blocks: Vec<Block>,
}

impl Views {
    /// Uploads a pyramid.
    pub(super) fn new(gpu: &mut Commands, pyramid: &Pyramid) -> Result<Self, EngineError> {
        let largest = gpu.limits().storage_range.min(gpu.limits().allocation).min(LARGEST);
        let mut levels = Vec::with_capacity(pyramid.levels.len());
        // Values in each block.
        let mut sizes = vec![0];
        for level in &pyramid.levels {
            let stride = (level.height * level.width).next_multiple_of(128);
            let most = (largest / (2 * stride as u64)) as usize;
            if most == 0 {
                return Err(EngineError::Unsuitable {
                    device: gpu.report().name.clone(),
                    reason: format!("a view takes {} bytes, a kernel may see {largest}", 2 * stride),
                });
            }
            let (mut pieces, mut begin) = (Vec::new(), 0);
            while begin < pyramid.count {
                let offset = *sizes.last().unwrap_or(&0);
                let room = (largest / 2) as usize - offset;
                let views = begin..pyramid.count.min(begin + room / stride);
                if views.is_empty() {
                    sizes.push(0);
                    continue;
                }
                begin = views.end;
                *sizes.last_mut().unwrap_or(&mut 0) += views.len() * stride;
                pieces.push(Piece { block: sizes.len() - 1, views, offset });
            }
            levels.push(Level { height: level.height, width: level.width, stride, pieces });
        }
        let blocks: Vec<Block> =
            sizes.iter().map(|values| gpu.block(2 * *values as u64, "views")).collect::<Result<_, _>>()?;
        for (level, from) in levels.iter().zip(&pyramid.levels) {
            let values = level.height * level.width;
            for piece in &level.pieces {
                let to = |i: usize| 2 * (piece.offset + i * level.stride) as u64;
                let pieces = (0..piece.views.len()).map(|i| ((2 * i * values) as u64, to(i), 2 * values as u64));
                let views = &from.views[piece.views.start * values..piece.views.end * values];
                gpu.upload(&blocks[piece.block], bytemuck::cast_slice(views), pieces)?;
            }
        }
        Ok(Self { count: pyramid.count, levels, blocks })
    }
}
