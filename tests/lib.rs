//! Tests that cross rooms; the helpers that they share live here.
//!
//! [`Oracle`] is the optics again in float64, as short as it can be said and without anything that the runtime does to
//! be fast: no window, no span, no table. Runtime code is compared with it, never the other way round.

pub mod both;
pub mod gradient;

use eyebox::low_level::engine::{Buffer, Engine, cpu::CpuEngine};
use eyebox::low_level::optics::{Optics, Pupil, transfer};
use eyebox::low_level::plan::{Kernel, Planner, PupilPass, Purpose, Step};
use eyebox_kernels::fft::{Direction, transform_f64};
use rustfft::num_complex::Complex64;

/// Noise in -1 .. 1, the same on every machine.
pub fn noise(count: usize, seed: u64) -> Vec<f64> {
    let mut random = eyebox::low_level::solve::SplitMix(seed);
    (0..count).map(|_| 2.0 * random.unit() - 1.0).collect()
}

/// Random phases in -pi .. pi that float32 holds exactly, in both precisions.
pub fn phases(count: usize, seed: u64) -> (Vec<f64>, Vec<f32>) {
    let rounded: Vec<f32> = noise(count, seed).iter().map(|x| (x * std::f64::consts::PI) as f32).collect();
    (rounded.iter().map(|p| f64::from(*p)).collect(), rounded)
}

/// A CPU engine with these phases.
pub fn loaded(planner: &Planner, purpose: Purpose, phases: &[f32]) -> CpuEngine {
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(purpose), None).expect("memory");
    engine.write(Buffer::Phases, phases).expect("phases of the planner's size");
    engine
}

/// One step's list, with targets that the test writes: the photograph's kernels are left out. The step, and its losses.
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
    engine.run_part(&step, 0..cut).expect("the way down");
    for (i, target) in targets.iter().enumerate() {
        engine.write(Buffer::Target(i), target).expect("a target of its pupil_pass's size");
    }
    let losses = engine.run_part(&step, cut..step.list.len()).expect("the way up");
    (step, losses)
}

/// Power of the difference over power of the reference.
pub fn error_power(got: &[f32], want: &[f64]) -> f64 {
    assert_eq!(got.len(), want.len());
    let error: f64 = got.iter().zip(want).map(|(g, w)| (f64::from(*g) - w).powi(2)).sum();
    let power: f64 = want.iter().map(|w| w * w).sum();
    if power == 0.0 { error } else { error / power }
}

/// The most error power over signal power that so many roundings to halves leave: half of 2^-10 to either side, evenly, of
/// a value at the low end of its binade, is 2^-22 / 3 (mean square of an even spread); values higher up have less, by half
/// on average. Roundings are independent, so that their powers add.
pub fn half_roundings(count: usize) -> f64 {
    count as f64 * 2f64.powi(-22) / 3.0
}

/// 2-D transform in float64, as NumPy defines it (the inverse is divided by the count).
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
    /// The display.
    pub optics: Optics,
    /// Sub-frames.
    pub frames: usize,
}

impl Oracle {
    /// Spectrum of each sub-frame.
    pub fn spectra(&self, phases: &[f64]) -> Vec<Vec<Complex64>> {
        let (h, w) = (self.optics.height, self.optics.width);
        let one = |frame: &[f64]| {
            let mut u: Vec<_> = frame.iter().map(|p| Complex64::from_polar(1.0, *p)).collect();
            fft2(&mut u, h, w, false);
            u
        };
        phases.chunks_exact(h * w).map(one).collect()
    }

    /// K on all bins, in the order of the DFT.
    pub fn kernel(&self, pupil: &Pupil) -> Vec<Complex64> {
        let (h, w) = (self.optics.height as i64, self.optics.width as i64);
        let bin = |k: i64, n: i64| if k < n - n / 2 { k } else { k - n };
        let at = |y, x| {
            let (re, im) = transfer(&self.optics, pupil, bin(y, h), bin(x, w));
            Complex64::new(re, im)
        };
        (0..h).flat_map(|y| (0..w).map(move |x| (y, x))).map(|(y, x)| at(y, x)).collect()
    }

    /// Retinal field of each sub-frame.
    pub fn fields(&self, phases: &[f64], pupil: &Pupil) -> Vec<Vec<Complex64>> {
        let kernel = self.kernel(pupil);
        let one = |mut spectrum: Vec<Complex64>| {
            spectrum.iter_mut().zip(&kernel).for_each(|(u, k)| *u *= k);
            fft2(&mut spectrum, self.optics.height, self.optics.width, true);
            spectrum
        };
        self.spectra(phases).into_iter().map(one).collect()
    }

    /// Time-averaged intensity over the pupil's share of the eyebox.
    pub fn view(&self, phases: &[f64], pupil: &Pupil) -> Vec<f64> {
        let share = std::f64::consts::FRAC_PI_4 * (pupil.diameter / self.optics.eyebox()).powi(2);
        let fields = self.fields(phases, pupil);
        let mean = |i: usize| fields.iter().map(|v| v[i].norm_sqr()).sum::<f64>() / (self.frames as f64 * share);
        (0..self.optics.height * self.optics.width).map(mean).collect()
    }
}

/// A pool of this many threads.
pub fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}
