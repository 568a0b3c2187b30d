//! Copies pictures into an image of a swapchain.
//!
//! A picture goes into a buffer first, with four bytes per pixel, then a copy command moves it to the image.

#![allow(unsafe_code)]

use ash::vk;

/// Writes a picture of `size` rows and columns and 1 or 3 channels into the pixels of an image of this extent. Pixels
/// of the image outside the picture become black. Pixels of the picture outside the image are left out.
pub(super) fn fill(
    pixels: &mut [u8],
    extent: vk::Extent2D,
    blue_first: bool,
    picture: &[u8],
    [rows, columns]: [usize; 2],
    channels: usize,
) {
    let (height, width) = (extent.height as usize, extent.width as usize);
    let [first, last] = if blue_first { [2, 0] } else { [0, 2] };
    let black: &[u8] = &[];
    let lines = picture.chunks_exact(channels * columns.max(1)).take(rows).chain(std::iter::repeat(black));
    for (to, from) in pixels[..4 * height * width].chunks_exact_mut(4 * width).zip(lines) {
        let (shown, beside) = to.split_at_mut(4 * width.min(from.len() / channels));
        if channels == 1 {
            shown.chunks_exact_mut(4).zip(from).for_each(|(to, g)| to.copy_from_slice(&[*g, *g, *g, 255]));
        } else {
            let pairs = shown.chunks_exact_mut(4).zip(from.chunks_exact(3));
            pairs.for_each(|(to, rgb)| to.copy_from_slice(&[rgb[first], rgb[1], rgb[last], 255]));
        }
        beside.chunks_exact_mut(4).for_each(|to| to.copy_from_slice(&[0, 0, 0, 255]));
    }
}

/// Records the copy of a picture into an acquired image, and the layout change for presentation.
///
/// # Safety
/// The commands are being recorded. They, the buffer and the image of this extent belong to this device and outlive the
/// submission. The buffer has four bytes for each pixel of the extent from the offset on. The submission waits for the
/// image at the stage of transfers, because the change of layout comes after that.
pub(super) unsafe fn record_copy(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    (from, offset): (vk::Buffer, u64),
    image: vk::Image,
    vk::Extent2D { width, height }: vk::Extent2D,
) {
    let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
    let range =
        vk::ImageSubresourceRange::default().aspect_mask(vk::ImageAspectFlags::COLOR).level_count(1).layer_count(1);
    let barrier = vk::ImageMemoryBarrier::default()
        .image(image)
        .subresource_range(range)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED);
    let written = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
    let into = barrier
        .old_layout(vk::ImageLayout::UNDEFINED)
        .new_layout(written)
        .dst_access_mask(vk::AccessFlags::TRANSFER_WRITE);
    let out = barrier
        .old_layout(written)
        .new_layout(vk::ImageLayout::PRESENT_SRC_KHR)
        .src_access_mask(vk::AccessFlags::TRANSFER_WRITE);
    let extent = vk::Extent3D { width, height, depth: 1 };
    let copy = vk::BufferImageCopy::default().buffer_offset(offset).image_subresource(layers).image_extent(extent);
    let (transfer, bottom) = (vk::PipelineStageFlags::TRANSFER, vk::PipelineStageFlags::BOTTOM_OF_PIPE);
    let none = vk::DependencyFlags::empty();
    // SAFETY: the caller guarantees this.
    unsafe {
        device.cmd_pipeline_barrier(commands, transfer, transfer, none, &[], &[], &[into]);
        device.cmd_copy_buffer_to_image(commands, from, image, written, &[copy]);
        device.cmd_pipeline_barrier(commands, transfer, bottom, none, &[], &[], &[out]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_cut_or_framed_in_black_in_either_order_of_colours() {
        let extent = vk::Extent2D { width: 2, height: 2 };
        let mut pixels = [9; 16];
        fill(&mut pixels, extent, true, &[1, 2, 3], [1, 1], 3);
        assert_eq!(pixels, [3, 2, 1, 255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 255]);
        fill(&mut pixels, extent, false, &[1, 2, 3, 4, 5, 6, 7, 8, 9], [3, 3], 1);
        assert_eq!(pixels, [1, 1, 1, 255, 2, 2, 2, 255, 4, 4, 4, 255, 5, 5, 5, 255]);
    }
}
