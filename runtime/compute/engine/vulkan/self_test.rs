//! Tests a device against float64 at first use, and stores the result.
//!
//! The tests are the propagation kernel, whose phase runs to thousands of turns, and a transform along rows and
//! columns. The first depends most on the rounding of float32, and everything else passes through the second.

use super::engine::VulkanEngine;
use crate::engine::{Buffer, Dispatch, Engine, EngineError, Kernel, Purpose};
use crate::gpu::{Commands, DeviceReport, Gpu, Tested};
use crate::optics::{Optics, Pupil, WindowFactor, transfer};
use crate::plan::{Comparison, Planner};
use eyebox_kernels::fft::{Columns, Direction, transform_f64};
use eyebox_kernels::{Complex64, half};
use std::sync::PoisonError;
use std::time::{SystemTime, UNIX_EPOCH};

/// Largest error power over signal power that passes. Correct results leave 1e-13, and wrong ones most of 1.
const ALLOWED: f64 = 1e-10;

impl VulkanEngine {
    /// Makes an engine on a device. [`load`](Engine::load) makes the buffers.
    ///
    /// # Errors
    /// The errors of the device, and [`EngineError::WrongResults`] if an untested device computes wrong results.
    pub fn new(gpu: &Gpu) -> Result<Self, EngineError> {
        check(gpu)?;
        Self::untested(gpu)
    }
}

/// Tests the device, unless it was tested before with this driver and these kernels.
///
/// # Errors
/// [`EngineError::WrongResults`], and the errors of the device.
pub(crate) fn check(gpu: &Gpu) -> Result<(), EngineError> {
    let device = &gpu.device;
    // A second caller waits for the first.
    let mut is_tested = device.is_tested.lock().unwrap_or_else(PoisonError::into_inner);
    if *is_tested || device.record_only {
        return Ok(());
    }
    if let Some(tested) = device.record.as_ref().and_then(|record| record.read()) {
        if !tested.halves {
            device.pipelines().make_halves();
        }
        *is_tested = true;
        return Ok(());
    }
    let halves = packs_halves(&mut Commands::new(gpu)?)?;
    if !halves {
        device.pipelines().make_halves();
    }
    let [transfer, transform] = errors(VulkanEngine::untested(gpu)?)?;
    judge(&device.report, "the propagation kernel", transfer)?;
    judge(&device.report, "a transform", transform)?;
    let at_unix_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let tested = Tested { at_unix_s, transfer, transform, halves };
    tracing::debug!("{}: tested, error power {transfer:.1e} and {transform:.1e}", device.report.name);
    if let Some(record) = &device.record {
        record.write(tested);
    }
    *is_tested = true;
    Ok(())
}

/// Returns true if the device packs all halves, and the values between and beyond them, like [`half::pack`], on both
/// sides of zero.
fn packs_halves(gpu: &mut Commands) -> Result<bool, EngineError> {
    const LARGEST: u16 = 0x7bff;
    let about = |bits: u16| {
        let (value, next) = (half::value(bits), if bits == LARGEST { 65536.0 } else { half::value(bits + 1) });
        let between = (value + next) / 2.0;
        [value, between.next_down(), between, between.next_up()]
    };
    let factors: Vec<f32> = (0..=LARGEST).flat_map(about).chain([f32::MAX, f32::INFINITY]).collect();
    let mut got = half::pack(&[1.0, -1.0].repeat(factors.len()));
    let want = half::pack(&factors.iter().flat_map(|x| [*x, -x]).collect::<Vec<_>>());
    let bytes = 2 * got.len() as u64;
    let (ones, scale) =
        (gpu.filled(bytemuck::cast_slice(&got), "ones")?, gpu.filled(bytemuck::cast_slice(&factors), "halves")?);
    let pipeline = gpu.pipeline(eyebox_spirv::APPLY_FACTOR.stored(true), 2, &[])?;
    let count = factors.len() as u32;
    gpu.recorder.begin(0)?;
    let groups = [count.div_ceil(eyebox_kernels::WIDTH), 1, 1];
    gpu.recorder.dispatch(pipeline, &[scale.all(), ones.all()], bytemuck::cast_slice(&[count, count]), groups)?;
    gpu.recorder.submit("halves")?;
    gpu.download(&ones, bytemuck::cast_slice_mut(&mut got), [(0, 0, bytes)])?;
    Ok(got == want)
}

fn judge(report: &DeviceReport, what: &'static str, error: f64) -> Result<(), EngineError> {
    if error <= ALLOWED {
        return Ok(());
    }
    let (device, driver) = (report.name.clone(), report.driver.clone());
    Err(EngineError::WrongResults { device, driver, what, error, allowed: ALLOWED })
}

/// Returns error power over signal power of the propagation kernel and of a transform.
fn errors(mut engine: VulkanEngine) -> Result<[f64; 2], EngineError> {
    const SIZE: [usize; 2] = [60, 120];
    let [height, width] = SIZE;
    let invalid = |e: crate::optics::OpticsError| EngineError::mismatch(e.to_string());
    let optics = Optics::new(height, width, 8e-6, 520e-9, 0.4).map_err(invalid)?;
    let planner = Planner::new(optics, 1, WindowFactor::Two);
    let pupil = Pupil { x: 1e-3, y: -1e-3, diameter: 0.8 * optics.eyebox(), depth: 0.3 };
    let pass = planner.pupil_pass(&pupil, &Comparison::default());
    let mut step = planner.project_step(vec![pass], usize::MAX, 1.0, 1.0, 0.0);
    step.columns = Columns { first: 0, count: width };
    step.list = vec![
        Dispatch { kernel: Kernel::Transfer, pupil_passes: 0..1 },
        Dispatch { kernel: Kernel::FieldForward, pupil_passes: 0..0 },
    ];
    engine.load(&planner.shape(Purpose::View), None)?;
    let noise = |i: usize| ((i * 7919 + 13) % 1009) as f32 / 504.5 - 1.0;
    let field: Vec<f32> = (0..2 * height * width).map(noise).collect();
    engine.write(Buffer::Field, &field)?;
    engine.run(&step)?;

    let window = step.pupil_passes[0].window;
    let mut propagation = Vec::with_capacity(window.rows * window.columns);
    for row in 0..window.rows as i64 {
        for column in 0..window.columns as i64 {
            let (re, im) = transfer(&optics, &pupil, window.y0 + row, window.x0 + column);
            propagation.push(Complex64::new(re, im));
        }
    }
    let mut spectrum: Vec<Complex64> =
        field.chunks_exact(2).map(|z| Complex64::new(f64::from(z[0]), f64::from(z[1]))).collect();
    transform_f64(&mut spectrum, width, Direction::Forward);
    let mut turned: Vec<Complex64> = (0..height * width).map(|i| spectrum[i % height * width + i / height]).collect();
    transform_f64(&mut turned, height, Direction::Forward);
    let spectrum: Vec<Complex64> = (0..height * width).map(|i| turned[i % width * height + i / width]).collect();
    let got = [engine.read(Buffer::Transfer(0))?, engine.read(Buffer::Field)?];
    Ok([distance(&got[0], &propagation), distance(&got[1], &spectrum)])
}

/// Returns error power over signal power, infinite if a value is not a number.
fn distance(got: &[f32], want: &[Complex64]) -> f64 {
    let (mut error, mut power) = (0f64, 0f64);
    for (got, want) in got.chunks_exact(2).zip(want) {
        error += (Complex64::new(f64::from(got[0]), f64::from(got[1])) - want).norm_sqr();
        power += want.norm_sqr();
    }
    if got.len() == 2 * want.len() && (error / power).is_finite() { error / power } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{Options, devices};

    fn open(cache: &std::path::Path) -> Gpu {
        let options = Options { allow_cpu: true, cache: Some(cache.to_owned()), ..Options::default() };
        Gpu::open(&options).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn a_device_is_tried_once() {
        let folder = tempfile::tempdir().unwrap();
        let gpu = open(folder.path());
        let record = gpu.device.record.as_ref().unwrap();
        assert!(record.read().is_none());
        drop(VulkanEngine::new(&gpu).unwrap());
        let tested = record.read().unwrap();
        assert!(
            tested.halves && tested.transfer < 1e-12 && tested.transform < 1e-12 && tested.at_unix_s > 1_700_000_000,
            "{tested:?}"
        );
        // Neither this process nor the next one tests it again.
        for gpu in [gpu.clone(), open(folder.path())] {
            let before = gpu.counts();
            drop(VulkanEngine::new(&gpu).unwrap());
            assert_eq!(gpu.counts().since(before).submissions, 0);
        }
        // A record of another device, a truncated one or one of another form counts as none.
        for file in std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()) {
            if file.extension().is_some_and(|e| e == "json") {
                let text = std::fs::read_to_string(&file).unwrap();
                for wrong in [text.replacen("\"device\":\"", "\"device\":\"not ", 1), text[..20].into(), "[]".into()] {
                    std::fs::write(&file, wrong).unwrap();
                    assert!(record.read().is_none());
                }
            }
        }
        assert!(devices().unwrap().iter().all(|d| d.usable.is_ok() || d.tested.is_none()));
    }

    /// Halves are packed by the device, or by their bits if the device does not pack them correctly.
    #[test]
    fn halves_are_packed_either_way() {
        let folder = tempfile::tempdir().unwrap();
        let gpu = open(folder.path());
        assert!(packs_halves(&mut Commands::new(&gpu).unwrap()).unwrap());
        gpu.device.pipelines().make_halves();
        assert!(packs_halves(&mut Commands::new(&gpu).unwrap()).unwrap());
        // A device with a record of that is not tested again.
        let record = gpu.device.record.as_ref().unwrap();
        record.write(Tested { at_unix_s: 1, transfer: 0.0, transform: 0.0, halves: false });
        let next = open(folder.path());
        let packs = next.device.packs_halves();
        check(&next).unwrap();
        assert!(!next.device.packs_halves() && !gpu.device.packs_halves());
        record.write(Tested { at_unix_s: 1, transfer: 0.0, transform: 0.0, halves: true });
        let again = open(folder.path());
        check(&again).unwrap();
        assert_eq!(again.device.packs_halves(), packs);
        let made = next.device.pipelines_made().len();
        assert!(packs_halves(&mut Commands::new(&next).unwrap()).unwrap());
        assert_eq!(next.device.pipelines_made().len(), made + 1);
    }

    #[test]
    fn a_device_that_is_wrong_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let gpu = open(folder.path());
        let mut engine = VulkanEngine::untested(&gpu).unwrap();
        engine.pretend_wrong();
        let [transfer, transform] = errors(engine).unwrap();
        assert!(transfer > 1e-3 && transform > 1e-3, "{transfer:e} {transform:e}");
        let refused = judge(gpu.report(), "a transform", transform).unwrap_err();
        let EngineError::WrongResults { device, what, error, allowed, .. } = &refused else { panic!("{refused}") };
        assert_eq!(
            (device, *what, *error, *allowed),
            (&gpu.report().name, "a transform", transform, 1e-10),
            "{refused}"
        );
        assert!(judge(gpu.report(), "a transform", f64::INFINITY).is_err());
        assert!(judge(gpu.report(), "a transform", f64::NAN).is_err());
    }
}
