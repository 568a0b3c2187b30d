//! Fewer views where fewer do: neighbors that show the same become one, and views that no pupil reaches are left out.

use crate::{LightField, ViewGrid};
use eyebox_optics::{Color, Display};
use rayon::prelude::*;

impl LightField {
    /// Where the views stand when shown on `display`.
    pub fn view_grid(&self, display: &Display) -> ViewGrid {
        ViewGrid { rows: self.grid[0], columns: self.grid[1], cell: self.cell(display) }
    }

    /// How many views along an axis can become one: the divisors, above 1, of both sides of the grid without so many outer
    /// rows and columns on each side, largest first.
    pub fn mergeable_without(&self, outer: [usize; 2]) -> Vec<usize> {
        let [rows, columns] = [0, 1].map(|i| self.grid[i] - 2 * outer[i]);
        (2..=rows.min(columns)).rev().filter(|k| rows.is_multiple_of(*k) && columns.is_multiple_of(*k)).collect()
    }

    /// The light field in which each block of `count` x `count` views has become one, in the middle of the block: their
    /// mean, after content at `depth` (meters) has been laid upon itself. Exact for content at that depth seen by an eye
    /// that focuses there; off it, what a view shows moves by `(z - depth) q / f` within a block (OPTICS 3).
    ///
    /// `count` must divide both sides of the grid ([`mergeable_without`](Self::mergeable_without)).
    pub fn merged(&self, display: &Display, count: usize, depth: f64) -> Self {
        let grid = self.view_grid(display);
        let [rows, columns] = self.grid.map(|n| n / count.max(1));
        // Content at `depth` stands moved by -(depth / f) q: moving view q by (depth / f) (q - middle) undoes it.
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

    /// Rows and columns of views, on each side, whose cells lie wholly outside the square of side `eyebox` (meters)
    /// around the axis: no pupil that stays in it sees them. One view is always left.
    pub fn unseen(&self, display: &Display, eyebox: f64) -> [usize; 2] {
        let cell = self.cell(display);
        self.grid.map(|n| {
            // The inner edge of the k-th cell from outside lies at (n/2 - k - 1) cells from the axis.
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

    /// A copy in this color alone.
    pub fn only(&self, color: Color) -> Self {
        let its = self.colors.iter().zip(&self.planes).filter(|(c, _)| **c == color);
        Self { name: self.name.clone(), colors: vec![color], planes: its.map(|(_, p)| p.clone()).collect(), ..*self }
    }

    /// With these of its colors, in its order.
    pub fn with_colors(self, colors: &[Color]) -> Self {
        let pairs = self.colors.into_iter().zip(self.planes).filter(|(color, _)| colors.contains(color));
        let (colors, planes) = pairs.unzip();
        Self { colors, planes, ..self }
    }
}

/// Adds `weight` times the view, its content moved down and right by so many pixels, bilinear and periodic: as the
/// photograph moves it.
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

    /// dB, of the brightest value.
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

    /// At its own depth a plane is laid upon itself, whatever the sign; at any other it is smeared.
    #[test]
    fn a_plane_elsewhere_is_one_view_at_its_depth_alone() {
        // A depth at which neighboring views differ by whole pixels: nothing is interpolated.
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
        // With twice the pitch the grid spans twice the eyebox: of 9 views 5 touch it.
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
