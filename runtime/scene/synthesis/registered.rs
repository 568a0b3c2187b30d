//! Bends pictures so that a viewer sees them straight, and simulates that view (OPTICS 10).

use crate::light_field::resize::catmull_rom;
use eyebox_optics::PictureMap;
use rayon::prelude::*;

/// The source of each pixel of a picture in another picture of the same size, and the distances of neighbors' sources,
/// as (x, y) each in pixels.
pub struct Bend {
    size: [usize; 2],
    from: Vec<([f64; 2], [f64; 2])>,
}

impl Bend {
    /// Prepares the picture that the display must show so that the viewer sees the original.
    pub fn to_display(map: &PictureMap, size: [usize; 2]) -> Self {
        Self::new(size, |at| map.forth(at))
    }

    /// Prepares the view of a picture that the display shows.
    pub fn to_viewer(map: &PictureMap, size: [usize; 2]) -> Self {
        Self::new(size, |at| map.back(at))
    }

    fn new([rows, columns]: [usize; 2], map: impl Fn([f64; 2]) -> [f64; 2] + Sync) -> Self {
        let (high, wide) = (rows as f64, columns as f64);
        let source = |x: f64, y: f64| {
            let [u, v] = map([(2.0 * x + 1.0 - wide) / wide, (2.0 * y + 1.0 - high) / wide]);
            [0.5 * (u * wide + wide - 1.0), 0.5 * (v * wide + high - 1.0)]
        };
        let pixel = |i: usize| {
            let (x, y) = ((i % columns) as f64, (i / columns) as f64);
            let (at, right, below) = (source(x, y), source(x + 1.0, y), source(x, y + 1.0));
            let apart = |axis: usize| (right[axis] - at[axis]).hypot(below[axis] - at[axis]).clamp(1.0, 8.0);
            (at, [apart(0), apart(1)])
        };
        Self { size: [rows, columns], from: (0..rows * columns).into_par_iter().map(pixel).collect() }
    }

    /// Writes the source pixels of a pixel with their weights, along a row and down a column. Far outside of the picture
    /// there are none.
    fn sources(&self, pixel: usize, along: &mut Vec<(usize, f64)>, down: &mut Vec<(usize, f64)>) {
        let ([rows, columns], ([x, y], [wide, high])) = (self.size, self.from[pixel]);
        axis(x, wide, columns, along);
        axis(y, high, rows, down);
    }

    /// Bends a plane of linear light. It uses Catmull-Rom with a width of the distance between source pixels. Places
    /// beyond the picture become black, and no value is below black.
    pub fn apply(&self, plane: &[f32]) -> Vec<f32> {
        let [rows, columns] = self.size;
        let mut out = vec![0.0f32; rows * columns];
        out.par_chunks_mut(columns).enumerate().for_each(|(row, line)| {
            let (mut along, mut down) = (Vec::new(), Vec::new());
            for (column, value) in line.iter_mut().enumerate() {
                self.sources(row * columns + column, &mut along, &mut down);
                let line_sum = |j: usize| along.iter().map(|(i, w)| w * f64::from(plane[j * columns + i])).sum::<f64>();
                *value = down.iter().map(|(j, w)| w * line_sum(*j)).sum::<f64>().max(0.0) as f32;
            }
        });
        out
    }

    /// Returns the gradient with respect to a plane from the gradient with respect to `bent`, which is the plane after
    /// [`apply`](Self::apply). Pixels that are cut at black have no share in it.
    pub fn adjoint(&self, gradient: &[f32], bent: &[f32]) -> Vec<f32> {
        let [rows, columns] = self.size;
        let mut sums = vec![0.0f64; rows * columns];
        let (mut along, mut down) = (Vec::new(), Vec::new());
        for (pixel, (value, bent)) in gradient.iter().zip(bent).enumerate() {
            if *bent > 0.0 {
                self.sources(pixel, &mut along, &mut down);
                for (j, high) in &down {
                    along.iter().for_each(|(i, w)| sums[j * columns + i] += w * high * f64::from(*value));
                }
            }
        }
        sums.into_iter().map(|sum| sum as f32).collect()
    }
}

/// Writes the source pixels along one axis of `n` pixels with their weights, around `at`.
fn axis(at: f64, wide: f64, n: usize, out: &mut Vec<(usize, f64)>) {
    out.clear();
    if at <= -17.0 || at >= n as f64 + 17.0 {
        return;
    }
    let (first, last) = ((at - 2.0 * wide).ceil(), (at + 2.0 * wide).floor());
    let mut sum = 0.0;
    let mut k = first;
    while k <= last {
        let weight = catmull_rom((at - k) / wide);
        sum += weight;
        if (0.0..n as f64).contains(&k) {
            out.push((k as usize, weight));
        }
        k += 1.0;
    }
    out.iter_mut().for_each(|(_, weight)| *weight /= sum);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sum of gradient times bent plane equals the sum of its adjoint times the plane, because bending is linear
    /// above black.
    #[test]
    fn the_adjoint_is_that_of_the_bend() {
        let size @ [rows, columns] = [13, 21];
        let bend = Bend::new(size, |[x, y]| [0.9 * x + 0.1 * y + 0.05 * x * x, 1.3 * y - 0.2 * x]);
        let mut random = eyebox_base::random::SplitMix(3);
        let mut noise = || (0..rows * columns).map(|_| random.unit() as f32).collect::<Vec<_>>();
        let (plane, gradient) = (noise(), noise());
        let bent = bend.apply(&plane);
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let (there, back) = (dot(&gradient, &bent), dot(&bend.adjoint(&gradient, &bent), &plane));
        assert!((there / back - 1.0).abs() < 1e-6 && there > 1.0, "{there}, {back}");
    }
}
