//! Draws pictures of splats on the device.
//!
//! The kernels are `project_splats`, `mark_splats` and `draw_splats`, which are not part of lists. The splats of a scene
//! are stored on the device once. For each picture the device projects them, marks the splats in each bin of the
//! picture, and draws its tiles.

use super::super::EngineError;
use crate::gpu::{Block, Commands, Gpu, Range};
use crate::scene::{SplatDrawer, StoredSplats};
use eyebox_kernels::draw_splats::{SIDE, VALUES, WORDS};
use eyebox_kernels::project_splats::{Args, ORDERED};
use eyebox_kernels::{TILE_THREADS, mark_splats};
use eyebox_spirv as spirv;
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Bytes of projected splats and marks of the pictures that are drawn together.
const TOGETHER: u64 = 256 << 20;
/// Most workgroups of a dispatch over splats, which take further splats in turn.
const GROUPS: u32 = 2048;
/// Splats that are uploaded together.
const PART: usize = 1 << 16;

/// The splats of a scene on a device, and room for their projections.
#[derive(Default)]
pub struct DeviceSplats {
    gaussians: Option<Block>,
    order: Option<Block>,
    splats: Option<Block>,
    marks: Option<Block>,
    /// The [number](StoredSplats::id) of the stored splats, and how many there are.
    stored: Option<(u64, usize)>,
}

/// The place of the pictures in a range.
#[derive(Clone, Copy)]
pub(super) struct Pictures<'a> {
    pub to: Range<'a>,
    /// Values from a picture to the next.
    pub next: u32,
    /// Values from a plane of a picture to the next.
    pub stride: u32,
    /// True for three planes of linear light, false for the [`VALUES`] planes of the twin.
    pub light: bool,
}

impl DeviceSplats {
    /// Stores splats on the device, unless they are there. They are drawn in this order of their indices, or in their
    /// own one.
    ///
    /// # Errors
    /// [`EngineError`] if they do not fit the device, memory runs out, or the device is lost.
    pub(super) fn store(
        &mut self,
        gpu: &mut Commands,
        splats: &dyn StoredSplats,
        order: &[u32],
    ) -> Result<(), EngineError> {
        let (id, count) = (splats.id(), splats.count());
        if self.stored != Some((id, count)) {
            self.stored = None;
            let each = if count > 0 { splats.words(0..1).len() as u64 * 4 } else { 4 };
            let block = make_room(gpu, &mut self.gaussians, each * count as u64, "splats")?;
            for first in (0..count).step_by(PART) {
                let words = splats.words(first..count.min(first + PART));
                let size = 4 * words.len() as u64;
                gpu.put(block, bytemuck::cast_slice(&words), [(0, each * first as u64, size)])?;
            }
            self.stored = Some((id, count));
        }
        let bytes: &[u8] = bytemuck::cast_slice(order);
        let block = make_room(gpu, &mut self.order, bytes.len() as u64, "the order of splats")?;
        if order.iter().any(|at| *at as usize >= count) {
            return Err(EngineError::mismatch("the order of the splats does not belong to them"));
        }
        if bytes.is_empty() { Ok(()) } else { gpu.put(block, bytes, [(0, 0, bytes.len() as u64)]) }
    }

    /// Records the drawing of pictures of the stored splats. All cameras have the same size and number of splats. A
    /// barrier is at the end.
    ///
    /// # Errors
    /// [`EngineError`] if the pictures do not fit their range or the device, memory runs out, or the device is lost.
    pub(super) fn record(
        &mut self,
        gpu: &mut Commands,
        cameras: &[Args],
        pictures: &Pictures<'_>,
    ) -> Result<(), EngineError> {
        let Some(first) = cameras.first() else { return Ok(()) };
        let shape = |args: &Args| (args.height, args.width, args.count, args.kind);
        let planes = if pictures.light { 3 } else { VALUES as u64 };
        let ends = (cameras.len() as u64 - 1) * u64::from(pictures.next) + (planes - 1) * u64::from(pictures.stride);
        let pixels = u64::from(first.height) * u64::from(first.width);
        let stored = self.stored.map_or(0, |(_, count)| count as u64);
        let listed = if first.kind & ORDERED == 0 { self.order.as_ref().map_or(0, |o| o.size / 4) } else { u64::MAX };
        let belong =
            cameras.iter().all(|args| shape(args) == shape(first)) && u64::from(first.count) <= stored.min(listed);
        if !belong || 4 * (ends + pixels) > pictures.to.size || pixels == 0 {
            return Err(EngineError::mismatch("the cameras or the pictures do not belong to the splats"));
        }
        let marking = mark_splats::Args::new(first.count as usize, first.height as usize, first.width as usize);
        let aligned = |bytes: u64| bytes.max(4).next_multiple_of(256);
        let of_splats = aligned(4 * WORDS as u64 * u64::from(first.count));
        let of_marks = aligned(4 * u64::from(marking.bins) * u64::from(marking.words));
        let together = (TOGETHER / (of_splats + of_marks)).clamp(1, cameras.len() as u64);
        make_room(gpu, &mut self.splats, of_splats * together, "projected splats")?;
        make_room(gpu, &mut self.marks, of_marks * together, "marks of splats")?;
        let [Some(gaussians), Some(order), Some(splats), Some(marks)] =
            [&self.gaussians, &self.order, &self.splats, &self.marks]
        else {
            return Err(EngineError::mismatch("no splats were stored"));
        };
        let projecting = gpu.pipeline(&spirv::PROJECT_SPLATS, 3, &[])?;
        let marker = gpu.pipeline(&spirv::MARK_SPLATS, 2, &[])?;
        let drawing = gpu.pipeline(&spirv::DRAW_SPLATS, 3, &[])?;
        let groups = [first.count.div_ceil(TILE_THREADS).min(GROUPS), 1, 1];
        let tiles = [first.width.div_ceil(SIDE), first.height.div_ceil(SIDE), 1];
        for (batch, cameras) in cameras.chunks(together as usize).enumerate() {
            let places =
                |i: usize| (splats.range(i as u64 * of_splats, of_splats), marks.range(i as u64 * of_marks, of_marks));
            for (i, camera) in cameras.iter().enumerate() {
                let buffers = [gaussians.all(), order.all(), places(i).0];
                gpu.recorder.dispatch(projecting, &buffers, bytemuck::bytes_of(camera), groups)?;
                gpu.recorder.moved(|| {
                    let read = gaussians.all().reads(gaussians.size.min(of_stored(gaussians, stored, camera)));
                    vec![read, order.all().reads(4 * u64::from(camera.count)), places(i).0.writes(of_splats)]
                });
            }
            gpu.recorder.barrier();
            for i in 0..cameras.len() {
                let (splats, marks) = places(i);
                gpu.recorder.dispatch(marker, &[splats, marks], bytemuck::bytes_of(&marking), groups)?;
                // A sector of the memory is more than the rows and columns of a splat.
                gpu.recorder.moved(|| vec![splats.reads(of_splats * 2 / 3), marks.writes(of_marks)]);
            }
            gpu.recorder.barrier();
            for i in 0..cameras.len() {
                let (splats, marks) = places(i);
                let at = (batch * together as usize + i) as u32 * pictures.next;
                let push = [
                    first.height,
                    first.width,
                    marking.across,
                    marking.words,
                    at,
                    pictures.stride,
                    u32::from(pictures.light),
                ];
                gpu.recorder.dispatch(drawing, &[splats, marks, pictures.to], bytemuck::cast_slice(&push), tiles)?;
                gpu.recorder.moved(|| {
                    let tiles_of_bin = (mark_splats::BIN / SIDE).pow(2) as usize;
                    let mut moves = vec![marks.reads(of_marks); tiles_of_bin];
                    moves.extend([splats.reads(of_splats); 2]);
                    moves.push(pictures.to.writes(4 * planes * pixels));
                    moves
                });
                // The pictures are in one range, and the newest validation layer takes it as a whole.
                gpu.recorder.barrier();
            }
        }
        Ok(())
    }
}

#[cfg(test)]
impl DeviceSplats {
    /// Returns the blocks of the splats and of the marks of the first picture that was drawn last.
    pub(super) fn projected(&self) -> [&Block; 2] {
        [&self.splats, &self.marks].map(|block| block.as_ref().expect("a picture was drawn"))
    }
}

/// Returns the bytes of the splats of a camera, of `stored` ones in a block.
fn of_stored(gaussians: &Block, stored: u64, camera: &Args) -> u64 {
    gaussians.size / stored.max(1) * u64::from(camera.count)
}

/// Makes a block of at least `size` bytes.
pub(super) fn make_room<'a>(
    gpu: &Commands,
    block: &'a mut Option<Block>,
    size: u64,
    name: &str,
) -> Result<&'a mut Block, EngineError> {
    let limit = gpu.limits.storage_range.min(gpu.limits.allocation);
    if size > limit {
        return Err(gpu.unsuitable(format!("{name} take {size} bytes, but a kernel binds {limit}")));
    }
    let fitting = block.take().filter(|block| block.size >= size);
    let made = match fitting {
        Some(fitting) => fitting,
        None => gpu.block(size.next_multiple_of(256).min(limit).max(256), name)?,
    };
    Ok(block.insert(made))
}

/// Draws pictures of splats on a Vulkan device for the host, one after the other.
pub struct VulkanSplats {
    drawing: Mutex<Drawing>,
    has_failed: AtomicBool,
}

struct Drawing {
    // Fields are dropped in this order, the device last.
    splats: DeviceSplats,
    picture: Option<Block>,
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
        let drawing = Mutex::new(Drawing { splats: DeviceSplats::default(), picture: None, gpu });
        Ok(Self { drawing, has_failed: AtomicBool::new(false) })
    }

    /// Draws a picture of splats in this order, or in their own one. It has [`VALUES`] planes.
    ///
    /// # Errors
    /// [`EngineError`] if the splats or the picture do not fit the device or the camera, memory runs out, or the device
    /// is lost.
    pub fn picture(
        &self,
        splats: &dyn StoredSplats,
        order: &[u32],
        camera: &Args,
        picture: &mut [f32],
    ) -> Result<(), EngineError> {
        let mut drawing = self.drawing.lock().unwrap_or_else(PoisonError::into_inner);
        let Drawing { splats: room, picture: block, gpu } = &mut *drawing;
        let stride = camera.height * camera.width;
        if picture.len() != VALUES * stride as usize {
            return Err(EngineError::mismatch("the picture does not have the size of the camera's"));
        }
        room.store(gpu, splats, order)?;
        let size = size_of_val(picture) as u64;
        let to = &*make_room(gpu, block, size, "a picture of splats")?;
        gpu.recorder.begin(0)?;
        gpu.recorder.barrier();
        room.record(gpu, &[*camera], &Pictures { to: to.all(), next: 0, stride, light: false })?;
        gpu.recorder.submit("draw_splats")?;
        gpu.fetch(to, bytemuck::cast_slice_mut(picture), [(0, 0, size)])
    }
}

impl SplatDrawer for VulkanSplats {
    fn draw(&self, splats: &dyn StoredSplats, camera: &Args, picture: &mut [f32]) -> bool {
        let Err(error) = self.picture(splats, &[], camera, picture) else { return true };
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
