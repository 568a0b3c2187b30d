//! Writes YUV4MPEG2, a plain video format that most tools read.
//!
//! The file is one line of words, followed by frames of bytes. The colors are Y'CbCr of ITU-R BT.601 in limited range,
//! because programs assume this for a Y4M without a stated matrix. There is one sample of each component per pixel
//! (4:4:4), so that grain keeps its color.

use super::picture::Canvas;
use std::io::{self, Write};

/// Writes the first line, for frames of (rows, columns) at `rate`, as a number of frames in a number of seconds.
pub fn head(out: &mut dyn Write, [rows, columns]: [usize; 2], [frames, seconds]: [u64; 2]) -> io::Result<()> {
    writeln!(
        out,
        "YUV4MPEG2 W{columns} H{rows} F{frames}:{seconds} Ip A1:1 C444 XCOLORRANGE=LIMITED XCOLORMATRIX=BT601"
    )
}

/// Writes one frame with its marker.
pub fn frame(out: &mut dyn Write, canvas: &Canvas) -> io::Result<()> {
    out.write_all(b"FRAME\n")?;
    for plane in planes(&canvas.rgb) {
        out.write_all(&plane)?;
    }
    Ok(())
}

/// Returns the luma and both color differences of encoded red, green and blue.
fn planes(rgb: &[u8]) -> [Vec<u8>; 3] {
    let mut planes = [const { Vec::new() }; 3];
    for pixel in rgb.chunks_exact(3) {
        let [r, g, b] = [0, 1, 2].map(|i| f32::from(pixel[i]) / 255.0);
        let y = 0.299 * r + 0.587 * g + 0.114 * b;
        let values = [16.0 + 219.0 * y, 128.0 + 224.0 * (b - y) / 1.772, 128.0 + 224.0 * (r - y) / 1.402];
        planes.iter_mut().zip(values).for_each(|(plane, v)| plane.push(v.round() as u8));
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_of_the_standard() {
        // The bars of ITU-R BT.601 at full amplitude are white, black, red, green and blue.
        let rgb = [255, 255, 255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 255];
        let expected = [[235, 16, 81, 145, 41], [128, 128, 90, 54, 240], [128, 128, 240, 34, 110]];
        assert_eq!(planes(&rgb), expected.map(Vec::from));
    }
}
