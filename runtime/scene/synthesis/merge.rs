//! Reduces the number of views by merging similar neighbors and removing views that no pupil reaches.

use crate::{LightField, ViewGrid};
use eyebox_optics::{Color, Display};
use rayon::prelude::*;

impl LightField {
    /// Returns the positions of the views on `display`.
    pub fn view_grid(&self, display: &Display) -> ViewGrid {
        ViewGrid { rows: self.grid[0], columns: self.grid[1], cell: self.cell(display) }
    }

    /// Returns the numbers of views along an axis that can become one. They are the divisors, above 1, of both sides of
    /// the grid without the `outer` rows and columns on each side, with the largest first.
    pub fn mergeable_without(&self, outer: [usize; 2]) -> Vec<usize> {
        let [rows, columns] = [0, 1].map(|i| self.grid[i] - 2 * outer[i]);
        (2..=rows.min(columns)).rev().filter(|k| rows.is_multiple_of(*k) && columns.is_multiple_of(*k)).collect()
    }

    /// Merges each block of `count` x `count` views into one view in the middle of the block. It is their mean, after
    /// content at `depth` (meters) has been aligned. The result is exact for content at that depth and an eye that
    /// focuses there. At other depths, the content of a view moves by `(z - depth) q / f` within a block (OPTICS 3).
    ///
    /// `count` must divide both sides of the grid ([`mergeable_without`](Self::mergeable_without)).
    pub fn merged(&self, display: &Display, count: usize, depth: f64) -> Self {
        let grid = self.view_grid(display);
        let [rows, columns] = self.grid.map(|n| n / count.max(1));
        // Content at `depth` is moved by -(depth / f) q, and moving view q by (depth / f) (q - middle) cancels this.
        let pixels = depth / (display.focal_length * display.picture_pixel());
        let block = |views: &[Vec<f32>], r: usize, c: usize| {
            let members = (0..count * count).map(|i| (r * count + i / count) * self.grid[1] + c * count + i % count);
            let members: Vec<usize> = members.collect();
            let share = 1.0 / members.len() as f64;
            let (mut x, mut y) = (0.0, 0.0);
            for &view in &members {
                let (vx, vy) = grid.position(view);
                (x, y) = (x + vx * share, y + vy * share);
            }
            let mut sum = vec![0.0f32; self.height * self.width];
            for &view in &members {
                let (vx, vy) = grid.position(view);
                let moves = [(vy - y) * pixels, (vx - x) * pixels];
                add_moved(&views[view], [self.height, self.width], moves, share as f32, &mut sum);
            }
            sum
        };
        let planes = self
            .planes
            .iter()
            .map(|views| (0..rows * columns).into_par_iter().map(|i| block(views, i / columns, i % columns)).collect());
        Self {
            name: self.name.clone(),
            grid: [rows, columns],
            colors: self.colors.clone(),
            planes: planes.collect(),
            view_pitch: Some(grid.cell * count as f64),
            disparity: self.disparity.map(|d| d.map(|v| v * count as f64)),
            ..*self
        }
    }

    /// Returns the rows and columns of views, on each side, whose cells are completely outside the square of side
    /// `eyebox` (meters) around the axis. No pupil within the square sees them. At least one view always remains.
    pub fn unseen(&self, display: &Display, eyebox: f64) -> [usize; 2] {
        let cell = self.cell(display);
        self.grid.map(|n| {
            // The inner edge of the k-th cell from outside is (n/2 - k - 1) cells from the axis.
            let outside = |k: usize| (n as f64 / 2.0 - k as f64 - 1.0) * cell >= eyebox / 2.0 * (1.0 - 1e-9);
            (0..(n - 1) / 2).take_while(|k| outside(*k)).count()
        })
    }

    /// Removes the `outer` rows and columns of views on each side.
    pub fn without_outer(self, display: &Display, outer: [usize; 2]) -> Self {
        if outer == [0, 0] {
            return self;
        }
        Self { view_pitch: Some(self.cell(display)), ..self }.inner(outer)
    }

    /// Returns a copy with this color alone.
    pub fn only(&self, color: Color) -> Self {
        let its = self.colors.iter().zip(&self.planes).filter(|(c, _)| **c == color);
        Self { name: self.name.clone(), colors: vec![color], planes: its.map(|(_, p)| p.clone()).collect(), ..*self }
    }

    /// Keeps only these of its colors, in its own order.
    pub fn with_colors(self, colors: &[Color]) -> Self {
        let pairs = self.colors.into_iter().zip(self.planes).filter(|(color, _)| colors.contains(color));
        let (colors, planes) = pairs.unzip();
        Self { colors, planes, ..self }
    }
}

/// Adds `weight` times the view, with its content moved down and right by these pixels. The movement is bilinear and
/// periodic, as in a target image.
fn add_moved(view: &[f32], [height, width]: [usize; 2], [down, right]: [f64; 2], weight: f32, sum: &mut [f32]) {
    let split = |moved: f64, n: usize| {
        let whole = moved.floor();
        ((n as f64 - whole).rem_euclid(n as f64) as usize % n, (moved - whole) as f32)
    };
    let ((from_row, fy), (from_column, fx)) = (split(down, height), split(right, width));
    for (y, out) in sum.chunks_exact_mut(width).enumerate() {
        let row = |r: usize| &view[r % height * width..][..width];
        let (here, above) = (row(y + from_row), row(y + from_row + height - 1));
        for (x, out) in out.iter_mut().enumerate() {
            let (c, left) = ((x + from_column) % width, (x + from_column + width - 1) % width);
            let at = |line: &[f32]| (1.0 - fx) * line[c] + fx * line[left];
            *out += weight * ((1.0 - fy) * at(here) + fy * at(above));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Request, load};
    use eyebox_optics::Color;

    fn plane(mm: f64) -> (LightField, Display) {
        let display = Display { height: 96, width: 120, ..Display::preset("small").unwrap() };
        let source = format!("builtin:plane?depth={mm}");
        let field = load(&source, &Request::new(&display, &[Color::Green, Color::Blue])).unwrap();
        (field, display)
    }

    /// Returns the accuracy in dB of the brightest value.
    fn likeness(one: &[f32], other: &[f32]) -> f64 {
        let peak = f64::from(one.iter().copied().fold(0.0, f32::max));
        let error = one.iter().zip(other).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / one.len() as f64;
        -10.0 * (error / (peak * peak)).log10()
    }

    #[test]
    fn a_plane_in_the_display_is_one_view() {
        let (field, display) = plane(0.0);
        assert_eq!(field.mergeable_without([0, 0]), [9, 3]);
        let one = field.merged(&display, 9, 0.0);
        assert_eq!((one.grid, one.planes.len(), one.planes[0].len()), ([1, 1], 2, 1));
        assert!((one.cell(&display) - display.eyebox_min()).abs() < 1e-12, "the cell is the whole eyebox");
        assert!(likeness(&field.planes[1][40], &one.planes[1][0]) > 100.0);
    }

    /// At its own depth a plane is aligned with itself, for either sign. At any other depth it is blurred.
    #[test]
    fn a_plane_elsewhere_is_one_view_at_its_depth_alone() {
        // At this depth neighboring views differ by whole pixels, so that nothing is interpolated.
        for disparity in [-1.0, 1.0] {
            let (_, display) = plane(0.0);
            let depth = disparity * display.focal_length * display.pitch / (display.eyebox_min() / 9.0);
            let (field, display) = plane(depth * 1e3);
            let right = likeness(&field.planes[0][40], &field.merged(&display, 9, depth).planes[0][0]);
            let wrong = likeness(&field.planes[0][40], &field.merged(&display, 9, -depth).planes[0][0]);
            assert!(right > 30.0 && wrong < right - 10.0, "{right} dB and {wrong} dB");
        }
    }

    #[test]
    fn blocks_stand_in_their_middle() {
        let (field, display) = plane(0.0);
        let nine = field.merged(&display, 3, 0.0);
        let (all, few) = (field.view_grid(&display), nine.view_grid(&display));
        for (block, middle) in [(0, 10), (4, 40), (8, 70)] {
            let ((x, y), (u, v)) = (few.position(block), all.position(middle));
            assert!((x - u).abs() < 1e-12 && (y - v).abs() < 1e-12);
        }
    }

    #[test]
    fn views_that_no_pupil_reaches_are_left_out() {
        let (field, display) = plane(0.0);
        assert_eq!(field.unseen(&display, display.eyebox_min()), [0, 0]);
        // With twice the pitch, the grid spans twice the eyebox, and 5 of 9 views touch it.
        let wide = LightField { view_pitch: Some(2.0 * field.cell(&display)), ..field };
        assert_eq!(wide.unseen(&display, display.eyebox_min()), [2, 2]);
        let (middle, cell) = (wide.planes[0][40].clone(), wide.cell(&display));
        let inner = wide.without_outer(&display, [2, 2]);
        assert_eq!((inner.grid, inner.planes[0].len()), ([5, 5], 25));
        assert!(inner.planes[0][12] == middle && inner.cell(&display) == cell);
        let blue = inner.with_colors(&[Color::Blue]);
        assert_eq!((blue.colors.len(), blue.planes.len()), (1, 1));
    }
}
