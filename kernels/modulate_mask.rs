//! Computes the field on the pixels of a static phase mask with finer pixels than the SLM (OPTICS 12). It is `field =
//! scale (amplitude exp(i W) + rest) mask`, and zero in the padding around it. `factor` x `factor` mask pixels cover a
//! pixel of the SLM. One frame.

use crate::{Complex32, ZERO, modulate, simd, trig};
use bytemuck::{Pod, Zeroable};

/// Maximum number of mask pixels along an axis of an SLM pixel.
pub const MOST: usize = 4;

/// Arguments of this kernel and of `phase_gradient_mask`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Size of the SLM, and the position of its first mask pixel in the grid, whose points are mask pixels.
    pub place: modulate::Args,
    /// Mask pixels per SLM pixel along an axis.
    pub factor: u32,
    /// 1 if the mask is at the SLM, 0 if the light reaches it later.
    pub here: u32,
    /// Share of each mask pixel that the SLM pixel fills, along an axis.
    pub cover: [f32; MOST],
}

impl Args {
    /// Returns true if the arguments match this SLM in this grid.
    pub fn fits(&self, place: &modulate::Args) -> bool {
        let reaches = |first: u32, count: u32, all: u32| {
            u64::from(first) + u64::from(count) * u64::from(self.factor) <= u64::from(all)
        };
        self.place == *place
            && (1..=MOST as u32).contains(&self.factor)
            && reaches(place.top, place.height, place.grid_height)
            && reaches(place.left, place.width, place.grid_width)
    }
}

/// Writes `field` (grid_height, grid_width). `tables` holds the level, the amplitude, and the real and imaginary part
/// of the rest, each (height, width). `wave` is (height, width), and `mask` is (height factor, width factor).
pub fn modulate_mask(
    args: &Args,
    scale: f32,
    tables: &[f32],
    wave: &[f32],
    mask: &[Complex32],
    field: &mut [Complex32],
) {
    let Args { place, here, cover, .. } = *args;
    let (k, w, gw) = (args.factor as usize, place.width as usize, place.grid_width as usize);
    let (top, left, pixels) = (place.top as usize, place.left as usize, (place.width * place.height) as usize);
    let [amplitude, re, im] = [1, 2, 3].map(|i| &tables[i * pixels..][..pixels]);
    let mut lit = vec![ZERO; w];
    simd(
        #[inline(always)]
        || {
            if place.height * args.factor != place.grid_height || place.width * args.factor != place.grid_width {
                field.fill(ZERO);
            }
            for y in 0..place.height as usize {
                let row = y * w..(y + 1) * w;
                let tables = amplitude[row.clone()].iter().zip(&re[row.clone()]).zip(&im[row.clone()]);
                for ((z, phase), ((a, re), im)) in lit.iter_mut().zip(&wave[row]).zip(tables) {
                    let (c, s) = trig::cos_sin(*phase);
                    *z = Complex32::new((a * c + re) * scale, (a * s + im) * scale);
                }
                for down in 0..k {
                    let out = &mut field[(top + k * y + down) * gw + left..][..k * w];
                    let mask = &mask[(k * y + down) * k * w..][..k * w];
                    for ((out, mask), z) in out.chunks_exact_mut(k).zip(mask.chunks_exact(k)).zip(&lit) {
                        for ((out, m), across) in out.iter_mut().zip(mask).zip(cover) {
                            let part = cover[down] * across;
                            let (m, part) = if here != 0 { (*m, part) } else { (Complex32::new(1.0, 0.0), part) };
                            let (re, im) = (z.re * m.re - z.im * m.im, z.re * m.im + z.im * m.re);
                            *out = Complex32::new(part * re, part * im);
                        }
                    }
                }
            }
        },
    );
}
