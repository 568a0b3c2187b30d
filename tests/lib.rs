//! Shared helpers of tests that use several modules.
//!
//! [`Oracle`] computes the optics in float64 with the shortest code. It has no windows, spans or tables, which make the
//! runtime fast. Tests compare the runtime with the oracle, never the oracle with the runtime.

pub mod both;
pub mod gradient;

use eyebox::low_level::engine::{Buffer, Engine, cpu::CpuEngine};
use eyebox::low_level::optics::{Optics, Pupil, transfer};
use eyebox::low_level::plan::{Kernel, Planner, PupilPass, Purpose, Step};
use eyebox_kernels::fft::{Direction, transform_f64};
use rustfft::num_complex::Complex64;

/// Returns noise from -1 to 1, which is the same on every machine.
pub fn noise(count: usize, seed: u64) -> Vec<f64> {
    let mut random = eyebox::low_level::solve::SplitMix(seed);
    (0..count).map(|_| 2.0 * random.unit() - 1.0).collect()
}

/// Returns random phases from -pi to pi in both precisions, which float32 stores exactly.
pub fn phases(count: usize, seed: u64) -> (Vec<f64>, Vec<f32>) {
    let rounded: Vec<f32> = noise(count, seed).iter().map(|x| (x * std::f64::consts::PI) as f32).collect();
    (rounded.iter().map(|p| f64::from(*p)).collect(), rounded)
}

/// Returns a CPU engine with these phases.
pub fn loaded(planner: &Planner, purpose: Purpose, phases: &[f32]) -> CpuEngine {
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(purpose), None).expect("memory");
    engine.write(Buffer::Phases, phases).expect("phases of the planner's size");
    engine
}

/// Runs a step with targets that the test writes, without the kernels that compute target images. Returns the step and
/// its losses.
pub fn step_with_targets(
    planner: &Planner,
    engine: &mut CpuEngine,
    pupil_passes: Vec<PupilPass>,
    targets: &[Vec<f32>],
    adam: bool,
) -> (Step, Vec<f64>) {
    let mut step = match adam {
        true => planner.adam_step(pupil_passes, usize::MAX, 1, 0.0),
        false => planner.project_step(pupil_passes, usize::MAX, 1.0, 1.0, 0.0),
    };
    step.list.retain(|d| !matches!(d.kernel, Kernel::Photograph | Kernel::Resample));
    let cut = step.list.iter().position(|d| d.kernel == Kernel::Compare).expect("targets are compared");
    engine.run_part(&step, 0..cut).expect("the kernels before the comparison");
    for (i, target) in targets.iter().enumerate() {
        engine.write(Buffer::Target(i), target).expect("a target of the size of its pupil pass");
    }
    let losses = engine.run_part(&step, cut..step.list.len()).expect("the comparison and the kernels after it");
    (step, losses)
}

/// Returns the power of the difference over the power of the reference. For a reference of zeros, it returns the power
/// of the difference.
pub fn error_power(got: &[f32], want: &[f64]) -> f64 {
    assert_eq!(got.len(), want.len());
    let error: f64 = got.iter().zip(want).map(|(g, w)| (f64::from(*g) - w).powi(2)).sum();
    let power: f64 = want.iter().map(|w| w * w).sum();
    if power == 0.0 { error } else { error / power }
}

/// Returns the largest error power over signal power after `count` roundings to halves. At the low end of its binade, a
/// value has an even spread of errors of up to half of 2^-10 to either side. Their mean square is 2^-22 / 3. Values
/// higher in the binade have less, by half on average. Roundings are independent, so their powers add.
pub fn half_roundings(count: usize) -> f64 {
    count as f64 * 2f64.powi(-22) / 3.0
}

/// Computes a 2-D transform in float64, as NumPy defines it. The inverse is divided by the number of values.
pub fn fft2(data: &mut [Complex64], height: usize, width: usize, inverse: bool) {
    let direction = if inverse { Direction::Inverse } else { Direction::Forward };
    transform_f64(data, width, direction);
    let mut turned: Vec<Complex64> = (0..height * width).map(|i| data[i % height * width + i / height]).collect();
    transform_f64(&mut turned, height, direction);
    (0..height * width).for_each(|i| data[i] = turned[i % width * height + i / width]);
    if inverse {
        let scale = 1.0 / (height * width) as f64;
        data.iter_mut().for_each(|z| *z *= scale);
    }
}

/// The optics in float64 (OPTICS 2 and 4).
pub struct Oracle {
    /// The optics of the display.
    pub optics: Optics,
    /// The number of sub-frames.
    pub frames: usize,
}

impl Oracle {
    /// Returns the spectrum of each sub-frame.
    pub fn spectra(&self, phases: &[f64]) -> Vec<Vec<Complex64>> {
        let (h, w) = (self.optics.height, self.optics.width);
        let one = |frame: &[f64]| {
            let mut u: Vec<_> = frame.iter().map(|p| Complex64::from_polar(1.0, *p)).collect();
            fft2(&mut u, h, w, false);
            u
        };
        phases.chunks_exact(h * w).map(one).collect()
    }

    /// Returns K on all bins, in the order of the DFT.
    pub fn kernel(&self, pupil: &Pupil) -> Vec<Complex64> {
        let (h, w) = (self.optics.height as i64, self.optics.width as i64);
        let bin = |k: i64, n: i64| if k < n - n / 2 { k } else { k - n };
        let at = |y, x| {
            let (re, im) = transfer(&self.optics, pupil, bin(y, h), bin(x, w));
            Complex64::new(re, im)
        };
        (0..h).flat_map(|y| (0..w).map(move |x| (y, x))).map(|(y, x)| at(y, x)).collect()
    }

    /// Returns the retinal field of each sub-frame.
    pub fn fields(&self, phases: &[f64], pupil: &Pupil) -> Vec<Vec<Complex64>> {
        let kernel = self.kernel(pupil);
        let one = |mut spectrum: Vec<Complex64>| {
            spectrum.iter_mut().zip(&kernel).for_each(|(u, k)| *u *= k);
            fft2(&mut spectrum, self.optics.height, self.optics.width, true);
            spectrum
        };
        self.spectra(phases).into_iter().map(one).collect()
    }

    /// Returns the time-averaged intensity over the pupil's share of the eyebox.
    pub fn view(&self, phases: &[f64], pupil: &Pupil) -> Vec<f64> {
        let share = std::f64::consts::FRAC_PI_4 * (pupil.diameter / self.optics.eyebox()).powi(2);
        let fields = self.fields(phases, pupil);
        let mean = |i: usize| fields.iter().map(|v| v[i].norm_sqr()).sum::<f64>() / (self.frames as f64 * share);
        (0..self.optics.height * self.optics.width).map(mean).collect()
    }
}

/// Returns a pool with this number of threads.
pub fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}
