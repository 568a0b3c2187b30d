//! Makes epipolar slices, which stack one row of the picture while the eye sweeps sideways.
//!
//! Content at the depth of focus appears as upright lines, other content as inclined lines. If a hologram has lost its
//! parallax, the lines break.

use crate::optics::Pupil;

/// Number of positions of the sweep.
pub(crate) const POSITIONS: usize = 31;

/// Returns pupils of 1/8 of the eyebox from its left edge to its right, focused at `depth`. All lengths are in meters.
pub fn sweep(eyebox: f64, depth: f64) -> Vec<Pupil> {
    let diameter = eyebox / 8.0;
    let reach = (eyebox - diameter) / 2.0;
    let x = |i: usize| reach * (2.0 * i as f64 / (POSITIONS - 1) as f64 - 1.0);
    (0..POSITIONS).map(|i| Pupil { x: x(i), y: 0.0, diameter, depth }).collect()
}

/// Finds the row whose slice changes most between the positions. The measure is the variance over the positions, summed
/// along the row.
#[derive(Debug, Clone)]
pub struct RowFinder {
    width: usize,
    sum: Vec<f64>,
    squares: Vec<f64>,
    count: usize,
}

impl RowFinder {
    /// Creates a finder for target images of `height` x `width`.
    pub fn new(height: usize, width: usize) -> Self {
        Self { width, sum: vec![0.0; height * width], squares: vec![0.0; height * width], count: 0 }
    }

    /// Adds the target image of one more position.
    ///
    /// # Panics
    /// Panics if the image has another size, which is a mistake of the caller.
    pub fn add(&mut self, photograph: &[f32]) {
        assert_eq!(photograph.len(), self.sum.len(), "all target images have one size");
        for ((sum, square), &v) in self.sum.iter_mut().zip(&mut self.squares).zip(photograph) {
            *sum += f64::from(v);
            *square += f64::from(v).powi(2);
        }
        self.count += 1;
    }

    /// Returns the row with the largest change, or the first row if there is no change.
    pub fn row(&self) -> usize {
        let n = self.count.max(1) as f64;
        let variance = |(s, q): (&f64, &f64)| (q / n - (s / n).powi(2)).max(0.0);
        let rows = self.sum.chunks_exact(self.width).zip(self.squares.chunks_exact(self.width));
        let told: Vec<f64> = rows.map(|(s, q)| s.iter().zip(q).map(variance).sum()).collect();
        (0..told.len()).rev().max_by(|&i, &j| told[i].total_cmp(&told[j])).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sweep_touches_both_edges() {
        let pupils = sweep(22e-3, 1e-3);
        assert_eq!(pupils.len(), 31);
        let edge = |p: &Pupil| p.x.abs() + p.diameter / 2.0;
        assert!((edge(&pupils[0]) - 11e-3).abs() < 1e-12 && (edge(&pupils[30]) - 11e-3).abs() < 1e-12);
        assert!(pupils[15].x.abs() < 1e-15 && pupils.iter().all(|p| p.y == 0.0 && p.depth == 1e-3));
    }

    #[test]
    fn the_row_that_moves_is_found() {
        let mut finder = RowFinder::new(5, 8);
        for place in 0..8 {
            // Row 1 is bright but static. In row 3 something moves.
            let mut image = vec![0.0; 40];
            image[8..16].fill(9.0);
            image[24 + place] = 1.0;
            finder.add(&image);
        }
        assert_eq!(finder.row(), 3);
        assert_eq!(RowFinder::new(3, 3).row(), 0);
    }
}
