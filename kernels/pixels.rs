//! Unpacks a video frame into four bytes per pixel, which are red, green and blue (or reversed), then 255.

use bytemuck::{Pod, Zeroable};

/// Sizes of the frame, and the order of the colors.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the frame.
    pub height: u32,
    /// Columns of the frame.
    pub width: u32,
    /// Bytes from one row of the frame to the next. The shader requires a multiple of 4.
    pub row: u32,
    /// Bytes per pixel of the frame, 1 (gray) or 3.
    pub channels: u32,
    /// If not 0, blue comes first.
    pub blue_first: u32,
}

/// Fills `pixels`, which has four bytes for each of `height * width` pixels.
pub fn pixels(args: &Args, frame: &[u8], pixels: &mut [u8]) {
    let (width, channels) = (args.width.max(1) as usize, args.channels as usize);
    let rows = frame.chunks(args.row.max(1) as usize).take(args.height as usize);
    for (to, from) in pixels.chunks_exact_mut(4 * width).zip(rows) {
        for (to, from) in to.chunks_exact_mut(4).zip(from.chunks_exact(channels.max(1))) {
            let [r, g, b] = if channels == 1 { [from[0]; 3] } else { [from[0], from[1], from[2]] };
            to.copy_from_slice(&if args.blue_first != 0 { [b, g, r, 255] } else { [r, g, b, 255] });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_and_colours_in_either_order() {
        let args = Args { height: 2, width: 2, row: 8, channels: 3, blue_first: 0 };
        let frame = [1, 2, 3, 4, 5, 6, 99, 99, 7, 8, 9, 10, 11, 12, 99, 99];
        let mut out = [0; 16];
        pixels(&args, &frame, &mut out);
        assert_eq!(out, [1, 2, 3, 255, 4, 5, 6, 255, 7, 8, 9, 255, 10, 11, 12, 255]);
        pixels(&Args { blue_first: 1, ..args }, &frame, &mut out);
        assert_eq!(out[..8], [3, 2, 1, 255, 6, 5, 4, 255]);
        pixels(&Args { channels: 1, row: 4, ..args }, &[1, 2, 9, 9, 3, 4, 9, 9], &mut out);
        assert_eq!(out, [1, 1, 1, 255, 2, 2, 2, 255, 3, 3, 3, 255, 4, 4, 4, 255]);
    }
}
