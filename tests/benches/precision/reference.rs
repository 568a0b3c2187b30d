//! The same computations in float64 with the plainest code, and the errors of results relative to them.

use eyebox::low_level::optics::{Optics, Pupil, transfer};
use eyebox::low_level::solve::SplitMix;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;

/// Returns the error power over the signal power.
pub fn error(got: impl IntoIterator<Item = f64>, want: impl IntoIterator<Item = f64>) -> f64 {
    let (mut error, mut power) = (0.0, 0.0);
    for (got, want) in got.into_iter().zip(want) {
        error += (got - want) * (got - want);
        power += want * want;
    }
    error / power
}

/// Returns the error power over the signal power for float32 values of an engine.
pub fn error_of(got: &[f32], want: &[f64]) -> f64 {
    assert_eq!(got.len(), want.len());
    error(got.iter().map(|v| f64::from(*v)), want.iter().copied())
}

/// Returns real and imaginary parts in turn, as engines return them.
pub fn parts(values: &[Complex64]) -> Vec<f64> {
    values.iter().flat_map(|z| [z.re, z.im]).collect()
}

/// Returns numbers from -1 to 1, which are the same on every machine.
pub fn noise(count: usize, seed: u64) -> Vec<f64> {
    let mut random = SplitMix(seed);
    (0..count).map(|_| 2.0 * random.unit() - 1.0).collect()
}

/// Transforms a frame in place, without normalization.
pub fn fft2(data: &mut [Complex64], height: usize, width: usize, inverse: bool) {
    let mut planner = FftPlanner::new();
    let mut plan = |n| if inverse { planner.plan_fft_inverse(n) } else { planner.plan_fft_forward(n) };
    plan(width).process(data);
    let down = plan(height);
    // Sixteen columns at a time fill cache lines, which hold four values each.
    let mut block = vec![Complex64::default(); 16 * height];
    for x in (0..width).step_by(16) {
        let n = 16.min(width - x);
        for y in 0..height {
            (0..n).for_each(|i| block[i * height + y] = data[y * width + x + i]);
        }
        down.process(&mut block[..n * height]);
        for y in 0..height {
            (0..n).for_each(|i| data[y * width + x + i] = block[i * height + y]);
        }
    }
}

/// Returns K on all bins, in the order of the DFT.
pub fn kernel(optics: &Optics, pupil: &Pupil) -> Vec<Complex64> {
    let (h, w) = (optics.height as i64, optics.width as i64);
    let bin = |k: i64, n: i64| if k < n - n / 2 { k } else { k - n };
    let at = |y, x| {
        let (re, im) = transfer(optics, pupil, bin(y, h), bin(x, w));
        Complex64::new(re, im)
    };
    (0..h).flat_map(|y| (0..w).map(move |x| (y, x))).map(|(y, x)| at(y, x)).collect()
}

/// Returns the image that the eye sees of one sub-frame.
pub fn view(optics: &Optics, phases: &[f64], pupil: &Pupil) -> Vec<f64> {
    let mut field: Vec<_> = phases.iter().map(|p| Complex64::from_polar(1.0, *p)).collect();
    fft2(&mut field, optics.height, optics.width, false);
    field.iter_mut().zip(kernel(optics, pupil)).for_each(|(u, k)| *u *= k);
    fft2(&mut field, optics.height, optics.width, true);
    let points = (optics.height * optics.width) as f64;
    let gain = 1.0 / (points * points * optics.share(pupil.diameter));
    field.iter().map(|v| gain * v.norm_sqr()).collect()
}
