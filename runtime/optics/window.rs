//! Computes the spectral window of a pupil, the part of the spectrum that the pupil passes (OPTICS 5).

use super::propagation::Aperture;
use super::{Geometry, Optics, Pupil};
use serde::{Deserialize, Serialize};

/// The size of the spectral window of a pupil.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WindowFactor {
    /// The disc itself. Samples are exact, but the intensity is aliased as a signal.
    One,
    /// Twice the disc. The intensity's samples hold all of it.
    Two,
    /// The whole spectrum, for every pupil.
    Full,
}

/// A rectangle of DFT bins, with the rows `y0 .. y0 + rows` and the columns `x0 .. x0 + columns`. Bins are signed and
/// may extend beyond the edge of the eyebox, which nothing passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// First bin along the rows.
    pub y0: i64,
    /// First bin along the columns.
    pub x0: i64,
    /// Number of rows of bins.
    pub rows: usize,
    /// Number of columns of bins.
    pub columns: usize,
}

impl Window {
    /// The spectral window of `pupil` on the grid of `optics`. It is at least `factor` times the disc on each axis,
    /// grown to a size that transforms fast. For a relay it is never larger than the grid.
    pub fn new(optics: &Optics, pupil: &Pupil, factor: WindowFactor) -> Self {
        Self::around(optics, pupil, factor, [0; 2])
    }

    /// The same window with at least this many rows and columns, as far as the grid has them, to give windows one size.
    pub fn around(optics: &Optics, pupil: &Pupil, factor: WindowFactor, [rows, columns]: [usize; 2]) -> Self {
        let (bin_y, bin_x) = optics.bin_size();
        let (most_y, most_x) = optics.image_size();
        let (first_y, first_x) = optics.first_bin();
        let axis = |n: usize, bin: f64, s: f64, own: i64, least: usize| {
            // In the far field a window may extend beyond all sides, because zeros around the light give finer samples.
            let relay = optics.geometry == Geometry::Relay;
            let most = if relay { 1.0 } else { 2.0 } * n as f64;
            // A diameter of a whole number of bins gives that number, for any rounding of the last digits of a pitch.
            let bins = |diameter: f64| (diameter / bin - 1e-6).ceil();
            let wanted = match factor {
                WindowFactor::Full => n,
                // The disc may hold one bin more than this on a grid that it is not centered on.
                WindowFactor::One => bins(pupil.diameter).min(n as f64) as usize + 2,
                WindowFactor::Two => bins(2.0 * pupil.diameter).min(most) as usize + 2,
            };
            let count =
                if relay || factor == WindowFactor::Full { fast_size(wanted).min(n) } else { fast_size(wanted) };
            let count = count.max(least);
            // The window has the grid's own bins if it holds all of them. Otherwise it is centered on the pupil.
            // Nothing passes far outside at any place, so the limit only keeps the numbers small.
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

    /// For each row of the window, the half-open interval of its columns that pass the pupil (0, 0 if none does). A
    /// disc cut by an eyebox is convex, so one interval holds all of it.
    pub fn spans(&self, optics: &Optics, pupil: &Pupil) -> Vec<[u32; 2]> {
        self.each_span(optics, pupil).collect()
    }

    /// The same intervals, row by row.
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
                // The circle gives the ends to within a bin or two, and the aperture itself decides them.
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

/// The first and the last column that pass, found from the row before. It is none if the rows have no column in common.
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

/// The smallest number >= `n` of the form 2^a 3^b 5^c with a at least 2 (for `n` > 10). Both engines transform these
/// sizes fast, and they are a few per cent apart.
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
        /// Every bin that passes is in the window and in its row's span, and no other bin is in the span.
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
