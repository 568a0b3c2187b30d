//! What passes between users of one device without the host: phases, and video frames that are ready for its swapchains.

use super::block::Block;
use super::commands::Commands;
use super::error::EngineError;
use super::recorder::Timeline;
use std::sync::Arc;

/// In which order a swapchain has the colours of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelOrder {
    /// Red first.
    Rgba,
    /// Blue first.
    Bgra,
}

/// Phases of sub-frames in a device's memory, as an engine there has them: what an encoder on the same device takes without
/// the host.
#[derive(Clone, Copy)]
pub struct PhasesOnDevice<'a> {
    /// Frames from its start on, each at a multiple of 256 bytes.
    pub(crate) block: &'a Block,
    pub(crate) frames: usize,
    pub(crate) values: usize,
    /// Whether they are binary angles, else float32.
    pub(crate) binary_angles: bool,
}

/// A semaphore, and the value from which on what was drawn can be read.
pub type Ready = (Arc<Timeline>, u64);

/// Video frames in a device's memory, four bytes a pixel, rows without gaps: made once, filled again and again.
pub struct Pictures {
    /// Their memory.
    pub block: Arc<Block>,
    /// Bytes from one to the next.
    pub step: u64,
    count: usize,
    size: [usize; 2],
    order: PixelOrder,
    /// What has to be waited for before they are read on another queue.
    pub ready: Option<Ready>,
}

impl Pictures {
    /// Room for so many of `size` rows and columns.
    pub(crate) fn new(
        commands: &Commands,
        count: usize,
        size: [usize; 2],
        order: PixelOrder,
    ) -> Result<Self, EngineError> {
        let bytes = 4 * (size[0] * size[1]) as u64;
        let limit = commands.limits.storage_range;
        let step = bytes.next_multiple_of(256);
        if step > limit {
            let reason = format!("one video frame takes {bytes} bytes as pixels, a kernel may see {limit}");
            return Err(commands.unsuitable(reason));
        }
        let block = Arc::new(commands.block(step * count as u64, "video frames as pixels")?);
        Ok(Self { block, step, count, size, order, ready: None })
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Rows, columns.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// The order of their colours.
    pub fn order(&self) -> PixelOrder {
        self.order
    }

    /// Returns the bytes of picture `index`.
    ///
    /// # Errors
    /// Those of the device.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn pixels(&self, gpu: &super::Gpu, index: usize) -> Result<Vec<u8>, EngineError> {
        let mut pixels = vec![0; 4 * self.size[0] * self.size[1]];
        let piece = (index as u64 * self.step, 0, pixels.len() as u64);
        Commands::new(gpu)?.download(&self.block, &mut pixels, [piece])?;
        Ok(pixels)
    }

    /// Whether a swapchain still reads them: they must not be filled.
    pub fn in_use(&self) -> bool {
        Arc::strong_count(&self.block) > 1
    }
}
