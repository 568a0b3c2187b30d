//! Closes the gaps of a view of a relief. Pixels that no piece covers take the farther one of the two sides along the
//! direction of the parallax.

use crate::relief::COLORS;
use crate::relief_draw::Pixel;
use rayon::prelude::*;

/// A pixel with a larger covered share needs no color from its neighbors.
pub const KNOWN: f32 = 0.5;

/// Returns the colors (color, row, column) of a view of (rows, columns) from `u` columns and `v` rows of views from the
/// center.
pub fn relief_close(size: [usize; 2], pixels: &[Pixel], along: [f32; 2]) -> Vec<Vec<f32>> {
    let direction = direction(along);
    let known = |pixel: &Pixel| pixel.color.map(|k| k / pixel.covered.max(1e-6));
    let far = |q: usize| (pixels[q].covered > KNOWN).then(|| pixels[q].depth / pixels[q].covered);
    let closed = |(p, pixel): (usize, &Pixel)| {
        if pixel.covered > KNOWN {
            return known(pixel);
        }
        let mut color = pixel.color;
        if let Some(q) = farther_side(size, p, direction, far) {
            let rest = 1.0 - pixel.covered;
            color.iter_mut().zip(known(&pixels[q])).for_each(|(c, k)| *c += rest * k);
        }
        color
    };
    let colors: Vec<[f32; COLORS]> = pixels.par_iter().enumerate().map(closed).collect();
    (0..COLORS).map(|k| colors.iter().map(|c| c[k].max(0.0)).collect()).collect()
}

/// Returns the direction of the parallax of a view at (u, v).
pub fn direction([u, v]: [f32; 2]) -> [f32; 2] {
    let length = (u * u + v * v).sqrt().max(1e-6);
    if u * u + v * v > 0.0 { [u / length, v / length] } else { [1.0, 0.0] }
}

/// Returns the farther one of the nearest pixels with a disparity before and behind pixel `p` along a direction (x, y).
pub fn farther_side(
    [height, width]: [usize; 2],
    p: usize,
    [du, dv]: [f32; 2],
    disparity: impl Fn(usize) -> Option<f32>,
) -> Option<usize> {
    let (x, y) = ((p % width) as f32, (p / width) as f32);
    let search = |sign: f32| {
        let steps = (1..width + height).map(|k| sign * k as f32);
        let mut pixels = steps.map_while(|k| {
            let (x, y) = ((x + k * du).round(), (y + k * dv).round());
            let inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
            inside.then_some(y as usize * width + x as usize)
        });
        pixels.find_map(|q| Some((q, disparity(q)?)))
    };
    match (search(1.0), search(-1.0)) {
        (Some(a), Some(b)) => Some(if a.1 <= b.1 { a.0 } else { b.0 }),
        (a, b) => a.or(b).map(|(q, _)| q),
    }
}
