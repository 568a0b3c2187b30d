//! Resizes pictures in linear light, by exact area averages downwards and Catmull-Rom upwards, never below zero.

/// The placement of a picture on a display of another shape.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Fit {
    /// The whole picture is visible, and the rest of the display is black.
    #[default]
    Contain,
    /// The whole display is filled, and the parts of the picture beyond it are cut off.
    Cover,
    /// Both axes are filled, each with its own scale. Depths then differ between the axes, which makes the picture
    /// astigmatic.
    Stretch,
}

/// A planned resize of planes of one size to another.
pub struct Resize {
    scale: [f64; 2],
    rows: Axis,
    columns: Axis,
}

/// One axis with the source pixels that contribute to each target pixel. Weights include the share of the target pixel
/// that the picture covers, so the letterbox is black with a soft edge.
struct Axis {
    source: usize,
    first_tap: Vec<usize>,
    taps: Vec<(u32, f32)>,
}

impl Resize {
    /// Plans a resize from `source` to `target` (rows, columns), with the picture centered to a whole pixel.
    pub fn new(source: [usize; 2], target: [usize; 2], fit: Fit) -> Self {
        let own = [0, 1].map(|k| target[k] as f64 / source[k] as f64);
        let scale = match fit {
            Fit::Contain => [own[0].min(own[1]); 2],
            Fit::Cover => [own[0].max(own[1]); 2],
            Fit::Stretch => own,
        };
        let axis = |k: usize| {
            let offset = ((target[k] as f64 - source[k] as f64 * scale[k]) / 2.0).round();
            Axis::new(source[k], target[k], scale[k], offset)
        };
        Self { scale, rows: axis(0), columns: axis(1) }
    }

    /// Scales a range of lengths in pixels so that it covers both axes.
    pub fn scale_range(&self, [low, high]: [f64; 2]) -> [f64; 2] {
        let [a, b] = self.scale;
        [(low * a).min(low * b), (high * a).max(high * b)]
    }

    /// Resizes one plane of the planned size.
    pub fn apply(&self, plane: &[f32]) -> Vec<f32> {
        let (height, width) = (self.rows.len(), self.columns.len());
        assert_eq!(plane.len(), self.rows.source * self.columns.source, "a plane of another size than planned");
        if self.rows.is_identity() && self.columns.is_identity() {
            return plane.to_vec();
        }
        let mut wide = vec![0.0f32; self.rows.source * width];
        for (from, to) in plane.chunks_exact(self.columns.source).zip(wide.chunks_exact_mut(width)) {
            for (i, value) in to.iter_mut().enumerate() {
                *value = self.columns.taps(i).iter().map(|&(k, w)| from[k as usize] * w).sum();
            }
        }
        let mut out = vec![0.0f32; height * width];
        for (i, to) in out.chunks_exact_mut(width).enumerate() {
            for &(k, w) in self.rows.taps(i) {
                let from = &wide[k as usize * width..][..width];
                to.iter_mut().zip(from).for_each(|(t, f)| *t += f * w);
            }
            to.iter_mut().for_each(|t| *t = t.max(0.0));
        }
        out
    }

    /// Returns the gradient with respect to a plane from the gradient with respect to `resized`, which is the plane
    /// after [`apply`](Self::apply). Pixels that are cut at black have no share in it.
    fn adjoint(&self, gradient: &[f32], resized: &[f32]) -> Vec<f32> {
        let (width, source) = (self.columns.len(), self.columns.source);
        let mut wide = vec![0.0f32; self.rows.source * width];
        for (i, (gradient, resized)) in gradient.chunks_exact(width).zip(resized.chunks_exact(width)).enumerate() {
            for &(k, w) in self.rows.taps(i) {
                let to = wide[k as usize * width..][..width].iter_mut();
                let lit = gradient.iter().zip(resized).map(|(g, r)| if *r > 0.0 { *g } else { 0.0 });
                to.zip(lit).for_each(|(t, g)| *t += w * g);
            }
        }
        let mut out = vec![0.0f32; self.rows.source * source];
        for (from, to) in wide.chunks_exact(width).zip(out.chunks_exact_mut(source)) {
            for (i, value) in from.iter().enumerate() {
                self.columns.taps(i).iter().for_each(|&(k, w)| to[k as usize] += w * value);
            }
        }
        out
    }
}

/// Shrinks the picture to `share` of its size about its axis, with black around it. This is the field of view of one
/// color that is wider than the picture (OPTICS 9). The pixel on the axis, `n / 2` of n, stays at its place.
pub fn shrink_to_share(plane: &[f32], height: usize, width: usize, share: f64) -> Vec<f32> {
    about_axis([height, width], share).apply(plane)
}

/// Enlarges the middle `share` of one color's image to the size of the whole image, which gives the picture again.
pub fn crop_share(plane: &[f32], height: usize, width: usize, share: f64) -> Vec<f32> {
    about_axis([height, width], 1.0 / share).apply(plane)
}

/// Returns the gradient with respect to an image from the gradient with respect to `cropped`, which is the image after
/// [`crop_share`].
pub fn crop_share_adjoint(gradient: &[f32], cropped: &[f32], height: usize, width: usize, share: f64) -> Vec<f32> {
    about_axis([height, width], 1.0 / share).adjoint(gradient, cropped)
}

fn about_axis(size: [usize; 2], scale: f64) -> Resize {
    let axis = |n: usize| Axis::new(n, n, scale, ((n / 2) as f64 + 0.5) * (1.0 - scale));
    Resize { scale: [scale; 2], rows: axis(size[0]), columns: axis(size[1]) }
}

impl Axis {
    fn new(source: usize, target: usize, scale: f64, offset: f64) -> Self {
        let mut axis = Self { source, first_tap: Vec::with_capacity(target + 1), taps: Vec::new() };
        let n = source as f64;
        for i in 0..target {
            axis.first_tap.push(axis.taps.len());
            // The target pixel, in source pixels.
            let (a, b) = ((i as f64 - offset) / scale, (i as f64 + 1.0 - offset) / scale);
            let (from, to) = (a.max(0.0), b.min(n));
            if to - from <= 1e-9 {
                continue;
            }
            if scale <= 1.0 {
                for k in from.floor() as usize..(to.ceil() as usize).min(source) {
                    let share = (to.min(k as f64 + 1.0) - from.max(k as f64)) / (b - a);
                    if share > 1e-9 {
                        axis.taps.push((k as u32, share as f32));
                    }
                }
            } else {
                let covered = (to - from) / (b - a);
                let center = (a + b) / 2.0 - 0.5;
                for k in center.floor() as i64 - 1..=center.floor() as i64 + 2 {
                    let inside = k.clamp(0, source as i64 - 1) as u32;
                    let weight = covered * catmull_rom(center - k as f64);
                    if weight != 0.0 {
                        axis.taps.push((inside, weight as f32));
                    }
                }
            }
        }
        axis.first_tap.push(axis.taps.len());
        axis
    }

    fn len(&self) -> usize {
        self.first_tap.len() - 1
    }

    fn taps(&self, i: usize) -> &[(u32, f32)] {
        &self.taps[self.first_tap[i]..self.first_tap[i + 1]]
    }

    fn is_identity(&self) -> bool {
        self.len() == self.source && (0..self.len()).all(|i| self.taps(i) == [(i as u32, 1.0)])
    }
}

/// The Catmull-Rom kernel at distance `t`.
pub(crate) fn catmull_rom(t: f64) -> f64 {
    let t = t.abs();
    if t < 1.0 {
        1.5 * t.powi(3) - 2.5 * t.powi(2) + 1.0
    } else if t < 2.0 {
        -0.5 * t.powi(3) + 2.5 * t.powi(2) - 4.0 * t + 2.0
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn downwards_keeps_the_light() {
        let plane: Vec<f32> = (0..12 * 10).map(|i| (i * 37 % 11) as f32).collect();
        let out = Resize::new([12, 10], [5, 3], Fit::Stretch).apply(&plane);
        let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
        assert!((mean(&out) - mean(&plane)).abs() < 1e-4, "{} {}", mean(&out), mean(&plane));
        let halved = Resize::new([12, 10], [6, 5], Fit::Contain).apply(&plane);
        assert!((halved[0] - (plane[0] + plane[1] + plane[10] + plane[11]) / 4.0).abs() < 1e-5);
    }

    #[test]
    fn upwards_keeps_ramps_and_never_goes_dark() {
        let ramp: Vec<f32> = (0..8 * 8).map(|i| (i % 8) as f32).collect();
        let out = Resize::new([8, 8], [16, 16], Fit::Contain).apply(&ramp);
        for x in 4..12 {
            assert!((out[5 * 16 + x] - ((x as f32 + 0.5) / 2.0 - 0.5)).abs() < 1e-5, "column {x}: {}", out[5 * 16 + x]);
        }
        let mut spike = vec![0.0; 64];
        spike[27] = 1.0;
        assert!(Resize::new([8, 8], [21, 21], Fit::Contain).apply(&spike).iter().all(|&v| v >= 0.0));
    }

    #[test]
    fn the_same_size_is_the_same_picture_and_a_smaller_one_is_placed_untouched() {
        let plane: Vec<f32> = (0..35).map(|i| i as f32).collect();
        assert_eq!(Resize::new([5, 7], [5, 7], Fit::Contain).apply(&plane), plane);
        let placed = Resize::new([5, 7], [5, 10], Fit::Contain).apply(&plane);
        assert_eq!(placed[12..19], plane[7..14]);
        assert_eq!((placed[10], placed[19]), (0.0, 0.0));
    }

    /// The sum of gradient times resized plane equals the sum of its adjoint times the plane, because resizing is linear
    /// above black.
    #[test]
    fn the_adjoint_is_that_of_the_resize() {
        let mut random = eyebox_base::random::SplitMix(5);
        let mut noise = |count: usize| (0..count).map(|_| random.unit() as f32).collect::<Vec<_>>();
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        for (target, fit) in [([5, 3], Fit::Contain), ([17, 31], Fit::Stretch), ([12, 40], Fit::Cover)] {
            let resize = Resize::new([12, 10], target, fit);
            let (plane, gradient) = (noise(120), noise(target[0] * target[1]));
            let resized = resize.apply(&plane);
            let (there, back) = (dot(&gradient, &resized), dot(&resize.adjoint(&gradient, &resized), &plane));
            assert!((there / back - 1.0).abs() < 1e-5 && there > 0.5, "{target:?}: {there}, {back}");
        }
    }
}
