//! Computes the ceiling, the highest score that diffraction at a pupil allows for any hologram.

use super::Plane;
use crate::optics::{Optics, Pupil, Window, WindowFactor};
use eyebox_kernels::Complex64;
use eyebox_kernels::fft::{Direction, transform_f64};

/// The loss of one target image by diffraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ceiling {
    /// Sum of squares of the content that no light through the pupil can show.
    pub error: f64,
    /// Number of pixels of the sum.
    pub pixels: usize,
}

impl Ceiling {
    /// Computes the loss of the target image `wanted` through `pupil`, averaged over 2 x 2 pixels as all scores are.
    /// `optics` is for the whole SLM, and the target image for its whole picture.
    ///
    /// The field that a pupil passes has only the frequencies inside its disc (OPTICS 2). So its intensity has only the
    /// differences of two of them, a disc twice as wide, for any phases and any number of sub-frames. The content of
    /// the target image beyond that disc is lost, and at best the rest is exact. By Parseval's theorem the error is
    /// then the energy beyond the disc.
    ///
    /// It is exact for SLMs of even rows and columns without padding, which recovers a little of the loss at edges. No
    /// hologram scores more. The ceiling may not be reachable, because all pupils share the phases, and light is never
    /// negative.
    pub fn new(optics: &Optics, pupil: &Pupil, wanted: &Plane) -> Self {
        let passes = passed(optics, pupil, [wanted.rows, wanted.columns]);
        let spectrum = spectrum(wanted);
        let beyond = spectrum.iter().zip(&passes).filter(|(_, passes)| !**passes);
        let pixels = wanted.rows * wanted.columns;
        // The threshold is far below the precision of float32 target images.
        let (energy, all) = (beyond.map(|(v, _)| v.norm_sqr()).sum::<f64>(), pixels.max(1) as f64);
        Self { error: if energy < 1e-12 * all * all { 0.0 } else { energy / all }, pixels }
    }

    /// Returns the highest PSNR in dB that a pupil can have over these colors, with the same weight for every pixel. It
    /// is infinite if diffraction causes no loss.
    pub fn decibels<'a>(colors: impl IntoIterator<Item = &'a Self>) -> f64 {
        let add = |(error, pixels): (f64, usize), one: &Self| (error + one.error, pixels + one.pixels);
        let (error, pixels) = colors.into_iter().fold((0.0, 0), add);
        -10.0 * (error / pixels.max(1) as f64).log10()
    }
}

/// Returns the frequencies that an intensity can have, for a picture of these rows and columns, to which the whole
/// picture is averaged.
fn passed(optics: &Optics, pupil: &Pupil, [rows, columns]: [usize; 2]) -> Vec<bool> {
    let spans = Window::new(optics, pupil, WindowFactor::Full).spans(optics, pupil);
    let spans: Vec<Option<[i64; 2]>> =
        spans.iter().map(|s| (s[0] < s[1]).then(|| [i64::from(s[0]), i64::from(s[1]) - 1])).collect();
    let whole = optics.image_size();
    // Bins of the averaged picture per bin of the whole. This is one, except for a last odd row or column, which
    // averaging drops.
    let share = |few: usize, all: usize| (if few < all { 2 * few } else { few }) as f64 / all as f64;
    let (down, across) = (share(rows, whole.0), share(columns, whole.1));
    let mut passes = vec![false; rows * columns];
    let last = spans.len() as i64 - 1;
    for apart in 0..=last {
        // The differences of a disc's spans of columns, that many rows apart, are one interval.
        let pairs = (0..=last - apart).filter_map(|r| Some([spans[r as usize]?, spans[(r + apart) as usize]?]));
        let ends = |[a, b]: [[i64; 2]; 2]| [b[0] - a[1], b[1] - a[0]];
        let Some([low, high]) = pairs.map(ends).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]) else { continue };
        let (low, high) = ((low as f64 * across).floor() as i64, (high as f64 * across).ceil() as i64);
        let exact = apart as f64 * down;
        for row in [exact.floor() as i64, exact.ceil() as i64] {
            // An intensity is real, so each frequency occurs with its opposite.
            for column in (low..=high).take(columns) {
                for sign in [1, -1] {
                    let at = [(sign * row).rem_euclid(rows as i64), (sign * column).rem_euclid(columns as i64)];
                    passes[at[0] as usize * columns + at[1] as usize] = true;
                }
            }
        }
    }
    passes
}

/// Returns the spectrum of a picture, not normalized.
fn spectrum(plane: &Plane) -> Vec<Complex64> {
    let (rows, columns) = (plane.rows, plane.columns);
    let mut lines: Vec<Complex64> = plane.values.iter().map(|v| Complex64::new(f64::from(*v), 0.0)).collect();
    transform_f64(&mut lines, columns, Direction::Forward);
    let mut turned: Vec<Complex64> = (0..rows * columns).map(|i| lines[i % rows * columns + i / rows]).collect();
    transform_f64(&mut turned, rows, Direction::Forward);
    (0..rows * columns).map(|i| turned[i % columns * rows + i / columns]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::aperture;
    use std::f64::consts::TAU;

    fn optics(height: usize, width: usize) -> Optics {
        Optics::new(height, width, 8e-6, 520e-9, 0.4).unwrap()
    }

    /// Pupils in the middle, over the edge of the eyebox, so wide that frequencies wrap around, and as wide as all of
    /// it.
    const PUPILS: [[f64; 4]; 5] = [
        [0.0, 0.0, 6.0, 0.0],
        [3.0, -5.0, 4.0, 1.0],
        [11.0, -9.0, 8.0, 0.0],
        [1.0, 2.0, 17.0, 0.0],
        [0.0, 0.0, 40.0, 0.0],
    ];

    fn bins(optics: &Optics, pupil: &Pupil) -> Vec<[i64; 2]> {
        let (y, x) = optics.first_bin();
        let all = (y..y + optics.height as i64).flat_map(|ky| (x..x + optics.width as i64).map(move |kx| [ky, kx]));
        all.filter(|[ky, kx]| aperture(optics, pupil, *ky, *kx)).collect()
    }

    #[test]
    fn an_intensity_has_the_differences_of_what_passes() {
        for (height, width) in [(16, 24), (24, 16)] {
            let optics = optics(height, width);
            for pupil in PUPILS.map(Pupil::from_mm) {
                let (rows, columns) = (height / 2, width / 2);
                let mut wanted = vec![false; rows * columns];
                let passing = bins(&optics, &pupil);
                for [a, b] in passing.iter().flat_map(|a| passing.iter().map(move |b| [a, b])) {
                    let [y, x] = [(a[0] - b[0]).rem_euclid(rows as i64), (a[1] - b[1]).rem_euclid(columns as i64)];
                    wanted[y as usize * columns + x as usize] = true;
                }
                assert!(passed(&optics, &pupil, [rows, columns]) == wanted, "{height}x{width} {pupil:?}");
            }
        }
    }

    /// With two sub-frames of any light that passes, an image that light can show loses nothing, and other content is
    /// lost.
    #[test]
    fn what_light_can_show_has_no_ceiling() {
        let optics = optics(16, 24);
        for pupil in PUPILS.map(Pupil::from_mm) {
            let passing = bins(&optics, &pupil);
            let mut random = fastrand::Rng::with_seed(7);
            let mut image = vec![0.0f64; 16 * 24];
            for _ in 0..2 {
                let light: Vec<Complex64> =
                    passing.iter().map(|_| Complex64::from_polar(random.f64(), TAU * random.f64())).collect();
                for (i, pixel) in image.iter_mut().enumerate() {
                    let (row, column) = ((i / 24) as f64 / 16.0, (i % 24) as f64 / 24.0);
                    let wave = |k: &[i64; 2]| Complex64::cis(TAU * (k[0] as f64 * row + k[1] as f64 * column));
                    *pixel += passing.iter().zip(&light).map(|(k, a)| a * wave(k)).sum::<Complex64>().norm_sqr();
                }
            }
            let brightest = image.iter().copied().fold(0.0, f64::max);
            let values = image.iter().map(|v| (v / brightest) as f32).collect();
            let shown = Plane { rows: 16, columns: 24, values }.pooled();
            let ceiling = Ceiling::decibels([&Ceiling::new(&optics, &pupil, &shown)]);
            assert!(ceiling > 120.0, "{pupil:?}: {ceiling}");
            let noise = Plane { values: shown.values.iter().map(|_| random.f32()).collect(), ..shown };
            let (lost, narrow) = (Ceiling::new(&optics, &pupil, &noise), pupil.diameter < 0.01);
            assert_eq!(lost.error > 0.1, narrow, "{pupil:?}: {}", lost.error);
            // Another color without a loss halves the error.
            let free = Ceiling { error: 0.0, ..lost };
            assert!(!narrow || (Ceiling::decibels([&lost, &free]) - Ceiling::decibels([&lost]) - 3.01).abs() < 0.01);
        }
    }
}
