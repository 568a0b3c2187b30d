//! The window of the spectrum that a pupil passes (OPTICS 5).

use super::propagation::Aperture;
use super::{Geometry, Optics, Pupil};
use serde::{Deserialize, Serialize};

/// How much of the spectrum around a pupil is transformed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WindowFactor {
    /// The disc itself: samples are exact, but the intensity is aliased as a signal.
    One,
    /// Twice the disc: the intensity's samples hold all of it.
    Two,
    /// The whole spectrum, for every pupil.
    Full,
}

/// A rectangle of DFT bins: rows `y0 .. y0 + rows`, columns `x0 .. x0 + columns`, where bins are signed and may hang
/// over the edge of the eyebox (there, nothing passes).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// First bin, rows.
    pub y0: i64,
    /// First bin, columns.
    pub x0: i64,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
}

impl Window {
    /// The window of `pupil` on the grid of `optics`: at least `factor` times the disc on each axis, grown to a size
    /// that transforms well, and, of a relay's spectrum, never larger than the grid.
    pub fn new(optics: &Optics, pupil: &Pupil, factor: WindowFactor) -> Self {
        Self::around(optics, pupil, factor, [0; 2])
    }

    /// The same with at least so many rows and columns, as far as the grid has them: windows that are to be of one size.
    pub fn around(optics: &Optics, pupil: &Pupil, factor: WindowFactor, [rows, columns]: [usize; 2]) -> Self {
        let (bin_y, bin_x) = optics.bin_size();
        let (most_y, most_x) = optics.image_size();
        let (first_y, first_x) = optics.first_bin();
        let axis = |n: usize, bin: f64, s: f64, own: i64, least: usize| {
            // In the far field a window may hang over on all sides: zeros around what passes are finer samples.
            let relay = optics.geometry == Geometry::Relay;
            let most = if relay { 1.0 } else { 2.0 } * n as f64;
            // A diameter of just so many bins is so many, whichever way the last digits of a pitch were rounded.
            let bins = |diameter: f64| (diameter / bin - 1e-6).ceil();
            let wanted = match factor {
                WindowFactor::Full => n,
                // One bin more than the disc can hold on a grid that it is not centered on.
                WindowFactor::One => bins(pupil.diameter).min(n as f64) as usize + 2,
                WindowFactor::Two => bins(2.0 * pupil.diameter).min(most) as usize + 2,
            };
            let count =
                if relay || factor == WindowFactor::Full { fast_size(wanted).min(n) } else { fast_size(wanted) };
            let count = count.max(least);
            // The grid's own bins when it holds all of them, else centered on the pupil.
            // Far outside, nothing passes wherever it stands: near enough for its numbers to stay small.
            let reach = 2.0 * n as f64 + own.unsigned_abs() as f64;
            let middle = (s / bin).round().clamp(-reach, reach) as i64;
            let whole = relay || factor == WindowFactor::Full;
            let first = if count == n && whole { own } else { middle - count as i64 / 2 };
            (first, count)
        };
        let (y0, rows) = axis(most_y, bin_y, pupil.y, first_y, rows);
        let (x0, columns) = axis(most_x, bin_x, pupil.x, first_x, columns);
        Self { y0, x0, rows, columns }
    }

    /// Per row of the window, the half-open interval of its columns that pass the pupil (0, 0 where none does).
    /// A disc cut by an eyebox is convex, so one interval is all of it.
    pub fn spans(&self, optics: &Optics, pupil: &Pupil) -> Vec<[u32; 2]> {
        self.each_span(optics, pupil).collect()
    }

    /// The same, row by row.
    pub fn each_span(self, optics: &Optics, pupil: &Pupil) -> impl Iterator<Item = [u32; 2]> + use<> {
        let aperture = Aperture::new(optics, pupil);
        let (bin_y, bin_x) = optics.bin_size();
        let (pupil, reach, per_bin) = (*pupil, (pupil.diameter / 2.0).powi(2), bin_x.recip());
        let lowest = optics.first_bin().1 - self.x0;
        let least = 0.max(lowest);
        let most = (self.columns as i64 - 1).min(lowest + optics.width as i64 - 1);
        let limit = move |v: i64| v.clamp(least, most.max(least));
        let bin = move |x: f64| (x * per_bin).clamp(-1e9, 1e9) as i64 - self.x0;
        let mut before = None;
        let span = move |j: usize| {
            let ky = self.y0 + j as i64;
            let row = aperture.row(ky);
            let passes = |k: i64| row(self.x0 + k);
            let beside = before.and_then(|span| beside(span, [least, most], passes));
            before = beside.or_else(|| {
                // The circle gives the ends to within a bin or two; the aperture itself decides them.
                let dy = ky as f64 * bin_y - pupil.y;
                let half = (reach - dy * dy).max(0.0).sqrt();
                let mut ends = limit(bin(pupil.x - half) - 2)..=limit(bin(pupil.x + half) + 2);
                let first = ends.find(|k| passes(*k))?;
                Some([first, ends.rfind(|k| passes(*k)).unwrap_or(first)])
            });
            before.map_or([0, 0], |[first, end]| [first as u32, end as u32 + 1])
        };
        (0..self.rows).map(span)
    }
}

/// The first and the last that pass, from those of the row before; none where that has no column in common with this.
fn beside([mut first, mut end]: [i64; 2], [least, most]: [i64; 2], passes: impl Fn(i64) -> bool) -> Option<[i64; 2]> {
    if passes(first) {
        while first > least && passes(first - 1) {
            first -= 1;
        }
    } else {
        first = (first + 1..=end).find(|k| passes(*k))?;
    }
    if passes(end) {
        while end < most && passes(end + 1) {
            end += 1;
        }
    } else {
        while !passes(end) {
            end -= 1;
        }
    }
    Some([first, end])
}

/// The smallest number >= `n` of the form 2^a 3^b 5^c with a at least 2 (for `n` > 10): sizes that both engines
/// transform fast, a few per cent apart.
pub fn fast_size(n: usize) -> usize {
    (n..).find(|&m| is_fast(m)).expect("there is a power of two above every number")
}

fn is_fast(n: usize) -> bool {
    let mut rest = n;
    let mut divide = |p: usize, most: u32| {
        let mut count = 0;
        while rest.is_multiple_of(p) && count < most {
            rest /= p;
            count += 1;
        }
        count
    };
    let twos = divide(2, 32);
    divide(3, 3);
    divide(5, 2);
    rest == 1 && (n <= 10 || twos >= 2)
}

#[cfg(test)]
mod tests {
    use super::super::aperture;
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn fast_sizes_are_close_together() {
        assert_eq!([1, 7, 11, 13, 100, 129, 1081].map(fast_size), [1, 8, 12, 16, 100, 144, 1152]);
        for n in 16..5000 {
            assert!(fast_size(n) as f64 <= 1.28 * n as f64 + 1.0, "{n} -> {}", fast_size(n));
        }
    }

    #[test]
    fn the_last_digit_of_a_pitch_does_not_decide() {
        let size = |pitch: f64| {
            let optics = Optics::new(64, 64, pitch, 520e-9, 0.4).unwrap().in_geometry(Geometry::FarField);
            let window = Window::new(&optics, &Pupil::from_mm([0.0, 0.0, 0.2, 0.0]), WindowFactor::One);
            (window.rows, window.columns)
        };
        let pitch = 20e-6f64;
        assert_eq!(size(pitch), (12, 12));
        assert_eq!([pitch.next_down(), pitch.next_up()].map(size), [(12, 12); 2]);
    }

    proptest! {
        /// Every bin that passes lies in the window and in its row's span, and nothing else does.
        #[test]
        fn spans_are_the_aperture(h in 1usize..40, w in 1usize..40, x in -13.0..13.0f64, y in -13.0..13.0f64, d in 0.1..30.0f64, f in 0..3usize) {
            let optics = Optics::new(h, w, 8e-6, 520e-9, 0.4).unwrap();
            let pupil = Pupil::from_mm([x, y, d, 1.0]);
            let factor = [WindowFactor::One, WindowFactor::Two, WindowFactor::Full][f];
            let window = Window::new(&optics, &pupil, factor);
            let spans = window.spans(&optics, &pupil);
            let mut inside = 0;
            for (j, &[first, end]) in spans.iter().enumerate() {
                for k in 0..window.columns {
                    let passes = aperture(&optics, &pupil, window.y0 + j as i64, window.x0 + k as i64);
                    prop_assert_eq!(passes, (first..end).contains(&(k as u32)), "row {} column {}", j, k);
                    inside += usize::from(passes);
                }
            }
            let mut all = 0;
            for ky in -40..40 { for kx in -40..40 { all += usize::from(aperture(&optics, &pupil, ky, kx)); } }
            prop_assert_eq!(inside, all);
        }
    }
}
