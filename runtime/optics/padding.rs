//! Computes how far light walks sideways, and the padding that keeps it from wrapping around.

use super::{Geometry, Optics, fast_size};

/// Zero pixels to add around the SLM along each axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Padding {
    /// Added rows, half above and half below.
    pub rows: usize,
    /// Added columns, half left and half right.
    pub columns: usize,
}

/// Sideways movement in meters of light inside a pupil at distance `offset` from the axis, `|z| (|s| + d/2) / f`
/// (OPTICS 2). The caller gives `reach = |s| + d/2`.
pub fn walk_off(optics: &Optics, depth: f64, reach: f64) -> f64 {
    depth.abs() * reach.abs() / optics.focal_length
}

/// Sizes with prime factors up to this one transform fast. Shorter sides transform fast in any case.
const LARGEST_PRIME: usize = 13;
const SHORT: usize = 256;

fn is_slow(n: usize) -> bool {
    n >= SHORT && largest_prime(n) > LARGEST_PRIME
}

/// The sides that [`Padding::smooth`] pads, with the reason, in words.
pub fn slow_sides(optics: &Optics) -> String {
    let sides = [(optics.height, "rows"), (optics.width, "columns")].into_iter().filter(|(n, _)| is_slow(*n));
    let why = |(n, side): (usize, &str)| format!("{n} {side}, with the prime factor {}", largest_prime(n));
    format!("{} would transform slowly", sides.map(why).collect::<Vec<_>>().join(" and "))
}

/// The largest prime factor of a number. 1 has none.
fn largest_prime(mut n: usize) -> usize {
    let (mut largest, mut p) = (1, 2);
    while p * p <= n {
        if n.is_multiple_of(p) {
            (largest, n) = (p, n / p);
        } else {
            p += 1;
        }
    }
    largest.max(n)
}

impl Padding {
    /// The padding that circular propagation needs to keep light from wrapping into the picture, up to the next grid
    /// size that transforms fast. It is none in the far field. There the field of view wraps, because the pixels of the
    /// SLM make it wrap. `depth` is the largest |z| and `reach` the largest |s| + d/2, both in meters.
    pub fn required(optics: &Optics, depth: f64, reach: f64) -> Self {
        if optics.geometry == Geometry::FarField {
            return Self::default();
        }
        let pixels = (walk_off(optics, depth, reach) / optics.pitch).ceil() as usize;
        let grow = |n: usize| if pixels == 0 { 0 } else { fast_size(n + pixels) - n };
        Self { rows: grow(optics.height), columns: grow(optics.width) }
    }

    /// The padding without which a side transforms slowly. It grows a long side with a large prime factor, such as 1358
    /// = 2 x 7 x 97, to the next size that transforms fast. It is none in the far field.
    pub fn smooth(optics: &Optics) -> Self {
        if optics.geometry == Geometry::FarField {
            return Self::default();
        }
        let grow = |n: usize| if is_slow(n) { fast_size(n) - n } else { 0 };
        Self { rows: grow(optics.height), columns: grow(optics.width) }
    }

    /// The grid with this padding. It has the pixels of the mask if the SLM has one.
    pub fn grid(&self, optics: Optics) -> Optics {
        optics.with_size(optics.height + self.rows, optics.width + self.columns).at_mask()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_depth_needs_no_padding_and_depth_needs_the_walk_off() {
        let optics = Optics::new(512, 300, 8e-6, 520e-9, 0.4).unwrap();
        assert_eq!(Padding::required(&optics, 0.0, 20e-3), Padding::default());
        // 3.5 mm * 21 mm / 400 mm = 0.18375 mm = 22.97 pixels.
        let padding = Padding::required(&optics, -3.5e-3, 21e-3);
        assert_eq!(padding.rows, fast_size(512 + 23) - 512);
        assert_eq!(padding.columns, fast_size(300 + 23) - 300);
    }

    #[test]
    fn large_prime_factors_are_padded_away() {
        let smooth = |height, width| {
            let padding = Padding::smooth(&Optics::new(height, width, 10.8e-6, 520e-9, 0.4).unwrap());
            [padding.rows, padding.columns]
        };
        assert_eq!(smooth(800, 1358), [0, 82]);
        assert_eq!(smooth(1358, 2 * 7 * 11 * 13), [82, 0]);
        // Short sides keep any size.
        assert_eq!(smooth(97, 251), [0, 0]);
        assert_eq!([1, 2, 1358, 97 * 97, 3600].map(largest_prime), [1, 2, 97, 97, 5]);
        let far = Optics::new(800, 1358, 10.8e-6, 520e-9, 0.4).unwrap().in_geometry(Geometry::FarField);
        assert_eq!(Padding::smooth(&far), Padding::default());
    }
}
