//! Holds the data that users of one device pass on without the host, such as phases and video frames for swapchains.

use super::block::Block;
use super::commands::Commands;
use super::error::EngineError;
use super::timeline::Timeline;
use std::sync::Arc;

/// The order of a pixel's colors in a swapchain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelOrder {
    /// Red is the first byte.
    Rgba,
    /// Blue is the first byte.
    Bgra,
}

/// Phases of sub-frames in a device's memory, in an engine's layout. An encoder on the same device takes them without
/// the host.
#[derive(Clone, Copy)]
pub struct PhasesOnDevice<'a> {
    /// Frames from the block's start on, each at a multiple of 256 bytes.
    pub(crate) block: &'a Block,
    pub(crate) frames: usize,
    pub(crate) values: usize,
    /// True for binary angles, false for float32.
    pub(crate) binary_angles: bool,
}

/// A semaphore, and its value from which on the drawn data can be read.
pub type Ready = (Arc<Timeline>, u64);

/// Video frames in a device's memory, four bytes per pixel, rows without gaps. They are allocated once and refilled.
pub struct Pictures {
    /// Memory of the pictures.
    pub block: Arc<Block>,
    /// Bytes from one picture to the next.
    pub step: u64,
    count: usize,
    size: [usize; 2],
    order: PixelOrder,
    /// The signal to wait for before another queue reads the pictures.
    pub ready: Option<Ready>,
}

impl Pictures {
    /// Makes room for `count` pictures of `size` rows and columns.
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
            let reason = format!("a video frame of pixels takes {bytes} bytes, but a kernel binds {limit}");
            return Err(commands.unsuitable(reason));
        }
        let block = Arc::new(commands.block(step * count as u64, "video frames as pixels")?);
        Ok(Self { block, step, count, size, order, ready: None })
    }

    /// Returns the number of pictures.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns the rows and columns.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Returns the order of their colors.
    pub fn order(&self) -> PixelOrder {
        self.order
    }

    /// Returns the bytes of picture `index`.
    ///
    /// # Errors
    /// The errors of the device.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn pixels(&self, gpu: &super::Gpu, index: usize) -> Result<Vec<u8>, EngineError> {
        let mut pixels = vec![0; 4 * self.size[0] * self.size[1]];
        let piece = (index as u64 * self.step, 0, pixels.len() as u64);
        Commands::new(gpu)?.download(&self.block, &mut pixels, [piece])?;
        Ok(pixels)
    }

    /// Returns true if a swapchain still reads them, so that they must not be filled.
    pub fn in_use(&self) -> bool {
        Arc::strong_count(&self.block) > 1
    }
}
