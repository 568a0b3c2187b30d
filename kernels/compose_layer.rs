//! Blends one layer of an OpenXR frame over the picture of an eye on a device. A layer is a view of the application, a
//! quad or a cylinder. The layers of a frame follow each other, from the back to the front.
//!
//! The CPU twin is `composition` of `tools/openxr`, which has the same order of arithmetic. The twin computes rays in
//! float64, so that places in an image may differ by some 1e-6 of its width.
//!
//! The values of a layer are words of a record in the buffer of tables. They are whole numbers or float32.

use bytemuck::{Pod, Zeroable};

/// Size of the picture, and place of the layer's record.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the picture.
    pub height: u32,
    /// Columns of the picture.
    pub width: u32,
    /// First word of the record.
    pub record: u32,
    /// Angle between neighboring pixels of the picture, as a tangent.
    pub angle: f32,
}

/// The layer is a view, whose samples for each column and row of the picture are in tables.
pub const VIEW: u32 = 0;
/// The layer is a rectangle that is seen from its front.
pub const QUAD: u32 = 1;
/// The layer is a part of a cylinder that is seen from its inside.
pub const CYLINDER: u32 = 2;

/// Colors have 8 bits each, in the order red, green, blue, opacity.
pub const RGBA8: u32 = 1;
/// Colors have 8 bits each, in the order blue, green, red, opacity.
pub const BGRA8: u32 = 2;
/// Colors have 10 bits each with red in the lowest bits, and opacity has 2 bits.
pub const RGB10A2: u32 = 3;
/// Colors and opacity are floats of 16 bits.
pub const RGBA16: u32 = 4;
/// Depth has 16 bits.
pub const D16: u32 = 5;
/// Depth is in the lowest 24 bits of a word.
pub const D24: u32 = 6;
/// Depth is a float of 32 bits.
pub const D32: u32 = 7;

/// The opacity of texels counts.
pub const BLENDS: u32 = 1;
/// Colors are not multiplied by the opacity.
pub const UNPREMULTIPLIED: u32 = 2;
/// Texels have transparency instead of opacity.
pub const INVERTED: u32 = 4;
/// Colors of 8 bits follow the sRGB curve.
pub const SRGB: u32 = 8;

/// Word of the record with [`VIEW`], [`QUAD`] or [`CYLINDER`].
pub const KIND: usize = 0;
/// Word of the record with the flags of opacity and of the curve.
pub const FLAGS: usize = 1;
/// Words of the record with format, first byte, bytes from row to row, rows and columns of the color.
pub const COLOR: usize = 2;
/// Words of the record with format (0 without depth), first byte and bytes from row to row of the depth.
pub const DEPTH: usize = 7;
/// Words of the record with the depths of the near and the far distance, and the dioptres of both.
pub const RANGE: usize = 10;
/// Word of the record with the dioptres of a view without depth.
pub const DIOPTRES: usize = 14;
/// Words of the record with the first words of the tables of columns and rows of the color, and of the depth.
pub const TABLES: usize = 15;
/// Words of the record with a quad or a cylinder.
///
/// A quad has its normal, its right and its up direction, divided by width and height. Each is followed by its product
/// with the center. A cylinder has the rotation from the eye (row by row), the eye's place, radius, central angle and
/// height in radii. A radius of 0 means infinity.
pub const SURFACE: usize = 19;
/// Number of words of a record.
pub const RECORD: usize = 34;

/// Words of a table of color per pixel, with the first sample, the number of samples, and the first word of their
/// weights.
pub const TAP: usize = 3;
/// The sample in a table of depth for a pixel outside the view.
pub const OUTSIDE: u32 = u32::MAX;
/// The opacity from which a layer decides the distance of a pixel.
pub const SOLID: f32 = 0.5;
/// The largest dioptres of content.
pub const NEAREST: f32 = 100.0;
/// Number of values of the sRGB curve, which are the first words of the buffer of tables.
pub const CURVE: usize = 256;

/// The coefficients of the arc tangent of x = -tan(pi/8)..tan(pi/8), from x^3 to x^9 (Cephes).
pub const ATAN: [f32; 4] = [-0.333_329_5, 0.199_777_11, -0.138_776_86, 0.080_537_45];
/// The tangents of pi/8 and 3 pi/8, between which the arc tangent is reduced.
pub const ATAN_EDGES: [f32; 2] = [0.414_213_57, 2.414_213_7];

#[cfg(test)]
mod tests {
    use super::*;

    /// The shader has the same steps.
    #[test]
    fn the_arc_tangent_is_exact_to_rounding() {
        for i in 0..=100_000 {
            let x = i as f32 / 1000.0;
            let [low, high] = ATAN_EDGES;
            let (base, t) = match x {
                x if x > high => (std::f32::consts::FRAC_PI_2, -1.0 / x),
                x if x > low => (std::f32::consts::FRAC_PI_4, (x - 1.0) / (x + 1.0)),
                x => (0.0, x),
            };
            let s = t * t;
            let found = base + (t + t * s * (ATAN[0] + s * (ATAN[1] + s * (ATAN[2] + s * ATAN[3]))));
            assert!((f64::from(found) - f64::from(x).atan()).abs() < 2e-7, "{x}: {found}");
        }
    }
}
