//! Unpacks a video frame into four bytes per pixel, which are red, green and blue (or reversed), then 255.

use bytemuck::{Pod, Zeroable};

/// Sizes of the picture and of the frame in it, and the order of the colors.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the picture.
    pub height: u32,
    /// Columns of the picture.
    pub width: u32,
    /// Bytes from one row of the frame to the next. The shader requires a multiple of 4.
    pub row: u32,
    /// Bytes per pixel of the frame, 1 (gray) or 3.
    pub channels: u32,
    /// If not 0, blue comes first.
    pub blue_first: u32,
    /// Row of the picture at which the frame begins.
    pub top: u32,
    /// Column of the picture at which the frame begins.
    pub left: u32,
    /// Rows of the frame.
    pub rows: u32,
    /// Columns of the frame.
    pub columns: u32,
    /// Value of each channel around the frame.
    pub fill: u32,
}

/// Fills `pixels`, which has four bytes for each of `height * width` pixels.
pub fn pixels(args: &Args, frame: &[u8], pixels: &mut [u8]) {
    let (width, channels) = (args.width.max(1) as usize, args.channels.max(1) as usize);
    let fill = [args.fill as u8; 3];
    for (y, to) in (0..args.height).zip(pixels.chunks_exact_mut(4 * width)) {
        // Before the frame, the difference wraps to a number beyond it.
        let row = y.wrapping_sub(args.top);
        for (x, to) in (0..args.width).zip(to.chunks_exact_mut(4)) {
            let column = x.wrapping_sub(args.left);
            let [r, g, b] = if row < args.rows && column < args.columns {
                let from = &frame[row as usize * args.row as usize + column as usize * channels..][..channels];
                if channels == 1 { [from[0]; 3] } else { [from[0], from[1], from[2]] }
            } else {
                fill
            };
            to.copy_from_slice(&if args.blue_first != 0 { [b, g, r, 255] } else { [r, g, b, 255] });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_and_colours_in_either_order() {
        let sides = Args { top: 0, left: 0, rows: 2, columns: 2, fill: 0, ..Args::zeroed() };
        let args = Args { height: 2, width: 2, row: 8, channels: 3, blue_first: 0, ..sides };
        let frame = [1, 2, 3, 4, 5, 6, 99, 99, 7, 8, 9, 10, 11, 12, 99, 99];
        let mut out = [0; 16];
        pixels(&args, &frame, &mut out);
        assert_eq!(out, [1, 2, 3, 255, 4, 5, 6, 255, 7, 8, 9, 255, 10, 11, 12, 255]);
        pixels(&Args { blue_first: 1, ..args }, &frame, &mut out);
        assert_eq!(out[..8], [3, 2, 1, 255, 6, 5, 4, 255]);
        pixels(&Args { channels: 1, row: 4, ..args }, &[1, 2, 9, 9, 3, 4, 9, 9], &mut out);
        assert_eq!(out, [1, 1, 1, 255, 2, 2, 2, 255, 3, 3, 3, 255, 4, 4, 4, 255]);
    }

    #[test]
    fn a_frame_in_a_larger_picture_is_surrounded() {
        let inside = Args { top: 1, left: 2, rows: 1, columns: 2, fill: 9, ..Args::zeroed() };
        let args = Args { height: 3, width: 4, row: 4, channels: 1, blue_first: 0, ..inside };
        let mut out = [0; 48];
        pixels(&args, &[1, 2, 77, 77], &mut out);
        let reds: Vec<u8> = out.chunks(4).map(|pixel| pixel[0]).collect();
        assert_eq!(reds, [9, 9, 9, 9, 9, 9, 1, 2, 9, 9, 9, 9]);
        assert!(out.chunks(4).all(|pixel| pixel[3] == 255 && pixel[1] == pixel[0] && pixel[2] == pixel[0]));
    }
}
