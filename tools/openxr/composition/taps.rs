//! Tables for resampling along one axis, from the samples of an application's view to the pixels of a display.

/// The pinhole picture of a display, straight ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frustum {
    /// Rows and columns of pixels.
    pub size: [usize; 2],
    /// The angle between neighboring pixels at the center, as a tangent.
    pub angle: f64,
}

impl Frustum {
    /// Returns the tangents of the pixels of a column or a row, with +x right and +y up.
    pub fn tangents(&self, axis: usize) -> impl Iterator<Item = f64> + use<> {
        let (count, sign) = (self.size[axis], if axis == 0 { -1.0 } else { 1.0 });
        let angle = self.angle;
        (0..count).map(move |i| sign * (i as f64 - (count as f64 - 1.0) / 2.0) * angle)
    }

    /// Returns the tangents of the edges as left, right, up, down.
    pub fn edges(&self) -> [f64; 4] {
        let [rows, columns] = self.size.map(|n| n as f64 / 2.0 * self.angle);
        [-columns, columns, rows, -rows]
    }
}

/// The samples for one pixel, with weights that sum to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Taps {
    /// The index of the first sample.
    pub first: usize,
    /// The weights of this sample and the next ones.
    pub weights: Vec<f32>,
    /// The index of the nearest sample.
    pub nearest: usize,
}

/// Returns the taps of each pixel, or none for a pixel outside the view. Each pixel has one of the `tangents`. The view
/// has `count` samples between the tangents `begin` and `end`.
///
/// Neighboring samples are interpolated. If a pixel is wider than a sample, all samples below it count, so that fine
/// content does not alias.
pub fn taps(
    tangents: impl Iterator<Item = f64>,
    angle: f64,
    [begin, end]: [f64; 2],
    count: usize,
) -> Vec<Option<Taps>> {
    let per_tangent = count as f64 / (end - begin);
    let width = (angle * per_tangent).abs().max(1.0);
    let one = |tangent: f64| {
        let at = (tangent - begin) * per_tangent - 0.5;
        // A pixel at the edge of the view is inside, whatever the rounding.
        if !(at > -0.500_001 && at < count as f64 - 0.499_999) {
            return None;
        }
        let last = count as f64 - 1.0;
        let clamped = at.clamp(0.0, last);
        let first = (clamped - width).ceil().max(0.0);
        let until = (clamped + width).floor().min(last);
        let weight = |i: usize| (1.0 - (i as f64 - clamped).abs() / width).max(0.0);
        let mut weights: Vec<f64> = (first as usize..=until as usize).map(weight).collect();
        let first = first as usize + weights.iter().position(|w| *w > 0.0)?;
        weights.retain(|w| *w > 0.0);
        let sum: f64 = weights.iter().sum();
        let weights = weights.iter().map(|w| (w / sum) as f32).collect();
        Some(Taps { first, weights, nearest: clamped.round() as usize })
    };
    if count == 0 || !per_tangent.is_finite() { tangents.map(|_| None).collect() } else { tangents.map(one).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_grid_takes_each_sample_once() {
        let frustum = Frustum { size: [3, 5], angle: 0.1 };
        let [left, right, up, down] = frustum.edges();
        let columns = taps(frustum.tangents(1), 0.1, [left, right], 5);
        let rows = taps(frustum.tangents(0), 0.1, [up, down], 3);
        for (i, tap) in columns.iter().chain(&rows).enumerate() {
            let tap = tap.as_ref().expect("inside");
            let most = tap.weights.iter().copied().fold(0.0, f32::max);
            assert!((most - 1.0).abs() < 1e-6 && tap.nearest == i % 5, "{i}: {tap:?}");
        }
    }

    #[test]
    fn wide_pixels_average_and_pixels_outside_have_no_samples() {
        // Each pixel covers four samples, and two pixels are outside.
        let frustum = Frustum { size: [1, 6], angle: 0.4 };
        let all = taps(frustum.tangents(1), 0.4, [-0.8, 0.8], 16);
        assert!(all[0].is_none() && all[5].is_none());
        for tap in all[1..5].iter().map(|tap| tap.as_ref().expect("inside")) {
            assert!(tap.weights.len() >= 4 && (tap.weights.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{tap:?}");
        }
        // A view that is upside down is turned.
        let turned = taps([-0.35f64, 0.35].into_iter(), 0.1, [0.4, -0.4], 8);
        assert_eq!(turned.iter().map(|t| t.as_ref().expect("inside").nearest).collect::<Vec<_>>(), [7, 0]);
    }
}
