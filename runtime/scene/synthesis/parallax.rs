//! Measures the order of the views of a grid from the movement and the occlusion of content.
//!
//! The measurement gives the axis of the picture along which content moves from column to column and from row to row.
//! It also shows whether both agree, and which content covers which. Columns of views follow +x and rows +y, and near
//! content covers far content (OPTICS 3). Transposed views move along the other axis. One reversed axis makes rows and
//! columns contradict each other. Two reversed axes exchange near and far, which only occlusion shows.

use crate::depth::central::view_disparities;
use crate::depth::sweep::Compared;
use crate::light_field::resize::{Fit, Resize};
use crate::{LightField, ViewGrid};
use rayon::prelude::*;

/// Pixels along the longer side of the first, small copies, and of the largest ones.
const SMALL: usize = 96;
const LARGE: usize = 384;
/// Largest movement of content between the compared views, as a share of the longer side.
const REACH: f64 = 0.125;
/// Candidates of movement per pixel.
const FINE: usize = 2;
/// Larger differences than this (square root of light, of the brightest) are occlusions.
const OUTLIER: f32 = 0.25;
/// Rounding error of 8 bits, in square root of light. Views that differ by less show nothing.
const ROUNDED: f32 = 5e-4;
/// Movement in pixels below which farther views are compared.
const STILL_BELOW_PX: f64 = 2.5;

/// Small copies of the views of the central row and column, in square root of light, of the brightest.
struct Small {
    size: [usize; 2],
    center: Vec<f32>,
    /// The views with their steps from the central view, along the grid's columns and then along its rows.
    arms: [Vec<(isize, Vec<f32>)>; 2],
    /// Pixels of the light field per pixel of these copies.
    scale: f64,
}

/// The order that the views show.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Parallax {
    /// True if content moves along the other axis of the picture than it should. It is `None` if nothing moves.
    pub transposed: Option<bool>,
    /// True if columns and rows contradict each other, so that one of them runs backwards. It is `None` if the views do
    /// not show it.
    pub disagree: Option<bool>,
    /// True if content that moves like near content covers the other. This holds after the views are no longer
    /// transposed and, if columns and rows disagree, the named rows are reversed. It is `None` if nothing shows it.
    pub near_covers: Option<bool>,
    /// The number of places in which content that moves like near content covers, and the number of all places in which
    /// one surface visibly comes to cover another.
    pub covers: [usize; 2],
    /// Smallest and largest movement from column to column and from row to row, in pixels of the light field. Each is
    /// measured by itself and positive in the direction of near content. It is `None` along an axis of one view.
    pub movement: [Option<[f64; 2]>; 2],
    /// Difference of views in which content may move, as a share of the difference without movement. The four values
    /// are for columns and rows as they are, with reversed rows, and both of these transposed.
    pub apart: [f64; 4],
}

/// Costs of movements, (candidate, pixel), as means over a small window.
type Volume = Vec<Vec<f32>>;

impl Small {
    fn new(field: &LightField, longest: usize) -> Self {
        let [rows, columns] = field.grid;
        let (h, w) = (field.height, field.width);
        let times = (h.max(w) as f64 / longest as f64).max(1.0);
        let size = [h, w].map(|n| ((n as f64 / times).round() as usize).max(1));
        let resize = Resize::new([h, w], size, Fit::Stretch);
        let all = |index: usize| {
            let mut sum = vec![0.0f32; size[0] * size[1]];
            for plane in &field.planes {
                sum.iter_mut().zip(resize.apply(&plane[index])).for_each(|(s, v)| *s += v);
            }
            sum
        };
        let (r, c) = (rows / 2, columns / 2);
        let center = all(r * columns + c);
        let brightest = center.iter().copied().fold(0.0, f32::max).max(1e-12);
        let root = |view: Vec<f32>| view.into_iter().map(|v| (v / brightest).max(0.0).sqrt()).collect::<Vec<f32>>();
        let along = |n: usize, at: usize, index: &(dyn Fn(usize) -> usize + Sync)| {
            let others: Vec<usize> = (0..n).filter(|i| *i != at).collect();
            others.into_par_iter().map(|i| (i as isize - at as isize, root(all(index(i))))).collect::<Vec<_>>()
        };
        let arms = [along(columns, c, &|i| r * columns + i), along(rows, r, &|i| i * columns + c)];
        let mut small = Self { size, center: root(center), arms, scale: times };
        small.crop();
        small
    }

    /// Removes the margins without light, because their still content would cover all content that moves under it.
    fn crop(&mut self) {
        let [h, w] = self.size;
        let lit = |i: usize| {
            let others = self.arms.iter().flatten().map(|(_, v)| v[i]);
            others.fold(self.center[i], f32::max) > 0.02
        };
        let rows: Vec<usize> = (0..h).filter(|y| (0..w).any(|x| lit(y * w + x))).collect();
        let columns: Vec<usize> = (0..w).filter(|x| (0..h).any(|y| lit(y * w + x))).collect();
        let inner = |lit: &[usize], n: usize| {
            let (first, last) = (lit.first().copied().unwrap_or(0), lit.last().map_or(0, |l| l + 1));
            // The resampling mixes margins into the picture.
            let first = if first > 0 { first + 2 } else { 0 };
            first..(if last < n { last.saturating_sub(2) } else { n }).max(first)
        };
        let (rows, columns) = (inner(&rows, h), inner(&columns, w));
        let cut = |view: &[f32]| rows.clone().flat_map(|y| view[y * w..][columns.clone()].iter().copied()).collect();
        self.center = cut(&self.center);
        for (_, view) in self.arms.iter_mut().flatten() {
            *view = cut(view);
        }
        self.size = [rows.len(), columns.len()];
    }

    /// Returns the largest number of steps of a view from the center, along both axes of the grid.
    fn steps(&self) -> usize {
        self.arms.iter().flatten().map(|(d, _)| d.unsigned_abs()).max().unwrap_or(0)
    }

    /// Returns the costs of each movement of content between views that are `step` apart along an axis of the grid. The
    /// movement is along the picture's columns (x) or rows, and a movement of m displaces content by -m. The better of
    /// both sides counts, because one side sees the content that the other does not see.
    fn costs(&self, axis: usize, x: bool, step: usize, most: usize) -> Option<Volume> {
        let views: Vec<_> = self.arms[axis].iter().filter(|(d, _)| d.unsigned_abs() == step).collect();
        if views.is_empty() {
            return None;
        }
        let [h, w] = self.size;
        let one = |k: usize| {
            let m = k as f32 / FINE as f32 - most as f32;
            let mut least = vec![OUTLIER; h * w];
            for (d, view) in &views {
                let seen = shifted(view, [h, w], -m * d.signum() as f32, x);
                for ((least, seen), center) in least.iter_mut().zip(seen).zip(&self.center) {
                    *least = least.min((seen - center).abs());
                }
            }
            blur(&blur(&least, h, w, true), h, w, false)
        };
        Some((0..=2 * most * FINE).into_par_iter().map(one).collect())
    }

    /// Returns the change of the picture around each pixel, which makes movements distinguishable.
    fn detail(&self) -> Vec<f32> {
        let [h, w] = self.size;
        let at = |x: usize, y: usize| self.center[y.min(h - 1) * w + x.min(w - 1)];
        let one = |i: usize| {
            let (x, y) = (i % w, i / w);
            // Both directions count together, because an edge along an axis shows no movement along it.
            let across = (at(x + 1, y) - at(x, y)).abs();
            let down = (at(x, y + 1) - at(x, y)).abs();
            across.min(down) + 0.1 * (across + down)
        };
        blur(&blur(&(0..h * w).map(one).collect::<Vec<_>>(), h, w, true), h, w, false)
    }
}

/// Returns the view displaced by `away` pixels along an axis, interpolated between two pixels. Pixels beyond the edge
/// repeat the edge.
fn shifted(view: &[f32], [h, w]: [usize; 2], away: f32, x: bool) -> Vec<f32> {
    let (whole, part) = (away.floor() as i64, away - away.floor());
    let place = |i: usize, n: usize, more: i64| (i as i64 + whole + more).clamp(0, n as i64 - 1) as usize;
    let mut out = Vec::with_capacity(view.len());
    let columns: Vec<(usize, usize)> =
        (0..w).map(|i| if x { (place(i, w, 0), place(i, w, 1)) } else { (i, i) }).collect();
    for j in 0..h {
        let (top, below) = if x { (j, j) } else { (place(j, h, 0), place(j, h, 1)) };
        let (top, below) = (&view[top * w..][..w], &view[below * w..][..w]);
        out.extend(columns.iter().map(|&(i, k)| top[i] + part * (below[k] - top[i])));
    }
    out
}

/// Returns the mean over five neighbors along an axis. Pixels beyond the edge repeat the edge.
fn blur(values: &[f32], h: usize, w: usize, x: bool) -> Vec<f32> {
    let mut out = vec![0.0; values.len()];
    if x {
        for (out, row) in out.chunks_exact_mut(w).zip(values.chunks_exact(w)) {
            let mut sum: f32 = 3.0 * row[0] + row[1.min(w - 1)] + row[2.min(w - 1)];
            for i in 0..w {
                out[i] = 0.2 * sum;
                sum += row[(i + 3).min(w - 1)] - row[i.saturating_sub(2)];
            }
        }
        return out;
    }
    for j in 0..h {
        let out = &mut out[j * w..][..w];
        for k in 0..5 {
            let row = &values[(j + k).saturating_sub(2).min(h - 1) * w..][..w];
            out.iter_mut().zip(row).for_each(|(o, v)| *o += 0.2 * v);
        }
    }
    out
}

/// Returns the best movement of each pixel over both axes of the grid, and its cost. If `turned` is true, the second
/// axis counts with the opposite sign.
fn best(first: Option<&Volume>, second: Option<&Volume>, turned: bool, pixels: usize) -> (Vec<usize>, Vec<f32>) {
    let count = first.or(second).map_or(0, Vec::len);
    let one = |p: usize| {
        let cost = |k: usize| {
            let other = if turned { count - 1 - k } else { k };
            first.map_or(0.0, |v| v[k][p]) + second.map_or(0.0, |v| v[other][p])
        };
        let mut best = (0, f32::INFINITY);
        for k in 0..count {
            let cost = cost(k);
            if cost < best.1 {
                best = (k, cost);
            }
        }
        // If nothing distinguishes movements, there is no movement.
        if cost(count / 2) <= best.1 + 1e-5 { (count / 2, best.1) } else { best }
    };
    (0..pixels).into_par_iter().map(one).unzip()
}

/// The comparison of views that are `step` apart.
struct Look {
    /// Difference of views, as a share of their difference without movement. The values are for columns along x with
    /// rows along y, for the same with reversed rows, and for both of these transposed.
    apart: [f64; 4],
    /// Movement of each pixel in the best order, in pixels of the small picture over `step` views.
    movement: Vec<f32>,
    /// Size of the movement at pixels with detail. Nine tenths move by less.
    moved: f64,
}

impl Look {
    /// Searches movements of at most `most` pixels.
    fn at(small: &Small, step: usize, detail: &[f32], most: usize) -> Option<(Self, [Option<Volume>; 4])> {
        let [h, w] = small.size;
        let [cx, cy, rx, ry] =
            [(0, true), (0, false), (1, true), (1, false)].map(|(a, x)| small.costs(a, x, step, most));
        let ways = [(&cx, &ry, false), (&cx, &ry, true), (&cy, &rx, false), (&cy, &rx, true)];
        let both = cx.is_some() && ry.is_some();
        let sum = |costs: &mut dyn Iterator<Item = f32>| costs.zip(detail).map(|(c, d)| f64::from(c * d)).sum::<f64>();
        let middle = most * FINE;
        let found = ways.map(|(a, b, turned)| (both || !turned).then(|| best(a.as_ref(), b.as_ref(), turned, h * w)));
        let still = sum(&mut (0..h * w).map(|p| [&cx, &ry].into_iter().flatten().map(|v| v[middle][p]).sum()));
        let rounded = f64::from(ROUNDED) * detail.iter().map(|d| f64::from(*d)).sum::<f64>() + 1e-9;
        let apart = std::array::from_fn(|i| match &found[i] {
            Some((_, costs)) => (sum(&mut costs.iter().copied()) + rounded) / (still + rounded),
            None => f64::INFINITY,
        });
        let first = (0..4).min_by(|&a, &b| f64::total_cmp(&apart[a], &apart[b])).unwrap_or(0);
        let movement: Vec<f32> =
            found[first].as_ref()?.0.iter().map(|&k| (k as f32 - middle as f32) / FINE as f32).collect();
        let moved = share(&movement, detail, |m| m.abs(), 0.9);
        Some((Self { apart, movement, moved: f64::from(moved) }, [cx, cy, rx, ry]))
    }
}

/// Returns the value below which this share of the pixels with detail is.
fn share(values: &[f32], detail: &[f32], of: impl Fn(f32) -> f32, share: f64) -> f32 {
    let mean = detail.iter().sum::<f32>() / detail.len().max(1) as f32;
    let mut kept: Vec<f32> = values.iter().zip(detail).filter(|(_, d)| **d > mean).map(|(v, _)| of(*v)).collect();
    kept.sort_by(f32::total_cmp);
    kept.get((share * kept.len() as f64) as usize).copied().unwrap_or(0.0)
}

impl Small {
    /// Returns the number of places in which two surfaces come to cover each other and the one of larger movement is
    /// visible, and the number in which either is visible. A place is a square of [`PLACE`] pixels along one axis of
    /// views, and the majority of its pixels in all views decides. A pixel counts only if `cost`, the cost of a
    /// movement at a pixel, distinguishes its own movement from the other surface's.
    fn covering(
        &self,
        movement: &[f32],
        step: usize,
        transposed: bool,
        turned: bool,
        cost: &dyn Fn(usize, f32) -> f32,
    ) -> [usize; 2] {
        let [h, w] = self.size;
        let across = w.div_ceil(PLACE);
        let mut places = vec![[0.0, 0.0]; 2 * across * h.div_ceil(PLACE)];
        for (axis, arms) in self.arms.iter().enumerate() {
            let x = (axis == 0) != transposed;
            let sign = if axis == 1 && turned { -1.0 } else { 1.0 };
            for (d, view) in arms {
                let times = sign * *d as f32 / step as f32;
                // For each pixel of the view, the candidates of largest and smallest movement.
                let mut claims: Vec<Option<[(f32, f32, usize); 2]>> = vec![None; h * w];
                for (p, (m, light)) in movement.iter().zip(&self.center).enumerate() {
                    let away = -m * times;
                    let (i, j) =
                        ((p % w) as f32 + if x { away } else { 0.0 }, (p / w) as f32 + if x { 0.0 } else { away });
                    let (i, j) = (i.round(), j.round());
                    if i < 0.0 || j < 0.0 || i >= w as f32 || j >= h as f32 {
                        continue;
                    }
                    let claim = (*m, *light, p);
                    let at = &mut claims[j as usize * w + i as usize];
                    *at = Some(match *at {
                        None => [claim, claim],
                        Some([a, b]) => [if claim.0 > a.0 { claim } else { a }, if claim.0 < b.0 { claim } else { b }],
                    });
                }
                for (claims, seen) in claims.iter().zip(view) {
                    let Some([large, small]) = claims else { continue };
                    let light = (large.1 - small.1).abs();
                    if (large.0 - small.0) * times.abs() < 2.0 || light < 0.08 {
                        continue;
                    }
                    let knows = |own: &(f32, f32, usize), other: f32| cost(own.2, other) > cost(own.2, own.0) + KNOWS;
                    if !(knows(large, small.0) && knows(small, large.0)) {
                        continue;
                    }
                    let (a, b) = ((seen - large.1).abs(), (seen - small.1).abs());
                    // A light that is like neither was covered by other content.
                    if a.min(b) < 0.5 * light {
                        // The place is halfway between both positions in the central view, which is the same for either
                        // order.
                        let [x, y] =
                            [large.2 % w + small.2 % w, large.2 / w + small.2 / w].map(|sum| sum / (2 * PLACE));
                        let place = &mut places[(2 * y + axis) * across + x];
                        *place = [place[0] + ((b - a) / light).clamp(-1.0, 1.0), place[1] + 1.0];
                    }
                }
            }
        }
        let clear = places.iter().filter(|[votes, count]| votes.abs() > CLEAR * count);
        clear.fold([0, 0], |[near, all], [votes, _]| [near + usize::from(*votes > 0.0), all + 1])
    }

    /// Returns the movement of each pixel in the found order, sharp at edges.
    fn sharp(&self, step: usize, most: f64, transposed: bool, turned: bool) -> Vec<f32> {
        let there =
            |axis: usize, d: isize| self.arms[axis].iter().find(|(at, _)| *at == d * step as isize).map(|(_, v)| v);
        // A side without views is left out. A copy of the central view instead would show that nothing moves.
        let turn = |axis: usize| if turned && axis == 1 { -1 } else { 1 };
        let side = |axis: usize, d: isize| usize::from(there(axis, d * turn(axis)).is_some());
        let axes = if transposed { [0, 1] } else { [1, 0] };
        let [rows, columns] = axes.map(|axis| side(axis, -1) + 1 + side(axis, 1));
        let [row, column] = axes.map(|axis| side(axis, -1));
        let light = |index: usize| {
            let away = [index / columns, index % columns];
            let [d, e] = [(away[0], row), (away[1], column)].map(|(at, middle)| at as isize - middle as isize);
            let view = match (d, e) {
                (0, 0) => Some(&self.center),
                (d, 0) => there(axes[0], d * turn(axes[0])),
                (_, e) => there(axes[1], e * turn(axes[1])),
            };
            view.unwrap_or(&self.center).iter().map(|v| v * v).collect()
        };
        let (grid, center) = (ViewGrid { rows, columns, cell: 1.0 }, row * columns + column);
        view_disparities(&grid, center, self.size, [-most, most], Compared::Exactly, light)
    }
}

/// Views whose difference with movement does not fall below this share show no movement.
const MOVES: f64 = 0.9;
/// One order must be better than another by at least this factor.
const CLEARLY: f64 = 1.25;
const CLEARLY_REVERSED: f64 = 1.15;
/// Occlusion counts if the number of agreeing places deviates from chance by this number of standard deviations. A fair
/// coin does so, on either side, in one of forty cases. A light field that is refused by such a chance needs one
/// option.
const SIGNIFICANT: f64 = 2.0;
/// Pixels along each side of a place, and the share by which its pixels must agree.
const PLACE: usize = 6;
const CLEAR: f32 = 0.2;
/// A pixel distinguishes its own movement from another one that costs at least this much more.
const KNOWS: f32 = 0.01;

/// Returns true if significantly more than half of `all` places are `near`, and false if significantly fewer are. It
/// returns `None` if chance may explain the number.
fn significant([near, all]: [usize; 2]) -> Option<bool> {
    let beyond = near.abs_diff(all - near).saturating_sub(1) as f64;
    (all > 0 && beyond >= SIGNIFICANT * (all as f64).sqrt()).then_some(2 * near > all)
}

impl Parallax {
    /// Compares the views of the central row and column. It begins with neighbors and takes farther views if too little
    /// moves, then more pixels if still too little moves.
    pub(crate) fn of(field: &LightField) -> Option<Self> {
        let longest = field.height.max(field.width);
        if field.grid == [1, 1] || longest < 16 {
            return None;
        }
        // These are the pixels of the copies, the steps between views, and the largest movement in pixels.
        let (mut pixels, mut step, mut most) = (longest.min(SMALL), 1, None::<f64>);
        // Farther views may exist along one axis only, as in 3 x 9 views. The result of nearer ones for both axes
        // counts then.
        let mut of_both = None;
        loop {
            let small = Small::new(field, pixels);
            if small.size.iter().any(|n| *n < 8) {
                return None;
            }
            let detail = small.detail();
            let usual = (REACH * pixels as f64).max(2.0);
            loop {
                let sought = most.map_or(usual, |m| m.min(usual)).ceil() as usize;
                let (mut look, volumes) = Look::at(&small, step, &detail, sought)?;
                if look.sees_both() {
                    of_both = Some(look.apart);
                } else if let Some(apart) = of_both.filter(|apart| Look::verdict(apart)[1].is_some()) {
                    look.apart = apart;
                }
                let far = f64::from(share(&look.movement, &detail, f32::abs, 0.99));
                let farther =
                    small.steps().min(step * (STILL_BELOW_PX / look.moved.max(0.1)).ceil().clamp(2.0, 8.0) as usize);
                if look.moved < STILL_BELOW_PX && farther > step {
                    most = Some(1.5 * far * farther as f64 / step as f64 + 2.0);
                    step = farther;
                    continue;
                }
                let larger = longest.min(LARGE).min(2 * pixels);
                if look.moved < STILL_BELOW_PX && larger > pixels && look.best_apart() < MOVES {
                    most = Some(1.5 * far * larger as f64 / pixels as f64 + 2.0);
                    pixels = larger;
                    break;
                }
                return Some(look.says(&small, &volumes, &detail, step));
            }
        }
    }
}

impl Look {
    fn best_apart(&self) -> f64 {
        self.apart.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Returns true if views along both axes of the grid were compared.
    fn sees_both(&self) -> bool {
        self.apart.iter().all(|a| a.is_finite())
    }

    /// Returns whether the views are transposed, and whether columns and rows disagree, if that is clear.
    fn verdict(apart: &[f64; 4]) -> [Option<bool>; 2] {
        let [as_named, turned, crossed, both] = *apart;
        let pairs = [as_named.min(turned), crossed.min(both)];
        let clearly = |a: f64, b: f64, times: f64| (a.max(b) >= times * a.min(b)).then_some(b < a);
        let moves = pairs[0].min(pairs[1]) < MOVES;
        let transposed = clearly(pairs[0], pairs[1], CLEARLY).filter(|_| moves);
        let [a, b] = if transposed == Some(true) { [crossed, both] } else { [as_named, turned] };
        [transposed, clearly(a, b, CLEARLY_REVERSED).filter(|_| transposed.is_some() && b.is_finite())]
    }

    fn says(&self, small: &Small, volumes: &[Option<Volume>; 4], detail: &[f32], step: usize) -> Parallax {
        let [transposed, disagree] = Self::verdict(&self.apart);
        let one_axis = !self.sees_both();
        let mut found = Parallax {
            transposed,
            disagree,
            near_covers: None,
            covers: [0, 0],
            movement: [None; 2],
            apart: self.apart,
        };
        let Some(transposed) = transposed else { return found };
        let pixels = small.size[0] * small.size[1];
        let per_view = small.scale / step as f64;
        let middle = |volume: &Volume| (volume.len() / 2) as f32;
        for (axis, volume) in [(0, usize::from(transposed)), (1, 3 - usize::from(transposed))] {
            let Some(volume) = &volumes[volume] else { continue };
            let (at, _) = best(Some(volume), None, false, pixels);
            let moved: Vec<f32> = at.iter().map(|&k| (k as f32 - middle(volume)) / FINE as f32).collect();
            found.movement[axis] = Some([0.02, 0.98].map(|s| f64::from(share(&moved, detail, |m| m, s)) * per_view));
        }
        if disagree.is_some() || one_axis {
            let turned = disagree == Some(true);
            let most = f64::from(share(&self.movement, detail, f32::abs, 0.99)) + 1.0;
            let sharp = small.sharp(step, most, transposed, turned);
            let of_columns = volumes[usize::from(transposed)].as_ref();
            let of_rows = volumes[3 - usize::from(transposed)].as_ref();
            let cost = |p: usize, m: f32| {
                let one = |volume: Option<&Volume>, turned: bool| {
                    let Some(volume) = volume else { return 0.0 };
                    let k = (m * FINE as f32).round() * if turned { -1.0 } else { 1.0 } + middle(volume);
                    volume[(k.max(0.0) as usize).min(volume.len() - 1)][p]
                };
                one(of_columns, false) + one(of_rows, turned)
            };
            found.covers = small.covering(&sharp, step, transposed, turned, &cost);
            found.near_covers = significant(found.covers);
        }
        found
    }
}
