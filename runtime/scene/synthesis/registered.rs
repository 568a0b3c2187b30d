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

    /// Bends a plane of linear light. It uses Catmull-Rom with a width of the distance between source pixels. Places
    /// beyond the picture become black, and no value is below black.
    pub fn apply(&self, plane: &[f32]) -> Vec<f32> {
        let [rows, columns] = self.size;
        let axis = |at: f64, wide: f64, n: usize, out: &mut Vec<(usize, f64)>| {
            out.clear();
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
        };
        let mut out = vec![0.0f32; rows * columns];
        out.par_chunks_mut(columns).enumerate().for_each(|(row, line)| {
            let (mut along, mut down) = (Vec::new(), Vec::new());
            for (value, &([x, y], [wide, high])) in line.iter_mut().zip(&self.from[row * columns..]) {
                // Far outside of the picture there is nothing to sum.
                let is_near = |at: f64, n: usize| at > -17.0 && at < n as f64 + 17.0;
                if !is_near(x, columns) || !is_near(y, rows) {
                    continue;
                }
                axis(x, wide, columns, &mut along);
                axis(y, high, rows, &mut down);
                let line_sum = |j: usize| along.iter().map(|(i, w)| w * f64::from(plane[j * columns + i])).sum::<f64>();
                *value = down.iter().map(|(j, w)| w * line_sum(*j)).sum::<f64>().max(0.0) as f32;
            }
        });
        out
    }
}
