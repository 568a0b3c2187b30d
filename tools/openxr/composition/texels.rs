//! Reads the texels of swapchains as linear light, and their depths as dioptres.

use half::f16;
use std::sync::LazyLock;

/// The formats of swapchain images that the layer reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// 8 bits each, in the order red, green, blue, opacity. `srgb` is true for the sRGB curve.
    Rgba8 { srgb: bool },
    /// 8 bits each, in the order blue, green, red, opacity.
    Bgra8 { srgb: bool },
    /// Three linear values of 10 bits with red in the lowest bits, and an opacity of 2 bits.
    Rgb10A2,
    /// Four floats of 16 bits.
    Rgba16Float,
    /// Depth of 16 bits.
    D16,
    /// Depth in the lowest 24 bits of a word.
    D24,
    /// Depth as a float of 32 bits.
    D32,
}

impl Format {
    /// Returns the bytes of a texel in a copy.
    pub fn bytes(self) -> usize {
        match self {
            Self::D16 => 2,
            Self::Rgba16Float => 8,
            _ => 4,
        }
    }

    /// Returns true for a depth.
    pub fn is_depth(self) -> bool {
        matches!(self, Self::D16 | Self::D24 | Self::D32)
    }
}

/// The brightest light, which is the largest finite half and the limit of live input.
pub const BRIGHTEST: f32 = 65_504.0;

/// The light of the 256 values of the sRGB curve.
static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let v = i as f64 / 255.0;
        (if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }) as f32
    })
});

/// Returns the light of the 256 values of the sRGB curve.
pub fn srgb_curve() -> &'static [f32; 256] {
    &SRGB
}

/// Reads the texels of a row of color into linear red, green, blue and opacity.
pub fn read_colors(format: Format, raw: &[u8], out: &mut [[f32; 4]]) {
    let full = |v: u8| f32::from(v) / 255.0;
    let curve = |srgb: bool, v: u8| if srgb { SRGB[usize::from(v)] } else { full(v) };
    let words = raw.as_chunks::<4>().0;
    match format {
        Format::Rgba8 { srgb } => {
            for (to, [r, g, b, a]) in out.iter_mut().zip(words) {
                *to = [curve(srgb, *r), curve(srgb, *g), curve(srgb, *b), full(*a)];
            }
        }
        Format::Bgra8 { srgb } => {
            for (to, [b, g, r, a]) in out.iter_mut().zip(words) {
                *to = [curve(srgb, *r), curve(srgb, *g), curve(srgb, *b), full(*a)];
            }
        }
        Format::Rgb10A2 => {
            for (to, word) in out.iter_mut().zip(words) {
                let word = u32::from_le_bytes(*word);
                let ten = |shift: u32| (word >> shift & 1023) as f32 / 1023.0;
                *to = [ten(0), ten(10), ten(20), (word >> 30) as f32 / 3.0];
            }
        }
        Format::Rgba16Float => {
            for (to, texel) in out.iter_mut().zip(raw.as_chunks::<8>().0) {
                let one = |i: usize| f16::from_le_bytes([texel[2 * i], texel[2 * i + 1]]).to_f32();
                // Light is neither negative nor unlimited. A NaN becomes 0.
                let light = |v: f32| if v > 0.0 { v.min(BRIGHTEST) } else { 0.0 };
                *to = [light(one(0)), light(one(1)), light(one(2)), light(one(3)).min(1.0)];
            }
        }
        Format::D16 | Format::D24 | Format::D32 => out.fill([0.0; 4]),
    }
}

/// Reads one depth from 0 to 1, or none outside of the row.
pub fn read_depth(format: Format, row: &[u8], column: usize) -> Option<f32> {
    let at = column * format.bytes();
    let raw = row.get(at..at + format.bytes())?;
    match (format, raw) {
        (Format::D16, &[a, b]) => Some(f32::from(u16::from_le_bytes([a, b])) / 65_535.0),
        (Format::D24, &[a, b, c, _]) => {
            Some((f64::from(u32::from_le_bytes([a, b, c, 0])) / f64::from(0x00ff_ffff_u32)) as f32)
        }
        (Format::D32, &[a, b, c, d]) => Some(f32::from_le_bytes([a, b, c, d])),
        _ => None,
    }
}

/// The distances that the depths of a view mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthRange {
    /// The depths of the near and the far distance.
    pub depths: [f32; 2],
    /// The distances in m. The first one is larger for reversed depth. Either may be infinite.
    pub distances: [f32; 2],
}

impl DepthRange {
    /// Returns true if the values state a distance for each depth.
    pub fn is_valid(&self) -> bool {
        let [least, most] = self.depths;
        let [near, far] = self.distances;
        least < most && near > 0.0 && far > 0.0 && (near - far).abs() > 0.0
    }

    /// Returns the depths of the near and the far distance and the dioptres of both, as a device computes with them.
    pub fn words(&self) -> [f32; 4] {
        let [least, most] = self.depths;
        // A device may compute with infinity in any way. The dioptres of a depth are limited to 100 below.
        let [near, far] = self.distances.map(|m| (1.0 / f64::from(m)).min(1e30) as f32);
        [least, most, near, far]
    }

    /// Returns the dioptres of a depth, from 0 to 100, the limit of live input.
    pub fn dioptres(&self, depth: f32) -> f32 {
        let [least, most] = self.depths.map(f64::from);
        // The projection is linear in the inverse of the distance, and the inverse of infinity is 0.
        let [near, far] = self.distances.map(|m| 1.0 / f64::from(m));
        let t = ((f64::from(depth) - least) / (most - least)).clamp(0.0, 1.0);
        let dioptres = near + t * (far - near);
        if dioptres.is_finite() { dioptres.clamp(0.0, 100.0) as f32 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The depth that a projection with these distances gives at `z`.
    fn projected([near, far]: [f64; 2], z: f64) -> f32 {
        let [near, far] = [1.0 / near, 1.0 / far];
        ((1.0 / z - near) / (far - near)) as f32
    }

    #[test]
    fn depths_are_distances_for_each_kind_of_projection() {
        let forms = [[0.1, 100.0], [100.0, 0.1], [0.1, f64::INFINITY], [f64::INFINITY, 0.1]];
        for distances in forms {
            let range = DepthRange { depths: [0.0, 1.0], distances: distances.map(|v| v as f32) };
            assert!(range.is_valid());
            for z in [0.1, 0.25, 1.0, 7.0, 90.0] {
                let found = f64::from(range.dioptres(projected(distances, z)));
                assert!((found - 1.0 / z).abs() < 10.0 / 65_535.0, "{distances:?} at {z} m: {found} D");
            }
        }
        // A part of the depths, as for a viewport in front of others.
        let part = DepthRange { depths: [0.5, 1.0], distances: [0.5, 2.0] };
        assert_eq!([0.0, 0.5, 0.75, 1.0].map(|d| part.dioptres(d)), [2.0, 2.0, 1.25, 0.5]);
        assert!(part.dioptres(f32::NAN) == 0.0);
        let wrong = [[0.0, 1.0], [1.0, 1.0], [f32::NAN, 1.0], [-1.0, 3.0]];
        assert!(wrong.iter().all(|d| !DepthRange { depths: [0.0, 1.0], distances: *d }.is_valid()));
    }

    #[test]
    fn texels_are_linear_light() {
        let read = |format, raw: &[u8]| {
            let mut out = [[9.0; 4]];
            read_colors(format, raw, &mut out);
            out[0]
        };
        let gray = ((128.0f64 / 255.0 + 0.055) / 1.055).powf(2.4) as f32;
        assert_eq!(read(Format::Rgba8 { srgb: true }, &[255, 128, 0, 128]), [1.0, gray, 0.0, 128.0 / 255.0]);
        assert_eq!(read(Format::Bgra8 { srgb: false }, &[255, 51, 0, 255]), [0.0, 0.2, 1.0, 1.0]);
        let ten = (1023u32 | 341 << 20 | 1 << 30).to_le_bytes();
        assert_eq!(read(Format::Rgb10A2, &ten), [1.0, 0.0, 341.0 / 1023.0, 1.0 / 3.0]);
        let halves = [2.0f32, -1.0, f32::NAN, 3.0].map(|v| f16::from_f32(v).to_le_bytes()).concat();
        assert_eq!(read(Format::Rgba16Float, &halves), [2.0, 0.0, 0.0, 1.0]);
        assert_eq!(read_depth(Format::D16, &[0, 0, 255, 255], 1), Some(1.0));
        // The highest 8 bits of a word of 24 bits hold anything.
        assert_eq!(read_depth(Format::D24, &[255, 255, 255, 7], 0), Some(1.0));
        assert_eq!(read_depth(Format::D32, &0.25f32.to_le_bytes(), 0), Some(0.25));
        assert_eq!(read_depth(Format::D32, &[0; 4], 1), None);
    }
}
