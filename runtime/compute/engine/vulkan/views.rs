//! Stores the views on the device, one pyramid level after the other, in blocks of whole views.

use super::super::EngineError;
use crate::gpu::{self, Block, Commands, Gpu};
use crate::scene::{Pyramid, ViewsOnDevice};
use std::any::Any;
use std::ops::Range;
use std::sync::Arc;

/// Bytes of the largest block. Several blocks fit into fragmented memory.
const LARGEST: u64 = 512 << 20;

/// Views of one level in one block.
pub(super) struct Piece {
    /// Index of the block.
    pub(super) block: usize,
    pub(super) views: Range<usize>,
    /// Offset of the views in the block, in u16 values.
    pub(super) offset: usize,
}

/// One resolution of all views.
pub(super) struct Level {
    pub(super) height: usize,
    pub(super) width: usize,
    /// Distance from one view to the next, in u16 values.
    pub(super) stride: usize,
    /// All views, in order.
    pub(super) pieces: Vec<Piece>,
}

/// All views, with their levels and blocks.
pub(super) struct Views {
    pub(super) count: usize,
    pub(super) levels: Vec<Level>,
    pub(super) blocks: Vec<Block>,
}

impl Views {
    /// Returns the views of a pyramid. They are used in place if they are in this device's memory, and otherwise
    /// uploaded.
    pub(super) fn of(gpu: &mut Commands, pyramid: &Arc<Pyramid>) -> Result<Arc<Self>, EngineError> {
        if let Some(views) = pyramid.on_device().and_then(DeviceViews::of)
            && views.blocks.iter().all(|block| block.is_on(&gpu.device))
        {
            return Ok(Arc::clone(views));
        }
        Ok(Arc::new(Self::new(gpu, &*super::super::on_host(pyramid)?)?))
    }

    /// Uploads a pyramid to the device.
    fn new(gpu: &mut Commands, pyramid: &Pyramid) -> Result<Self, EngineError> {
        let sizes: Vec<_> = pyramid.levels.iter().map(|level| (level.height, level.width)).collect();
        let all = Self::laid_out(gpu, pyramid.count, &sizes)?;
        for (level, from) in all.levels.iter().zip(&pyramid.levels) {
            let values = level.height * level.width;
            for piece in &level.pieces {
                let to = |i: usize| 2 * (piece.offset + i * level.stride) as u64;
                let pieces = (0..piece.views.len()).map(|i| ((2 * i * values) as u64, to(i), 2 * values as u64));
                let views = &from.views[piece.views.start * values..piece.views.end * values];
                gpu.upload(&all.blocks[piece.block], bytemuck::cast_slice(views), pieces)?;
            }
        }
        Ok(all)
    }

    /// Makes room for `count` views with levels of these sizes.
    pub(super) fn laid_out(gpu: &Commands, count: usize, sizes: &[(usize, usize)]) -> Result<Self, EngineError> {
        let largest = gpu.limits.storage_range.min(gpu.limits.allocation).min(LARGEST);
        let mut levels = Vec::with_capacity(sizes.len());
        // The number of values in each block.
        let mut blocks = vec![0];
        for &(height, width) in sizes {
            let stride = (height * width).next_multiple_of(128);
            let most = (largest / (2 * stride as u64)) as usize;
            if most == 0 {
                return Err(gpu.unsuitable(format!("a view takes {} bytes, but a kernel binds {largest}", 2 * stride)));
            }
            let (mut pieces, mut begin) = (Vec::new(), 0);
            while begin < count {
                let offset = *blocks.last().unwrap_or(&0);
                let room = (largest / 2) as usize - offset;
                let views = begin..count.min(begin + room / stride);
                if views.is_empty() {
                    blocks.push(0);
                    continue;
                }
                begin = views.end;
                *blocks.last_mut().unwrap_or(&mut 0) += views.len() * stride;
                pieces.push(Piece { block: blocks.len() - 1, views, offset });
            }
            levels.push(Level { height, width, stride, pieces });
        }
        let blocks = blocks.iter().map(|values| gpu.block(2 * *values as u64, "views")).collect::<Result<_, _>>()?;
        Ok(Self { count, levels, blocks })
    }
}

impl Level {
    /// Returns the range of these views of a piece for a kernel. `views` are in `piece`.
    pub(super) fn range<'a>(&self, blocks: &'a [Block], piece: &Piece, views: &Range<usize>) -> gpu::Range<'a> {
        let begin = piece.offset + (views.start - piece.views.start) * self.stride;
        blocks[piece.block].range(2 * begin as u64, 2 * (views.len() * self.stride) as u64)
    }
}

/// The views that were made on a device, for a pyramid.
pub(super) struct DeviceViews {
    pub(super) views: Arc<Views>,
    pub(super) gpu: Gpu,
}

impl DeviceViews {
    /// Returns the views, if they are a Vulkan device's.
    fn of(views: &dyn ViewsOnDevice) -> Option<&Arc<Views>> {
        let views: &dyn Any = views;
        views.downcast_ref::<Self>().map(|own| &own.views)
    }
}

impl ViewsOnDevice for DeviceViews {
    fn is_lost(&self) -> bool {
        self.gpu.is_lost()
    }

    fn read(&self) -> Result<Vec<Vec<u16>>, String> {
        let mut gpu = Commands::new(&self.gpu).map_err(|e| e.to_string())?;
        let one = |level: &Level| {
            let values = level.height * level.width;
            let mut all = Vec::with_capacity(self.views.count * values);
            for piece in &level.pieces {
                let mut padded = vec![0u16; piece.views.len() * level.stride];
                let from = 2 * piece.offset as u64;
                let pieces = [(from, 0, 2 * padded.len() as u64)];
                gpu.fetch(&self.views.blocks[piece.block], bytemuck::cast_slice_mut(&mut padded), pieces)?;
                padded.chunks_exact(level.stride).for_each(|view| all.extend_from_slice(&view[..values]));
            }
            Ok(all)
        };
        self.views.levels.iter().map(one).collect::<Result<_, EngineError>>().map_err(|e| e.to_string())
    }
}
