//! Draws pictures of splats on the device, from the lists of their tiles.
//!
//! The kernel is `draw_splats`, which is not part of lists. The host projects the splats and makes the lists of the
//! tiles. The device draws the pixels, which are most of the work, and the host reads the picture.

use super::super::EngineError;
use crate::gpu::{Block, Commands, Gpu};
use crate::scene::{SplatDrawer, TiledSplats};
use eyebox_kernels::draw_splats::{Args, SIDE, VALUES};
use eyebox_spirv as spirv;
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Draws pictures of splats on a Vulkan device, one after the other.
pub struct VulkanSplats {
    drawing: Mutex<Drawing>,
    has_failed: AtomicBool,
}

struct Drawing {
    // Fields are dropped in this order, the device last.
    /// Splats, first entries, entries and pixels. They grow with the pictures.
    blocks: [Option<Block>; 4],
    gpu: Commands,
}

impl VulkanSplats {
    /// Makes a drawer on this device.
    ///
    /// # Errors
    /// [`EngineError`] if memory runs out or the device is lost.
    pub fn new(gpu: &Gpu) -> Result<Self, EngineError> {
        let mut gpu = Commands::new(gpu)?;
        // In place, the host copies on all cores. A thread that waits for other threads in a parallel loop over views
        // may take up another view, which would wait for this drawer forever.
        gpu.in_place = false;
        let drawing = Mutex::new(Drawing { blocks: [const { None }; 4], gpu });
        Ok(Self { drawing, has_failed: AtomicBool::new(false) })
    }

    /// Draws a picture, as [`draw_splats`](eyebox_kernels::draw_splats::draw_splats) does. It has [`VALUES`] planes.
    ///
    /// # Errors
    /// [`EngineError`] if the lists or the picture do not fit the device or each other, memory runs out, or the device
    /// is lost.
    pub fn picture(&self, args: &Args, tiled: &TiledSplats, picture: &mut [f32]) -> Result<(), EngineError> {
        self.drawing.lock().unwrap_or_else(PoisonError::into_inner).draw(args, tiled, picture)
    }
}

impl SplatDrawer for VulkanSplats {
    fn draw(&self, args: &Args, tiled: &TiledSplats, picture: &mut [f32]) -> bool {
        let Err(error) = self.picture(args, tiled, picture) else { return true };
        if !self.has_failed.swap(true, Ordering::Relaxed) {
            tracing::warn!("the CPU draws views of splats because of an error. {error}");
        }
        false
    }
}

impl fmt::Debug for VulkanSplats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("VulkanSplats")
    }
}

impl Drawing {
    fn draw(&mut self, args: &Args, tiled: &TiledSplats, picture: &mut [f32]) -> Result<(), EngineError> {
        let TiledSplats { splats, first, entries } = tiled;
        let fits = first.len() == args.tiles() + 1
            && first.last().is_some_and(|end| *end as usize == entries.len())
            && first.is_sorted()
            && entries.iter().all(|entry| (*entry as usize) < splats.len())
            && picture.len() == VALUES * (args.height * args.width) as usize;
        if !fits {
            return Err(EngineError::mismatch("the lists of the tiles or the picture do not belong to the splats"));
        }
        let inputs: [&[u8]; 3] =
            [bytemuck::cast_slice(splats), bytemuck::cast_slice(first), bytemuck::cast_slice(entries)];
        let sizes = [inputs[0].len(), inputs[1].len(), inputs[2].len(), size_of_val(picture)].map(|n| n as u64);
        self.make_room(sizes)?;
        self.gpu.gather_uploads();
        let uploaded =
            inputs.iter().zip(&mut self.blocks).filter(|(data, _)| !data.is_empty()).try_for_each(|(data, block)| {
                match block {
                    Some(block) => self.gpu.put(block, data, [(0, 0, data.len() as u64)]),
                    None => Ok(()),
                }
            });
        let sent = self.gpu.send_uploads();
        uploaded.and(sent)?;
        let pipeline = self.gpu.pipeline(&spirv::DRAW_SPLATS, 4, &[])?;
        let [Some(splats), Some(first), Some(entries), Some(pixels)] = &self.blocks else { return Ok(()) };
        let buffers = [splats.all(), first.all(), entries.all(), pixels.all()];
        let groups = [args.across, args.height.div_ceil(SIDE), 1];
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.barrier();
        self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(args), groups)?;
        self.gpu.recorder.submit("draw_splats")?;
        self.gpu.fetch(pixels, bytemuck::cast_slice_mut(picture), [(0, 0, sizes[3])])
    }

    /// Makes blocks of at least these bytes.
    fn make_room(&mut self, sizes: [u64; 4]) -> Result<(), EngineError> {
        let limit = self.gpu.limits.storage_range.min(self.gpu.limits.allocation);
        let names = ["splats", "tiles of splats", "entries of tiles", "a picture of splats"];
        for ((block, size), name) in self.blocks.iter_mut().zip(sizes).zip(names) {
            if size > limit {
                return Err(self.gpu.unsuitable(format!("{name} take {size} bytes, but a kernel binds {limit}")));
            }
            if block.as_ref().is_none_or(|block| block.size < size.max(4)) {
                // The next views have about as many entries, so the room is a little larger.
                let room = (size + size / 4).next_multiple_of(256).min(limit).max(256);
                *block = None;
                *block = Some(self.gpu.block(room, name)?);
            }
        }
        Ok(())
    }
}
