//! Follows the rays of a row of pixels through a view, together and from near to far.
//!
//! Each ray ends at the first surface that the view saw. At one disparity, all pixels of a row correspond to
//! neighboring pixels of the view. A run of its disparities is therefore compared with two bounds, many pixels at once.

use eyebox_kernels::simd;

/// The step of a ray that meets nothing.
pub(crate) const NONE: u16 = u16::MAX;
/// The largest number of steps along a ray.
pub(crate) const MOST_STEPS: f32 = 65_000.0;
/// Steps after which rays that all ended are detected.
const ROUND: usize = 16;

/// The position of rays at a step relative to their pixels, and the disparities that they meet there.
#[derive(Clone, Copy)]
struct Along {
    step: u16,
    /// Rows of the view from the pixel to the ray. `right` has its columns.
    down: i32,
    right: i32,
    /// The smallest disparity that is met, and the size of the range above it, in stored values.
    least: u16,
    span: u16,
}

/// The path of rays through a view.
pub(crate) struct RayDirection {
    /// Columns and rows of the view per pixel of disparity.
    pub away: [f32; 2],
    /// The disparities of the stored values 0 and 65535.
    pub range: [f32; 2],
    /// The difference of disparity from one step to the next.
    pub step: f32,
    /// The number of steps after the first one, which is at the largest disparity.
    pub count: usize,
    /// The largest difference by which a disparity may exceed a step's and still be met there.
    pub met: f32,
}

/// Rays through a view, step by step.
pub(crate) struct Rays {
    /// The position of each step as rows and columns from a ray's pixel.
    places: Vec<[i32; 2]>,
    /// The steps at which something can be met.
    along: Vec<Along>,
}

impl Rays {
    pub fn new(way: &RayDirection) -> Self {
        let [low, high] = way.range.map(f64::from);
        let unit = if high > low { 65535.0 / (high - low) } else { 0.0 };
        let at = |k: usize| high - k as f64 * f64::from(way.step);
        let place = |k| way.away.map(|a| (at(k) * f64::from(a) + 0.5).floor().clamp(-1e9, 1e9) as i32);
        let places: Vec<[i32; 2]> = (0..=way.count).map(place).map(|[right, down]| [down, right]).collect();
        let one = |(k, &[down, right]): (usize, &[i32; 2])| {
            // Each surface between the previous and the next step is met at one of the steps at least.
            let least_met = ((at(k) - 0.5 * f64::from(way.step) - low) * unit).ceil().max(0.0);
            let most =
                if unit > 0.0 { ((at(k) + f64::from(way.met) - low) * unit).floor().min(65535.0) } else { 65535.0 };
            let [step, least, span] = [k as f64, least_met, most - least_met].map(|v| v as u16);
            (least_met <= most).then_some(Along { step, down, right, least, span })
        };
        let along = places.iter().enumerate().filter_map(one).collect();
        Self { places, along }
    }

    /// Returns the rows and columns from a pixel to the position of its ray at a step.
    pub fn place(&self, step: u16) -> [i32; 2] {
        self.places[usize::from(step)]
    }

    /// Finds the step at which the ray of each pixel of row `y` meets a surface, or [`NONE`]. `view` has (row, column)
    /// of `size`.
    pub fn follow(&self, view: &[u16], [height, width]: [usize; 2], y: usize, met: &mut [u16]) {
        met.fill(NONE);
        simd(
            #[inline(always)]
            || {
                for round in self.along.chunks(ROUND) {
                    for along in round {
                        let row = y as i64 + i64::from(along.down);
                        let from = (-along.right).clamp(0, width as i32) as usize;
                        let to = (width as i64 - i64::from(along.right)).clamp(0, width as i64) as usize;
                        if row < 0 || row >= height as i64 || from >= to {
                            continue;
                        }
                        let first = row as usize * width + (from as i64 + i64::from(along.right)) as usize;
                        let line = &view[first..][..to - from];
                        for (met, seen) in met[from..to].iter_mut().zip(line) {
                            let here = if seen.wrapping_sub(along.least) <= along.span { along.step } else { NONE };
                            *met = (*met).min(here);
                        }
                    }
                    if met.iter().fold(0, |most, met| most.max(*met)) < NONE {
                        break;
                    }
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The reference goes ray by ray and step by step. It takes the first step at which the view's surface is
        /// neither behind the ray nor too far in front of it.
        #[test]
        fn a_row_is_its_rays(h in 1usize..6, w in 1usize..70, u in -1.5f32..1.5, v in -1.5f32..1.5, low in -9.0f32..9.0, span in 0.0f32..20.0, step in 0.1f32..2.0, met in 0.3f32..3.0, seed in 0u32..1000) {
            let view: Vec<u16> = (0..h * w).map(|i| ((i as u32 / 5 + seed).wrapping_mul(2_654_435_761) >> 16) as u16).collect();
            let count = (span / step).ceil() as usize;
            let way = RayDirection { away: [u, v], range: [low, low + span], step, count, met };
            let (rays, mut got) = (Rays::new(&way), vec![0; w]);
            let unit = f64::from(low + span - low) / 65535.0;
            for y in 0..h {
                rays.follow(&view, [h, w], y, &mut got);
                for (x, got) in got.iter().enumerate() {
                    let want = (0..=count).find(|k| {
                        let at = f64::from(low + span) - *k as f64 * f64::from(step);
                        let place = |from: usize, by: f32| from as i64 + (at * f64::from(by) + 0.5).floor() as i64;
                        let (i, j) = (place(x, u), place(y, v));
                        if i < 0 || j < 0 || i >= w as i64 || j >= h as i64 {
                            return false;
                        }
                        let before = f64::from(low) + unit * f64::from(view[j as usize * w + i as usize]) - at;
                        before >= -0.5 * f64::from(step) && before <= f64::from(met)
                    });
                    prop_assert_eq!(*got, want.map_or(NONE, |k| k as u16), "({}, {})", x, y);
                    if let Some(k) = want {
                        let at = f64::from(low + span) - k as f64 * f64::from(step);
                        prop_assert_eq!(rays.place(k as u16)[1], (at * f64::from(u) + 0.5).floor() as i32);
                    }
                }
            }
        }
    }
}
