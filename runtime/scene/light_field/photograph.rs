//! Selects the views that a pupil covers, and the shift of each (OPTICS 3).

use eyebox_kernels::photograph::Tap;
use eyebox_optics::{Geometry, Optics, Pupil};

/// The positions of the views in the pupil plane, as square cells around a common center.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewGrid {
    /// Number of rows of views.
    pub rows: usize,
    /// Number of columns of views.
    pub columns: usize,
    /// Side of a cell (the view pitch) in meters.
    pub cell: f64,
}

impl ViewGrid {
    /// Returns the position (x, y) of view `index` (row-major) in meters.
    pub fn position(&self, index: usize) -> (f64, f64) {
        let (r, c) = (index / self.columns, index % self.columns);
        (
            (c as f64 - (self.columns - 1) as f64 / 2.0) * self.cell,
            (r as f64 - (self.rows - 1) as f64 / 2.0) * self.cell,
        )
    }

    /// Returns the share of the pupil's light per view, row-major, with a sum of one. It is the area of the disc in the
    /// view's cell. A pupil that covers no cell takes the nearest view.
    pub fn coverage(&self, pupil: &Pupil) -> Vec<(usize, f64)> {
        self.covered(pupil).collect()
    }

    /// Returns the same shares, view by view.
    fn covered(self, pupil: &Pupil) -> impl Iterator<Item = (usize, f64)> + use<> {
        let (pupil, r, half) = (*pupil, pupil.diameter / 2.0, self.cell / 2.0);
        let views = 0..self.rows * self.columns;
        let place = move |index| {
            let (x, y) = self.position(index);
            (x - pupil.x, y - pupil.y)
        };
        let area = move |index| {
            let (x, y) = place(index);
            disc_in_rectangle(r, [x - half, x + half], [y - half, y + half])
        };
        let sum: f64 = views.clone().map(area).sum();
        let covers = sum.is_normal();
        let share = move |index| Some((index, area(index) / sum)).filter(|(_, share)| *share > 0.0);
        let distance = move |index: &usize| place(*index).0.powi(2) + place(*index).1.powi(2);
        let nearest = views.clone().min_by(|a, b| distance(a).total_cmp(&distance(b))).filter(|_| !covers);
        let covered = if covers { views } else { 0..0 };
        covered.filter_map(share).chain(nearest.map(|index| (index, 1.0)))
    }

    /// Returns the tap of one view without a shift, on a level of (height, width) samples of the grid of `optics`.
    pub fn only(&self, optics: &Optics, view: usize, height: usize, width: usize) -> Tap {
        let (axis_y, axis_x) = axis(optics, height, width);
        let (dy, fy) = split(-axis_y, height);
        let (dx, fx) = split(-axis_x, width);
        Tap { view: view as u32, weight: 1.0, dy, dx, fy, fx }
    }

    /// Returns the taps of the target image through `pupil` on a level of (height, width) samples of the grid of
    /// `optics`. View v moves by `(z / f) q_v`, periodically on the grid. In the far field the axis comes first, as in
    /// the transform of a spectral window. The common center of the views is at `center` (x, y) of the pupil plane, and
    /// the picture is `displaced` by (x, y), both in meters.
    pub fn taps_around(
        self,
        center: [f64; 2],
        displaced: [f64; 2],
        optics: &Optics,
        pupil: &Pupil,
        height: usize,
        width: usize,
    ) -> impl Iterator<Item = Tap> + use<> {
        let near = Pupil { x: pupil.x - center[0], y: pupil.y - center[1], ..*pupil };
        let metres = pupil.depth / optics.focal_length;
        let (high, wide) = optics.field_of_view();
        let (per_row, per_column) = (height as f64 / high, width as f64 / wide);
        let (axis_y, axis_x) = axis(optics, height, width);
        let tap = move |(index, weight): (usize, f64)| {
            let (x, y) = self.position(index);
            let (x, y) = (x + center[0], y + center[1]);
            let (dy, fy) = split((metres * y + displaced[1]) * per_row - axis_y, height);
            let (dx, fx) = split((metres * x + displaced[0]) * per_column - axis_x, width);
            Tap { view: index as u32, weight: weight as f32, dy, dx, fy, fx }
        };
        self.covered(&near).map(tap)
    }
}

/// Returns the samples from the first one of a level to the axis of the image. The transform of a far-field window
/// begins at the axis.
fn axis(optics: &Optics, height: usize, width: usize) -> (f64, f64) {
    match optics.geometry {
        Geometry::Relay => (0.0, 0.0),
        Geometry::FarField => {
            let (rows, columns) = optics.image_size();
            let at = |n: usize, samples: usize| (n / 2) as f64 * samples as f64 / n as f64;
            (at(rows, height), at(columns, width))
        }
    }
}

/// Splits a movement on a period of `n` into whole samples and the rest.
fn split(shift: f64, n: usize) -> (u32, f32) {
    // Beyond this limit, a float64 has no fractional part, and beyond its range there is no shift.
    let shift = shift.clamp(-1e15, 1e15);
    let whole = shift.floor();
    ((whole.rem_euclid(n as f64) as usize % n) as u32, (shift - whole) as f32)
}

/// Returns the exact area of the disc of radius `r` around the origin inside a rectangle. It integrates the height
/// between the points at which the circle crosses the sides of the rectangle.
fn disc_in_rectangle(r: f64, x: [f64; 2], y: [f64; 2]) -> f64 {
    let (low, high) = (x[0].max(-r), x[1].min(r));
    if low >= high || y[0] >= r || y[1] <= -r {
        return 0.0;
    }
    // The pieces end at the ends of the interval, and at the crossings between them.
    let mut ends = [low, high, high, high, high, high];
    let mut count = 2;
    for side in y {
        if side.abs() < r {
            let crossing = ((r - side) * (r + side)).sqrt();
            for at in [-crossing, crossing].into_iter().filter(|c| (low..high).contains(c)) {
                ends[count] = at;
                count += 1;
            }
        }
    }
    let ends = &mut ends[..count];
    ends.sort_unstable_by(f64::total_cmp);
    let circle = |x: f64| ((r - x) * (r + x)).max(0.0).sqrt();
    let primitive = |x: f64| 0.5 * (x * circle(x) + r * r * (x / r).clamp(-1.0, 1.0).asin());
    let piece = |a: f64, b: f64| {
        let s = circle(0.5 * (a + b));
        let arc = primitive(b) - primitive(a);
        let top = if s < y[1] { arc } else { y[1] * (b - a) };
        let bottom = if -s > y[0] { -arc } else { y[0] * (b - a) };
        (top - bottom).max(0.0)
    };
    ends.windows(2).map(|e| piece(e[0], e[1])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    proptest! {
        #[test]
        fn area_against_counting(r in 0.1..3.0f64, x in -3.0..3.0f64, y in -3.0..3.0f64, side in 0.1..4.0f64) {
            let (xs, ys) = ([x, x + side], [y, y + side]);
            let n = 300;
            let at = |i: usize, from: f64| from + (i as f64 + 0.5) / n as f64 * side;
            let inside = (0..n * n).filter(|i| at(i % n, x).powi(2) + at(i / n, y).powi(2) < r * r).count();
            let counted = inside as f64 * (side / n as f64).powi(2);
            let area = disc_in_rectangle(r, xs, ys);
            prop_assert!((area - counted).abs() < 0.01 * side * (side + r), "{} {}", area, counted);
        }

        #[test]
        fn cells_share_the_disc(x in -8.0..8.0f64, y in -8.0..8.0f64, d in 0.01..6.0f64) {
            let grid = ViewGrid { rows: 9, columns: 9, cell: 22e-3 / 9.0 };
            let pupil = Pupil::from_mm([x, y, d, 0.0]);
            let half = grid.cell / 2.0;
            let area: f64 = (0..81).map(|i| { let (qx, qy) = grid.position(i); disc_in_rectangle(d * 0.5e-3, [qx - half - pupil.x, qx + half - pupil.x], [qy - half - pupil.y, qy + half - pupil.y]) }).sum();
            prop_assert!((area / (PI * (d * 0.5e-3).powi(2)) - 1.0).abs() < 1e-9);
            prop_assert!((grid.coverage(&pupil).iter().map(|c| c.1).sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn beyond_the_views_the_nearest_one_is_seen() {
        let grid = ViewGrid { rows: 3, columns: 5, cell: 1e-3 };
        assert_eq!(grid.coverage(&Pupil::from_mm([9.0, -9.0, 1.0, 0.0])), [(4, 1.0)]);
    }

    #[test]
    fn shifts_follow_the_sign_of_the_optics() {
        // With (z / f) q, a view to the right that is focused behind moves right by z x / (f p) pixels.
        let optics = Optics::new(20, 30, 8e-6, 520e-9, 0.4).unwrap();
        let grid = ViewGrid { rows: 1, columns: 3, cell: 2e-3 };
        let pupil = Pupil::from_mm([0.0, 0.0, 30.0, 4.0]);
        let taps: Vec<Tap> = grid.taps_around([0.0; 2], [0.0; 2], &optics, &pupil, 20, 30).collect();
        let moves: Vec<f64> = taps.iter().map(|t| f64::from(t.dx) + f64::from(t.fx)).collect();
        assert!((moves[2] - 2.5).abs() < 1e-6 && (moves[0] - 27.5).abs() < 1e-6, "{moves:?}");
        assert!(taps.iter().all(|t| t.dy == 0 && t.fy == 0.0));
    }
}
