//! Copies parts of the images of a swapchain.

use super::buffer::{Buffer, Captured, Room};
use super::device::Device;
use super::part::Part;
use ash::vk::{self, Handle};
use std::sync::Arc;
use std::time::Duration;

/// The copies that exist at once. The newest one, the one that waits, the one that is being composed and the next one
/// are four. The others are for devices that are several frames behind.
const BUFFERS: usize = 8;
/// The alignment of the parts in a buffer, which is a multiple of the texels of every format.
const ALIGNMENT: u64 = 16;

/// An image that the application releases.
#[derive(Debug, Clone, Copy)]
pub struct Source {
    /// The handle of the image.
    pub image: u64,
    /// True for a depth, and whether it has a stencil.
    pub is_depth: bool,
    pub has_stencil: bool,
    /// Bytes of a texel in a copy.
    pub texel: usize,
}

/// Copies images of one swapchain.
pub struct Copier {
    device: Arc<Device>,
    buffers: Vec<Arc<Buffer>>,
    /// True if the device has no memory left for copies. They are in memory of the host then.
    is_full: bool,
}

impl Copier {
    /// Makes a copier without buffers.
    pub fn new(device: &Arc<Device>) -> Self {
        Self { device: device.clone(), buffers: Vec::new(), is_full: false }
    }

    /// Submits a copy of these parts, and does not wait for it. Returns none if all buffers are in use.
    ///
    /// # Errors
    /// Returns the error of Vulkan.
    pub fn copy(&mut self, source: &Source, parts: &[Part], room: Room) -> Result<Option<Captured>, vk::Result> {
        let mut offset = 0;
        let mut placed = Vec::with_capacity(parts.len());
        for part in parts {
            placed.push((*part, offset));
            let bytes = u64::from(part.width) * u64::from(part.height) * source.texel as u64;
            offset = (offset + bytes).next_multiple_of(ALIGNMENT);
        }
        let Some(buffer) = self.free(offset.max(ALIGNMENT), room)? else { return Ok(None) };
        let captured = Captured { buffer, parts: placed };
        self.record(source, &captured)?;
        let (raw, fence) = (&self.device.raw, captured.buffer.fence);
        let commands = [captured.buffer.commands];
        let submit = [vk::SubmitInfo::default().command_buffers(&commands)];
        // SAFETY: no copy of this buffer is in progress, so nothing waits for the fence.
        unsafe { raw.reset_fences(&[fence]) }?;
        // SAFETY: the commands are recorded, and the application keeps its other threads from the queue during this
        // call (see the page of the module).
        let submitted = unsafe { raw.queue_submit(self.device.queue, &submit, fence) };
        if submitted.is_err() {
            // The fence would never be signaled.
            self.buffers.retain(|kept| !Arc::ptr_eq(kept, &captured.buffer));
        }
        submitted.map(|()| Some(captured))
    }

    /// Waits for all copies, so that the images may be destroyed.
    pub fn finish(&self, patience: Duration) {
        for buffer in &self.buffers {
            buffer.wait(patience);
        }
    }

    /// Returns a buffer of at least this many bytes that nothing uses.
    fn free(&mut self, bytes: u64, room: Room) -> Result<Option<Arc<Buffer>>, vk::Result> {
        let room = if self.is_full { Room::Host } else { room };
        let is_free = |buffer: &Arc<Buffer>| Arc::strong_count(buffer) == 1 && buffer.is_done();
        // Buffers of another size were for images of which another part was in use. Those in other memory were for
        // another display.
        let fits = |buffer: &Arc<Buffer>| buffer.room == room && buffer.bytes >= bytes && buffer.bytes / 2 <= bytes;
        self.buffers.retain(|buffer| fits(buffer) || !is_free(buffer));
        if let Some(buffer) = self.buffers.iter().find(|buffer| fits(buffer) && is_free(buffer)) {
            return Ok(Some(buffer.clone()));
        }
        if self.buffers.len() >= BUFFERS {
            return Ok(None);
        }
        let buffer = Buffer::new(&self.device, bytes, room).or_else(|error| {
            self.is_full = room == Room::Device;
            if self.is_full { Buffer::new(&self.device, bytes, Room::Host) } else { Err(error) }
        })?;
        let buffer = Arc::new(buffer);
        self.buffers.push(buffer.clone());
        Ok(Some(buffer))
    }

    /// Records the copy between two changes of the image's layout. A released image has the layout of an attachment.
    fn record(&self, source: &Source, captured: &Captured) -> Result<(), vk::Result> {
        let (raw, buffer) = (&self.device.raw, &captured.buffer);
        let commands = buffer.commands;
        buffer.reset()?;
        let (layout, copied) = match source.is_depth {
            true => (vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL, vk::ImageAspectFlags::DEPTH),
            false => (vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL, vk::ImageAspectFlags::COLOR),
        };
        let aspect = if source.has_stencil { copied | vk::ImageAspectFlags::STENCIL } else { copied };
        let image = vk::Image::from_raw(source.image);
        let whole = vk::ImageSubresourceRange::default()
            .aspect_mask(aspect)
            .level_count(1)
            .layer_count(vk::REMAINING_ARRAY_LAYERS);
        let reading = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        let change = |from: (vk::ImageLayout, vk::AccessFlags), to: (vk::ImageLayout, vk::AccessFlags)| {
            vk::ImageMemoryBarrier::default()
                .old_layout(from.0)
                .new_layout(to.0)
                .src_access_mask(from.1)
                .dst_access_mask(to.1)
                .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .image(image)
                .subresource_range(whole)
        };
        let any = vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE;
        let before = change((layout, vk::AccessFlags::MEMORY_WRITE), (reading, vk::AccessFlags::TRANSFER_READ));
        let after = change((reading, vk::AccessFlags::TRANSFER_READ), (layout, any));
        // The next copy discards the contents, so that it does not take the buffer back.
        let (stage, access, families) = match buffer.room {
            Room::Host => {
                let ignored = [vk::QUEUE_FAMILY_IGNORED; 2];
                (vk::PipelineStageFlags::HOST, vk::AccessFlags::HOST_READ, ignored)
            }
            Room::Device => {
                let families = [self.device.family, vk::QUEUE_FAMILY_EXTERNAL];
                (vk::PipelineStageFlags::ALL_COMMANDS, vk::AccessFlags::empty(), families)
            }
        };
        let handed_on = vk::BufferMemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
            .dst_access_mask(access)
            .src_queue_family_index(families[0])
            .dst_queue_family_index(families[1])
            .buffer(buffer.raw)
            .size(vk::WHOLE_SIZE);
        let region = |(part, offset): &(Part, u64)| {
            let of =
                vk::ImageSubresourceLayers::default().aspect_mask(copied).base_array_layer(part.layer).layer_count(1);
            vk::BufferImageCopy::default()
                .buffer_offset(*offset)
                .image_subresource(of)
                .image_offset(vk::Offset3D { x: part.x as i32, y: part.y as i32, z: 0 })
                .image_extent(vk::Extent3D { width: part.width, height: part.height, depth: 1 })
        };
        let regions: Vec<_> = captured.parts.iter().map(region).collect();
        let (all, transfer) = (vk::PipelineStageFlags::ALL_COMMANDS, vk::PipelineStageFlags::TRANSFER);
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let none = vk::DependencyFlags::empty();
        // SAFETY: the commands are not in use. The image belongs to the application's queue until the release is passed
        // on, has the layout of an attachment then (OpenXR requires it), and may be copied (the layer adds the usage).
        // The parts are inside the image, and the buffer holds them.
        unsafe {
            raw.begin_command_buffer(commands, &once)?;
            raw.cmd_pipeline_barrier(commands, all, transfer, none, &[], &[], &[before]);
            raw.cmd_copy_image_to_buffer(commands, image, reading, buffer.raw, &regions);
            raw.cmd_pipeline_barrier(commands, transfer, all, none, &[], &[], &[after]);
            raw.cmd_pipeline_barrier(commands, transfer, stage, none, &[], &[handed_on], &[]);
            raw.end_command_buffer(commands)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_contain_and_surround_each_other() {
        let part = |layer, [x, y, width, height]: [u32; 4]| Part { layer, x, y, width, height };
        let left = part(0, [0, 0, 8, 4]);
        assert!(left.contains(&part(0, [2, 1, 6, 3])) && left.contains(&left));
        assert!(!left.contains(&part(0, [2, 1, 7, 3])) && !left.contains(&part(1, [2, 1, 6, 3])));
        assert!(!part(0, [1, 0, 4, 4]).contains(&part(0, [0, 0, 2, 2])));
        assert!(!left.contains(&part(0, [u32::MAX, 0, u32::MAX, 1])));
        assert_eq!(left.around(&part(0, [10, 2, 2, 6])), part(0, [0, 0, 12, 8]));
    }
}
