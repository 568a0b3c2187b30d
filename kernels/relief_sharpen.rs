//! Sharpens edges of a map of disparities, which are often one or two pixels wide. Values in between take the closer
//! side.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Times that a map is sharpened.
pub const TIMES: usize = 2;

/// Size of the map.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Number of rows of the map.
    pub height: u32,
    /// Number of columns of the map.
    pub width: u32,
    /// Smallest difference of disparity that is a tear.
    pub tear: f32,
}

/// Writes the sharpened disparities (height, width) of `from`.
pub fn relief_sharpen(args: &Args, from: &[f32], to: &mut [f32]) {
    let (height, width) = (args.height as usize, args.width as usize);
    to.par_chunks_mut(width.max(1)).take(height).enumerate().for_each(|(y, to)| {
        for (x, to) in to.iter_mut().enumerate() {
            let here = from[y * width + x];
            let (mut low, mut high) = (here, here);
            for j in y.saturating_sub(1)..(y + 2).min(height) {
                for i in x.saturating_sub(1)..(x + 2).min(width) {
                    low = low.min(from[j * width + i]);
                    high = high.max(from[j * width + i]);
                }
            }
            let closer = if high - here < here - low { high } else { low };
            *to = if high - low > args.tear { closer } else { here };
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_between_two_surfaces_takes_the_closer_one() {
        let args = Args { height: 1, width: 7, tear: 1.0 };
        let mut sharp = [9.0; 7];
        relief_sharpen(&args, &[0.0, 0.0, 0.9, 2.0, 2.0, 2.4, 2.8], &mut sharp);
        assert_eq!(sharp, [0.0, 0.0, 0.0, 2.0, 2.0, 2.4, 2.8]);
        let narrow = Args { tear: 5.0, ..args };
        let from = [0.0, 0.0, 0.9, 2.0, 2.0, 2.4, 2.8];
        relief_sharpen(&narrow, &from, &mut sharp);
        assert_eq!(sharp, from);
    }
}
