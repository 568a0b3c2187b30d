//! Measures how far a picture has moved since the previous one, by phase correlation (Kuglin and Hines 1975).

use eyebox_kernels::Complex64;
use eyebox_kernels::fft::{Direction, transform_f64};
use std::f64::consts::{PI, TAU};

/// The peak of the correlation has the shape of a low pass of this standard deviation in pixels. It is wide enough for
/// a position between pixels.
const PEAK: f64 = 1.2;
/// A picture counts as moved as a whole if at most this share of the difference is left after it is moved back.
const LEFT: f64 = 0.25;
/// Frequencies weaker than this share of the strongest one contain only rounding errors.
const WEAK: f64 = 1e-6;

/// Returns how far the content of `before` has moved in `after`, in pixels (x, y) and to a fraction of a pixel. It
/// returns `None` if `after` is another picture, or moved by more than a quarter of its size. Both are (height, width),
/// row by row.
///
/// The cross power spectrum of both is taken under a Hann window, and each frequency is divided by its magnitude. It
/// has one peak where the pictures coincide. A Gaussian low pass makes the peak a Gaussian, and three logarithms along
/// each axis give its middle exactly. A window at rest pulls the peak towards its own position. A movement of a pixel
/// or more is therefore measured again on the area that both pictures share. Phase correlation finds a peak in any
/// data, so the result counts only if it explains the difference.
pub fn displacement(before: &[f32], after: &[f32], size: [usize; 2]) -> Option<[f64; 2]> {
    let [height, width] = size;
    let pixels = height * width;
    if before.len() != pixels || after.len() != pixels || height.min(width) < 8 {
        return None;
    }
    let apart = squares(before, after, width, [0.0; 2]);
    if apart == 0.0 {
        return Some([0.0; 2]);
    }
    let reach = [width as i64 / 4, height as i64 / 4];
    let roughly = peak([before, after], size, [0; 2], reach)?;
    let whole = roughly.map(|v| v.round() as i64);
    let moved = match whole {
        [0, 0] => roughly,
        _ => {
            let rest = peak([before, after], size, whole, [2, 2])?;
            [0, 1].map(|i| whole[i] as f64 + rest[i])
        }
    };
    (squares(before, after, width, moved) <= LEFT * apart).then_some(moved)
}

/// Finds the peak of the correlation. It is the further movement of the second picture beyond `offset` (x, y), at most
/// `reach`.
fn peak([before, after]: [&[f32]; 2], size: [usize; 2], [x, y]: [i64; 2], reach: [i64; 2]) -> Option<[f64; 2]> {
    let [height, width] = size;
    // The area that both pictures share starts at these positions.
    let shared = [height as i64 - y.abs(), width as i64 - x.abs()].map(|n| n.max(1) as usize);
    let (one, other) = ([(-y).max(0), (-x).max(0)], [y.max(0), x.max(0)]);
    let spectrum = |picture: &[f32], from: [i64; 2]| {
        let mut lines = windowed(picture, size, from, shared);
        transform(&mut lines, size, Direction::Forward);
        lines
    };
    // From here on the order is columns first, (width, height).
    let (one, mut cross) = (spectrum(before, one), spectrum(after, other));
    let strongest = one.iter().map(|z| z.norm_sqr()).fold(0.0, f64::max);
    let [down, across] = size.map(low_pass);
    let columns = cross.chunks_exact_mut(height).zip(one.chunks_exact(height)).zip(&across);
    for ((cross, one), across) in columns {
        for ((b, a), down) in cross.iter_mut().zip(one).zip(&down) {
            let product = *b * a.conj();
            let magnitude = product.norm_sqr().sqrt();
            let strong = magnitude > WEAK * strongest;
            *b = if strong { product * (across * down / magnitude) } else { Complex64::ZERO };
        }
    }
    transform(&mut cross, [width, height], Direction::Inverse);
    // The order is rows first again.
    let wrapped = |v: i64, n: usize| v.rem_euclid(n as i64) as usize;
    let at = |y: i64, x: i64| cross[wrapped(y, height) * width + wrapped(x, width)].re;
    let places = (-reach[1]..=reach[1]).flat_map(|y| (-reach[0]..=reach[0]).map(move |x| (y, x)));
    let (y, x) = places.max_by(|a, b| at(a.0, a.1).total_cmp(&at(b.0, b.1)))?;
    let between = |less: f64, peak: f64, more: f64| {
        let logs = [less, peak, more].map(|v| v.max(1e-12 * peak.abs()).ln());
        let bend = logs[0] - 2.0 * logs[1] + logs[2];
        if bend < 0.0 { (0.5 * (logs[0] - logs[2]) / bend).clamp(-0.5, 0.5) } else { 0.0 }
    };
    Some([
        x as f64 + between(at(y, x - 1), at(y, x), at(y, x + 1)),
        y as f64 + between(at(y - 1, x), at(y, x), at(y + 1, x)),
    ])
}

/// Returns the Gaussian of the peak, along one axis of `count` frequencies.
fn low_pass(count: usize) -> Vec<f64> {
    let frequency = |bin: usize| {
        let signed = if bin < count.div_ceil(2) { bin as f64 } else { bin as f64 - count as f64 };
        signed / count as f64
    };
    (0..count).map(|bin| (-2.0 * (PI * PEAK * frequency(bin)).powi(2)).exp()).collect()
}

/// Returns the part of a picture that begins at `from` and has the size `shared`, less its mean and under a Hann
/// window, so that its edges do not contribute. It is at the beginning of an array of zeros of the picture's size.
fn windowed(picture: &[f32], [height, width]: [usize; 2], from: [i64; 2], shared: [usize; 2]) -> Vec<Complex64> {
    let hann =
        |n: usize| (0..n).map(move |i| 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n as f64).cos()).collect::<Vec<_>>();
    let [down, across] = shared.map(hann);
    let from = from.map(|v| v as usize);
    let rows = || picture.chunks_exact(width).skip(from[0]).take(shared[0]).map(|row| &row[from[1]..][..shared[1]]);
    let sum = rows().map(|row| row.iter().map(|v| f64::from(*v)).sum::<f64>()).sum::<f64>();
    let mean = sum / (shared[0] * shared[1]) as f64;
    let mut lines = vec![Complex64::ZERO; height * width];
    for ((line, row), down) in lines.chunks_exact_mut(width).zip(rows()).zip(&down) {
        for ((to, value), across) in line.iter_mut().zip(row).zip(&across) {
            *to = Complex64::new((f64::from(*value) - mean) * down * across, 0.0);
        }
    }
    lines
}

/// Transforms both axes of (rows, columns), and exchanges the axes in memory.
fn transform(lines: &mut Vec<Complex64>, [rows, columns]: [usize; 2], direction: Direction) {
    transform_f64(lines, columns, direction);
    let mut turned: Vec<Complex64> =
        (0..columns).flat_map(|x| (0..rows).map(move |y| (x, y))).map(|(x, y)| lines[y * columns + x]).collect();
    transform_f64(&mut turned, rows, direction);
    *lines = turned;
}

/// Returns the mean square of the difference between `after` and `before` moved by this, where both have pixels.
fn squares(before: &[f32], after: &[f32], width: usize, [x, y]: [f64; 2]) -> f64 {
    let height = before.len() / width;
    let (left, top) = (x.floor(), y.floor());
    let (across, down) = (x - left, y - top);
    let at = |row: i64, column: i64| f64::from(before[row as usize * width + column as usize]);
    let (mut sum, mut count) = (0.0, 0u64);
    for row in 0..height as i64 {
        for column in 0..width as i64 {
            let (above, beside) = (row - top as i64 - 1, column - left as i64 - 1);
            if above < 0 || beside < 0 || above + 1 >= height as i64 || beside + 1 >= width as i64 {
                continue;
            }
            let upper = across * at(above, beside) + (1.0 - across) * at(above, beside + 1);
            let lower = across * at(above + 1, beside) + (1.0 - across) * at(above + 1, beside + 1);
            let off = f64::from(after[row as usize * width + column as usize]) - down * upper - (1.0 - down) * lower;
            (sum, count) = (sum + off * off, count + 1);
        }
    }
    sum / count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes a picture of soft blobs, moved by this.
    fn picture([height, width]: [usize; 2], [x, y]: [f64; 2], seed: u64) -> Vec<f32> {
        let mut random = fastrand::Rng::with_seed(seed);
        let reach = [width as f64, height as f64];
        let blobs: Vec<[f64; 4]> = (0..60)
            .map(|_| [reach[0] * random.f64(), reach[1] * random.f64(), 1.5 + 3.0 * random.f64(), random.f64()])
            .collect();
        let light = |row: usize, column: usize| {
            let one = |[bx, by, wide, bright]: &[f64; 4]| {
                let (dx, dy) = (column as f64 - x - bx, row as f64 - y - by);
                bright * (-(dx * dx + dy * dy) / (2.0 * wide * wide)).exp()
            };
            blobs.iter().map(one).sum::<f64>() as f32
        };
        (0..height).flat_map(|row| (0..width).map(move |column| (row, column))).map(|(r, c)| light(r, c)).collect()
    }

    #[test]
    fn a_picture_that_moved_is_found_to_a_fraction_of_a_pixel() {
        for size in [[64, 80], [96, 96]] {
            let before = picture(size, [0.0; 2], 3);
            for moved in [[0.0, 0.0], [3.0, -2.0], [0.4, 0.25], [-7.3, 5.6], [11.75, 0.0], [0.0, -9.5]] {
                let found = displacement(&before, &picture(size, moved, 3), size).expect("it is the same picture");
                let off = (found[0] - moved[0]).hypot(found[1] - moved[1]);
                assert!(off < 0.05, "{size:?}: moved by {moved:?}, found {found:?}");
            }
        }
    }

    #[test]
    fn another_picture_has_not_moved() {
        let size = [64, 64];
        let before = picture(size, [0.0; 2], 3);
        assert_eq!(displacement(&before, &picture(size, [0.0; 2], 4), size), None, "another picture");
        assert_eq!(displacement(&before, &vec![0.0; 64 * 64], size), None, "darkness");
        assert_eq!(displacement(&vec![0.0; 64 * 64], &vec![0.0; 64 * 64], size), Some([0.0; 2]), "dark as before");
        assert_eq!(displacement(&before, &before[1..], size), None, "another size");
        // Content that becomes twice as bright has not moved either.
        let brighter: Vec<f32> = before.iter().map(|v| 2.0 * v).collect();
        assert_eq!(displacement(&before, &brighter, size), None);
    }

    #[test]
    fn one_thing_that_moves_before_others_that_rest_is_no_motion_of_the_whole() {
        let size = [64, 64];
        let mut after = picture(size, [0.0; 2], 3);
        let other = picture(size, [9.0, 0.0], 5);
        let mut before = after.clone();
        for (i, v) in picture(size, [0.0; 2], 5).iter().enumerate().filter(|(i, _)| i % 64 < 12) {
            before[i] += v;
        }
        after.iter_mut().zip(&other).enumerate().filter(|(i, _)| i % 64 < 21).for_each(|(_, (a, o))| *a += 0.5 * o);
        let found = displacement(&before, &after, size);
        assert!(found.is_none_or(|[x, y]| x.hypot(y) < 0.5), "{found:?}");
    }
}
