//! The views of one colour as the photograph reads them: compact, and at several resolutions.

use eyebox_kernels::resample::{self, Table};
use eyebox_kernels::simd;
use rayon::prelude::*;

/// One resolution of all views.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// (views, height, width), linear light, 65535 = [`Pyramid::scale`].
    pub views: Vec<u16>,
}

/// All views on the display's grid, and smaller copies for pupils whose window is smaller.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pyramid {
    /// Linear light of the value 65535.
    pub scale: f32,
    /// Number of views.
    pub count: usize,
    /// From the whole grid down, each half the one before.
    pub levels: Vec<Level>,
}

/// Levels smaller than this on their shorter side save nothing.
const SMALLEST: usize = 24;

/// Light of 0 to `scale` in steps of `scale` / 65535, the nearest.
fn quantise(light: &[f32], scale: f32, out: &mut [u16]) {
    // Whole numbers added to 2^23 are the lowest bits of its mantissa.
    const WHOLE: f32 = 8_388_608.0;
    simd(
        #[inline(always)]
        || {
            for (out, v) in out.iter_mut().zip(light) {
                let steps = (v / scale * 65535.0 + 0.5).trunc().clamp(0.0, 65535.0);
                *out = (steps + WHOLE).to_bits() as u16;
            }
        },
    );
}

/// The light of such steps.
fn linear(steps: &[u16], scale: f32, out: &mut [f32]) {
    simd(
        #[inline(always)]
        || {
            for (out, v) in out.iter_mut().zip(steps) {
                *out = f32::from(*v) / 65535.0 * scale;
            }
        },
    );
}

impl Pyramid {
    /// (height, width) of the levels over a grid of this size, from the grid's own down.
    pub fn sizes(height: usize, width: usize) -> Vec<(usize, usize)> {
        let halved = |&(h, w): &(usize, usize)| (h.min(w) >= 2 * SMALLEST).then(|| (h.div_ceil(2), w.div_ceil(2)));
        std::iter::successors(Some((height, width)), halved).collect()
    }

    /// Of so many views of this size, without their light: what plans need.
    pub fn outline(count: usize, height: usize, width: usize) -> Self {
        let level = |(height, width)| Level { height, width, views: Vec::new() };
        Self { scale: 1.0, count, levels: Self::sizes(height, width).into_iter().map(level).collect() }
    }

    /// From views (each height * width, linear light, finite, not negative). Quantised to 1/65535 of the brightest.
    pub fn new(views: &[impl AsRef<[f32]> + Sync], height: usize, width: usize) -> Self {
        let brightest =
            views.par_iter().map(|v| v.as_ref().iter().copied().fold(0.0, f32::max)).reduce(|| 0.0, f32::max);
        let scale = if brightest > 0.0 { brightest } else { 1.0 };
        let mut levels = vec![Level { height, width, views: vec![0; views.len() * height * width] }];
        levels[0].views.par_chunks_mut(height * width).zip(views).for_each(|(out, view)| {
            quantise(view.as_ref(), scale, out);
        });
        for pair in Self::sizes(height, width).windows(2) {
            let ((finer_h, finer_w), (h, w)) = (pair[0], pair[1]);
            let (rows, columns) = (Table::area(finer_h, h), Table::area(finer_w, w));
            let args = resample::Args {
                in_height: finer_h as u32,
                in_width: finer_w as u32,
                height: h as u32,
                width: w as u32,
                row_taps: rows.taps as u32,
                column_taps: columns.taps as u32,
            };
            let finer = &levels.last().expect("the grid's own level").views;
            let mut smaller = vec![0; views.len() * h * w];
            smaller.par_chunks_mut(h * w).zip(finer.par_chunks(finer_h * finer_w)).for_each(|(out, view)| {
                let (mut light, mut image) = (vec![0.0; view.len()], vec![0.0; h * w]);
                linear(view, scale, &mut light);
                resample::resample(&args, &light, &rows, &columns, &mut image, &mut Vec::new());
                quantise(&image, scale, out);
            });
            levels.push(Level { height: h, width: w, views: smaller });
        }
        Self { scale, count: views.len(), levels }
    }

    /// Bytes of all levels.
    pub fn bytes(&self) -> usize {
        self.levels.iter().map(|l| 2 * self.count * l.height * l.width).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every step, what lies between two, and what rounds to the next: as a conversion of each value by itself has it.
    #[test]
    fn light_is_stored_in_the_nearest_step_and_comes_back() {
        let scale = 0.8f32;
        let light: Vec<f32> = (0..=262_140u32).map(|i| i as f32 / 262_140.0 * scale).collect();
        let mut steps = vec![0; light.len()];
        quantise(&light, scale, &mut steps);
        assert!(light.iter().zip(&steps).all(|(v, step)| *step == (v / scale * 65535.0 + 0.5) as u16));
        let mut back = vec![0.0; light.len()];
        linear(&steps, scale, &mut back);
        let off = light.iter().zip(&back).map(|(v, b)| (v - b).abs()).fold(0.0, f32::max);
        assert!(off <= 0.5 / 65535.0 * scale * 1.01, "{off}");
        let mut ends = [9; 3];
        quantise(&[0.0, scale, 0.49 / 65535.0 * scale], scale, &mut ends);
        assert_eq!(ends, [0, 65535, 0]);
    }
}
