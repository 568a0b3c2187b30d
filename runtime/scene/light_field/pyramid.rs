//! Stores the views of one color compactly and at several resolutions, for target images.

use eyebox_kernels::resample::{self, Table};
use eyebox_kernels::simd;
use rayon::prelude::*;
use std::any::Any;
use std::fmt;
use std::sync::Arc;

/// One resolution of all views.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// Rows of pixels of a view.
    pub height: usize,
    /// Columns of pixels of a view.
    pub width: usize,
    /// The views as (views, height, width) in linear light, where 65535 means [`Pyramid::scale`]. If the views are [on
    /// a device](Pyramid::on_device), this is empty, or has only the middle view and zeros for the others.
    pub views: Vec<u16>,
}

/// Views in the memory of a device.
pub trait ViewsOnDevice: Any + Send + Sync {
    /// Reads all levels, from the whole grid down, as (views, height, width) each.
    ///
    /// # Errors
    /// The reason in a sentence, if the device does not answer.
    fn read(&self) -> Result<Vec<Vec<u16>>, String>;

    /// Returns true if the device stopped answering, so that the light is lost.
    fn is_lost(&self) -> bool;
}

/// The place of a pyramid's light if it is not in the memory of the host.
#[derive(Clone, Default)]
struct Elsewhere(Option<Arc<dyn ViewsOnDevice>>);

impl fmt::Debug for Elsewhere {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "on a device" } else { "on the host" })
    }
}

impl PartialEq for Elsewhere {
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (Some(one), Some(other)) => Arc::ptr_eq(one, other),
            (None, None) => true,
            _ => false,
        }
    }
}

/// All views on the grid of the display, and smaller copies for pupils with a smaller spectral window.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pyramid {
    /// Linear light of the value 65535.
    pub scale: f32,
    /// Number of views in each level.
    pub count: usize,
    /// The levels from the whole grid down, each half the size of the one before.
    pub levels: Vec<Level>,
    elsewhere: Elsewhere,
}

/// Levels smaller than this on their shorter side save nothing.
const SMALLEST: usize = 24;
/// Largest number of pixels along the longer side of pictures that are compared.
const COMPARED: usize = 256;

/// Quantizes light of 0 to `scale` to the nearest step of `scale` / 65535.
fn quantise(light: &[f32], scale: f32, out: &mut [u16]) {
    // A whole number that is added to 2^23 becomes the lowest bits of the mantissa.
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

/// Returns the brightest value, which is 0 or more. NaN does not count.
fn brightest(light: &[f32]) -> f32 {
    let mut most = [0.0f32; 16];
    let (rows, rest) = light.as_chunks::<16>();
    simd(
        #[inline(always)]
        || {
            for row in rows {
                most.iter_mut().zip(row).for_each(|(most, v)| *most = if *v > *most { *v } else { *most });
            }
        },
    );
    most.iter().chain(rest).copied().fold(0.0, f32::max)
}

/// Converts steps back to light.
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
    /// Returns (height, width) of the levels over a grid of this size, from the grid itself down.
    pub fn sizes(height: usize, width: usize) -> Vec<(usize, usize)> {
        let halved = |&(h, w): &(usize, usize)| (h.min(w) >= 2 * SMALLEST).then(|| (h.div_ceil(2), w.div_ceil(2)));
        std::iter::successors(Some((height, width)), halved).collect()
    }

    /// Returns a pyramid of `count` views of this size without their light, which is sufficient for plans.
    pub fn outline(count: usize, height: usize, width: usize) -> Self {
        let level = |(height, width)| Level { height, width, views: Vec::new() };
        let levels = Self::sizes(height, width).into_iter().map(level).collect();
        Self { scale: 1.0, count, levels, elsewhere: Elsewhere::default() }
    }

    /// Returns the same pyramid with its light on a device, where `scale` is the light of the value 65535.
    #[must_use]
    pub fn with_light(self, scale: f32, views: Arc<dyn ViewsOnDevice>) -> Self {
        Self { scale, elsewhere: Elsewhere(Some(views)), ..self }
    }

    /// Returns the views on the device, if they are on one.
    pub fn on_device(&self) -> Option<&dyn ViewsOnDevice> {
        self.elsewhere.0.as_deref()
    }

    /// Returns the same pyramid with all of its light on the host. It reads the light from the device if it is there.
    ///
    /// # Errors
    /// The reason in a sentence, if the device does not answer.
    pub fn on_host(self: &Arc<Self>) -> Result<Arc<Self>, String> {
        let Some(views) = self.on_device() else { return Ok(Arc::clone(self)) };
        let levels = self.levels.iter().zip(views.read()?);
        let levels = levels.map(|(Level { height, width, .. }, views)| Level { height: *height, width: *width, views });
        let (scale, count, levels) = (self.scale, self.count, levels.collect());
        Ok(Arc::new(Self { scale, count, levels, elsewhere: Elsewhere::default() }))
    }

    /// Builds a pyramid from views (each height * width, linear light, finite, not negative). The light is quantized to
    /// 1/65535 of the brightest value.
    pub fn new(views: &[impl AsRef<[f32]> + Sync], height: usize, width: usize) -> Self {
        let brightest = views.par_iter().map(|view| brightest(view.as_ref())).reduce(|| 0.0, f32::max);
        let scale = if brightest > 0.0 { brightest } else { 1.0 };
        let mut levels = vec![Level { height, width, views: vec![0; views.len() * height * width] }];
        levels[0].views.par_chunks_mut(height * width).zip(views).for_each(|(out, view)| {
            quantise(view.as_ref(), scale, out);
        });
        for pair in Self::sizes(height, width).windows(2) {
            let ((finer_h, finer_w), (h, w)) = (pair[0], pair[1]);
            let (rows, columns) = (Table::area(finer_h, h), Table::area(finer_w, w));
            let args = resample::Args::between(pair[0], pair[1], &rows, &columns);
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
        Self { scale, count: views.len(), levels, elsewhere: Elsewhere::default() }
    }

    /// Returns the level whose pictures are compared with others. It is small, so that a comparison is fast.
    pub fn compared(&self) -> Option<usize> {
        let small = self.levels.iter().position(|level| level.height.max(level.width) <= COMPARED);
        small.or(self.levels.len().checked_sub(1))
    }

    /// Returns the bytes of all levels.
    pub fn bytes(&self) -> usize {
        self.levels.iter().map(|l| 2 * self.count * l.height * l.width).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests every step, values between two steps, and values that round to the next one. The result equals a
    /// conversion of each value by itself.
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
