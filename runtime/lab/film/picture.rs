//! Composes a frame from linear light.

use eyebox::low_level::evaluate::{Plane, rgb};
use eyebox::low_level::files::linear_to_srgb;
use eyebox::low_level::optics::Color;
use rayon::prelude::*;

/// The encoded gray between two pictures.
const GAP: u8 = 96;
/// The gap has the columns of a picture divided by this number.
const GAP_SHARE: usize = 48;

/// A frame as encoded red, green and blue of each pixel.
pub struct Canvas {
    /// Rows and columns of the frame.
    pub size: [usize; 2],
    /// The levels by (row, column, channel).
    pub rgb: Vec<u8>,
}

impl Canvas {
    /// Composes pictures of one size next to each other. Each has one plane per color and is dimmed to the share `open`
    /// of its light.
    pub fn of(pictures: &[&[Plane]], colors: &[Option<Color>], open: f32) -> Self {
        let first = pictures.iter().find_map(|p| p.first());
        let (rows, columns) = first.map_or((0, 0), |p| (p.rows, p.columns));
        let gap = columns.div_ceil(GAP_SHARE);
        let wide = (columns + gap) * pictures.len().max(1) - gap;
        let mut out = vec![GAP; 3 * rows * wide];
        let black = vec![0.0; rows * columns];
        for (at, planes) in pictures.iter().enumerate() {
            let named: Vec<_> = colors.iter().copied().zip(planes.iter().map(|p| &p.values[..])).collect();
            let channels = rgb(&named, &black);
            let left = at * (columns + gap);
            out.par_chunks_mut(3 * wide.max(1)).enumerate().for_each(|(y, row)| {
                for (x, pixel) in row[3 * left..][..3 * columns].chunks_exact_mut(3).enumerate() {
                    for (out, channel) in pixel.iter_mut().zip(channels) {
                        let light = f64::from(channel[y * columns + x] * open);
                        // A cast from float saturates, and converts NaN to 0.
                        *out = (linear_to_srgb(light) * 255.0).round() as u8;
                    }
                }
            });
        }
        Self { size: [rows, wide], rgb: out }
    }
}

/// Returns the mean of each block of `n` x `n` pixels. Incomplete blocks at the ends are dropped. A picture smaller
/// than a block is unchanged.
pub fn binned(plane: &Plane, n: usize) -> Plane {
    let (rows, columns) = (plane.rows / n.max(1), plane.columns / n.max(1));
    if n <= 1 || rows == 0 || columns == 0 {
        return plane.clone();
    }
    let share = 1.0 / (n * n) as f32;
    let mut values = vec![0.0f32; rows * columns];
    for (y, row) in plane.values.chunks_exact(plane.columns).take(rows * n).enumerate() {
        let out = &mut values[y / n * columns..][..columns];
        for (out, block) in out.iter_mut().zip(row.chunks_exact(n)) {
            *out += share * block.iter().sum::<f32>();
        }
    }
    Plane { rows, columns, values }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_become_their_mean_and_pictures_stand_beside_each_other() {
        let plane = Plane { rows: 3, columns: 5, values: (0..15).map(|i| i as f32 / 15.0).collect() };
        let small = binned(&plane, 2);
        assert_eq!((small.rows, small.columns), (1, 2));
        assert!((small.values[0] - 3.0 / 15.0).abs() < 1e-6 && (small.values[1] - 5.0 / 15.0).abs() < 1e-6);
        assert_eq!((binned(&plane, 1), binned(&plane, 9)), (plane.clone(), plane.clone()));
        let white = Plane { values: vec![1.0; 15], ..plane.clone() };
        let canvas = Canvas::of(&[&[plane], &[white]], &[Some(Color::Red)], 1.0);
        assert_eq!(canvas.size, [3, 11]);
        assert_eq!((&canvas.rgb[..3], &canvas.rgb[15..21]), (&[0; 3][..], &[GAP, GAP, GAP, 255, 255, 255][..]));
    }
}
