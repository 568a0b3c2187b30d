//! Refines disparities to a small part of a pixel by least squares (Lucas and Kanade, IJCAI 1981).

use crate::depth::sweep::{Arm, Sweep};

/// Number of Gauss-Newton steps.
const STEPS: usize = 3;
/// Largest step in pixels. A longer step shows that the first guess was wrong.
const FAR: f32 = 1.0;
/// A side does not see the content if it differs by more than this factor times the difference of the opposite side.
const HIDDEN: f32 = 2.0;
/// Mean square of the rounding error of 8 bits, in square root of light.
const ROUNDED: f32 = 4e-6;

/// Sums over a window for the views on one side. They are the sums of s g e, of (s g)^2 and of e^2. A view is s steps
/// away, g is its slope and e its difference.
#[derive(Clone, Copy, Default)]
struct Sums {
    turn: f32,
    slope: f32,
    error: f32,
    count: f32,
}

impl Sums {
    fn mean(&self) -> f32 {
        self.error / self.count.max(1.0)
    }

    fn and(self, other: &Self) -> Self {
        Self {
            turn: self.turn + other.turn,
            slope: self.slope + other.slope,
            error: self.error + other.error,
            count: self.count + other.count,
        }
    }
}

/// Views that are softened by a pixel, so that a straight line holds between two pixels.
pub(crate) struct Subpixel(Sweep);

impl Subpixel {
    pub fn of(sweep: &Sweep) -> Self {
        let Sweep { height, width, .. } = *sweep;
        let soft = |view: &[f32]| soften(view, height, width);
        let arms = sweep.arms.each_ref().map(|arm| arm.iter().map(|(r, c, view)| (*r, *c, soft(view))).collect());
        Self(Sweep { height, width, center: soft(&sweep.center), arms })
    }

    /// Returns the disparity of the window of `half` pixels around row and column, in pixels between neighboring views,
    /// and its standard error. It returns `None` if the disparity is not near the guess `d`.
    pub fn refined(&self, [y, x]: [usize; 2], half: usize, d: f64) -> Option<[f64; 2]> {
        let Sweep { height, width, arms, .. } = &self.0;
        if x < half || y < half || x + half >= *width || y + half >= *height {
            return None;
        }
        let mut d = d as f32;
        for step in 0..=STEPS {
            let sides = arms.each_ref().map(|arm| self.sums(arm, [y, x], half, d));
            // Content that one side hides is visible from the opposite side.
            let seen = |pair: [&Sums; 2]| {
                let least = pair.iter().filter(|s| s.count > 0.0).map(|s| s.mean()).fold(f32::INFINITY, f32::min);
                let sees = |s: &&&Sums| s.count > 0.0 && s.mean() <= HIDDEN * least + ROUNDED;
                pair.iter().filter(sees).fold(Sums::default(), |all, s| all.and(s))
            };
            let all = seen([&sides[0], &sides[1]]).and(&seen([&sides[2], &sides[3]]));
            if step == STEPS {
                let error = (all.mean().max(ROUNDED) / all.slope.max(1e-12)).sqrt();
                return Some([f64::from(d), f64::from(error)]);
            }
            let by = all.turn / all.slope.max(1e-9);
            if by.abs() > FAR {
                return None;
            }
            d += by;
        }
        None
    }

    fn sums(&self, arm: &Arm, [y, x]: [usize; 2], half: usize, d: f32) -> Sums {
        let Sweep { height, width, center, .. } = &self.0;
        let mut sums = Sums::default();
        for (r, c, view) in arm {
            let (s, stride, [at, last]) = if *r == 0 { (*c, 1, [x, width - 1]) } else { (*r, *width, [y, height - 1]) };
            // Content of disparity d is displaced by -d per step (OPTICS 3).
            let away = -d * s as f32;
            let (first, part) = (away.floor() as isize, away - away.floor());
            // These are four neighbors along the axis of each pixel of the window, clamped to the picture.
            let reach =
                |i: usize, k: isize| ((at + i) as isize - half as isize + first + k).clamp(0, last as isize) as usize;
            for j in 0..=2 * half {
                for i in 0..=2 * half {
                    let (across, along) = if *r == 0 { (y + j - half, i) } else { (x + j - half, i) };
                    let value = |k: isize| {
                        let p = reach(along, k) * stride + if *r == 0 { across * width } else { across };
                        view[p]
                    };
                    let v = [value(-1), value(0), value(1), value(2)];
                    let here = if *r == 0 { across * width + at + i - half } else { (at + i - half) * width + across };
                    let e = v[1] + part * (v[2] - v[1]) - center[here];
                    let g = 0.5 * ((v[2] - v[0]) + part * ((v[3] - v[1]) - (v[2] - v[0])));
                    let sg = s as f32 * g;
                    sums = sums.and(&Sums { turn: sg * e, slope: sg * sg, error: e * e, count: 1.0 });
                }
            }
        }
        sums
    }
}

/// Returns means of three neighbors with the weights 1/4, 1/2 and 1/4, along both axes.
pub(crate) fn soften(view: &[f32], height: usize, width: usize) -> Vec<f32> {
    let blend = |a: f32, b: f32, c: f32| 0.25 * a + 0.5 * b + 0.25 * c;
    let rows = view
        .chunks_exact(width)
        .flat_map(|row| (0..width).map(move |x| blend(row[x.saturating_sub(1)], row[x], row[(x + 1).min(width - 1)])));
    let rows: Vec<f32> = rows.collect();
    let down = |i: usize| {
        let (x, y) = (i % width, i / width);
        blend(rows[y.saturating_sub(1) * width + x], rows[i], rows[(y + 1).min(height - 1) * width + x])
    };
    (0..height * width).map(down).collect()
}
