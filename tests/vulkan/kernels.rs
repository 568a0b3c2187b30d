//! Each kernel on the device against its CPU twin. The error power is below 1e-10 of the signal power, and the
//! validation layer has no messages. With fields stored as halves, the error is below the power of the roundings in
//! which the two may differ.

use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::engine::vulkan::VulkanEngine;
use eyebox::low_level::engine::{Buffer, Engine, EngineError, Kernel, Memory, Purpose, Shape, Storage};
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox::low_level::optics::Prescription;
use eyebox::low_level::plan::{EyeTables, ModelTables};
use eyebox_kernels::compare::{AMPLITUDE, INTENSITY, PROJECTION};
use eyebox_tests::both::{Case, assert_silent, compare, every_fault, vulkan, watched};
use eyebox_tests::half_roundings;

const SIZES: [(usize, usize, usize); 6] = [(1, 1, 0), (7, 13, 0), (45, 64, 0), (64, 64, 0), (31, 50, 3), (5, 130, 11)];
const DEPTHS: [f64; 6] = [0.0, 1e-6, -15e-3, 0.3, 1.0, -1.0];

fn check(kernel: Kernel, purpose: Purpose, mode: u32, power: f64) {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    for (height, width, padding) in SIZES {
        for frames in [1, 3] {
            let case = Case::new(height, width, padding, 15e-3, frames);
            let step = case.single(purpose, mode, power, kernel);
            let worst = compare(&mut engine, &mut twin, &case, purpose, &step);
            assert!(worst < 1e-10, "{} at {height} x {width} (+{padding}): {worst:e}", kernel.name());
            let mut half = case;
            (half.planner.storage, half.planner.binary_angles) = (Storage::F16, true);
            let step = half.single(purpose, mode, power, kernel);
            let worst = compare(&mut engine, &mut twin, &half, purpose, &step);
            let bound = stored_bound(kernel);
            assert!(worst < bound, "{} at {height} x {width} (+{padding}), fp16: {worst:e}", kernel.name());
        }
    }
    assert!(engine.timings().iter().all(|t| t.kernel == kernel && t.calls == 4 * SIZES.len() as u64));
    assert_silent(engine);
}

/// Returns the allowed error power for fields stored as halves. Both engines round in the same way, so a kernel without
/// a transform stores the same halves. Exceptions are values that float32 rounding, a ten-thousandth of a half's, puts
/// on the other side of a tie. This is one value in about a thousand, by one unit. The device stores a transform after
/// each pass, and the twin after each axis. The longest has seven passes and two axes.
fn stored_bound(kernel: Kernel) -> f64 {
    match kernel {
        Kernel::FieldForward
        | Kernel::WindowForward
        | Kernel::WindowInverse
        | Kernel::ChangeInverse
        | Kernel::SubpixelsForward
        | Kernel::SubpixelsInverse => half_roundings(9),
        // A sum over neighbors is rounded to float32 at each of them.
        Kernel::CrosstalkRows | Kernel::CrosstalkColumns | Kernel::CrosstalkColumnsBack | Kernel::CrosstalkRowsBack => {
            6e-3 * half_roundings(1)
        }
        // A power is accurate to a few float32 roundings only. In proportion, more values are near a tie. Some compilers
        // fuse the products and sums of the drive (LLVM 22 of Mesa 26.2, with a difference of 4e-3).
        Kernel::DivideByOverlap | Kernel::DriveAdjoint => 6e-3 * half_roundings(1),
        _ => 2e-3 * half_roundings(1),
    }
}

macro_rules! kernels {
    ($($name:ident: $kernel:ident, $purpose:ident, $mode:expr, $power:expr;)*) => {
        $(#[test] fn $name() { check(Kernel::$kernel, Purpose::$purpose, $mode, $power); })*
    };
}

kernels! {
    clear: Clear, Project, PROJECTION, 1.0;
    modulate: Modulate, Project, PROJECTION, 1.0;
    field_forward: FieldForward, View, PROJECTION, 1.0;
    overlap: Overlap, Project, PROJECTION, 1.0;
    transfer: Transfer, View, PROJECTION, 1.0;
    taper: Taper, View, PROJECTION, 1.0;
    energy: Energy, Project, PROJECTION, 1.0;
    equalise_projection: EqualiseEyebox, Project, PROJECTION, 1.0;
    equalise_gradient: EqualiseEyebox, Adam, INTENSITY, 1.0;
    photograph: Photograph, View, PROJECTION, 1.0;
    resample: Resample, View, PROJECTION, 1.0;
    pass_pupil: PassPupil, View, PROJECTION, 1.0;
    motion: Motion, Project, PROJECTION, 1.0;
    motion_back: MotionBack, Project, PROJECTION, 1.0;
    window_inverse: WindowInverse, View, PROJECTION, 1.0;
    intensity: Intensity, View, PROJECTION, 1.0;
    compare_projection: Compare, Project, PROJECTION, 1.0;
    compare_intensity: Compare, Adam, INTENSITY, 1.0;
    compare_amplitude: Compare, Adam, AMPLITUDE, 1.0;
    apply_factor: ApplyFactor, Project, PROJECTION, 1.0;
    window_forward: WindowForward, View, PROJECTION, 1.0;
    pupil_adjoint: PupilAdjoint, Project, PROJECTION, 1.0;
    divide_by_overlap_mean: DivideByOverlap, Project, PROJECTION, 1.0;
    divide_by_overlap_root: DivideByOverlap, Project, PROJECTION, 0.5;
    divide_by_overlap_between: DivideByOverlap, Project, PROJECTION, 0.7;
    change_inverse: ChangeInverse, Project, PROJECTION, 1.0;
    project: Project, Project, PROJECTION, 1.0;
    adam: Adam, Adam, INTENSITY, 1.0;
    exposure: Exposure, View, PROJECTION, 1.0;
}

/// For an SLM with levels, the shown levels make the field, and the phases behind them move.
#[test]
fn levels() {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    for (height, width, padding) in SIZES {
        let mut case = Case::new(height, width, padding, 15e-3, 3);
        case.planner.levels = 11;
        for (kernel, purpose, mode) in [
            (Kernel::Quantise, Purpose::View, PROJECTION),
            (Kernel::Modulate, Purpose::View, PROJECTION),
            (Kernel::Project, Purpose::Project, PROJECTION),
            (Kernel::Adam, Purpose::Adam, INTENSITY),
        ] {
            let step = case.single(purpose, mode, 0.5, kernel);
            let worst = compare(&mut engine, &mut twin, &case, purpose, &step);
            assert!(worst < 1e-10, "{} at {height} x {width} (+{padding}): {worst:e}", kernel.name());
        }
    }
    assert_silent(engine);
}

/// The tests run the kernels between phases and field on a display with every fault, and the effect of its relay on the
/// bins.
#[test]
fn display_models() {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    for (height, width, padding) in [SIZES[0], SIZES[1], SIZES[3], SIZES[4]] {
        for (frames, levels, storage, subpixels) in
            [(3, 0, Storage::F32, 1), (2, 11, Storage::F32, 3), (1, 0, Storage::F16, 1), (3, 0, Storage::F16, 2)]
        {
            let mut case = Case::new(height, width, padding, 15e-3, frames);
            let (slm, grid) = (case.planner.slm, case.planner.grid);
            (case.planner.levels, case.planner.storage) = (levels, storage);
            case.planner.binary_angles = true;
            let mut model = every_fault();
            model.subpixels = subpixels;
            case.planner.model = ModelTables::new(model, 11e-3, 256, slm, grid);
            let of_pixels = [Kernel::ModulateWave, Kernel::FieldForward, Kernel::ChangeInverse, Kernel::PhaseGradient];
            let of_subpixels = [
                Kernel::ModulateSubpixels,
                Kernel::SubpixelsForward,
                Kernel::SubpixelsInverse,
                Kernel::PhaseGradientSubpixels,
            ];
            let others = [
                Kernel::Drive,
                Kernel::Lag,
                Kernel::CrosstalkRows,
                Kernel::CrosstalkColumns,
                Kernel::Relay,
                Kernel::CrosstalkColumnsBack,
                Kernel::CrosstalkRowsBack,
                Kernel::LagAdjoint,
                Kernel::DriveAdjoint,
                Kernel::Project,
            ];
            for kernel in others.into_iter().chain(if subpixels == 1 { of_pixels } else { of_subpixels }) {
                let step = case.single(Purpose::Project, PROJECTION, 1.0, kernel);
                let worst = compare(&mut engine, &mut twin, &case, Purpose::Project, &step);
                let limit = if storage == Storage::F16 { stored_bound(kernel) } else { 1e-10 };
                assert!(worst < limit, "{} at {height} x {width} (+{padding}): {worst:e}", kernel.name());
            }
        }
    }
    assert_silent(engine);
}

/// The error of an eye has terms of the second order and of higher orders.
#[test]
fn eyes() {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    let mut measured = Prescription::new(-0.5, 0.25, 30.0);
    (measured.zernikes_um, measured.measured_mm) = ([(7, 0.3), (12, -0.2), (27, 0.02)].into(), 6.0);
    for (height, width, padding) in SIZES {
        for eye in [Prescription::new(-3.0, 1.0, 70.0), measured.clone()] {
            let mut case = Case::new(height, width, padding, 15e-3, 2);
            case.planner.eye = EyeTables::new(Some(&eye));
            let step = case.single(Purpose::View, PROJECTION, 1.0, Kernel::Eye);
            let worst = compare(&mut engine, &mut twin, &case, Purpose::View, &step);
            assert!(worst < 1e-10, "{eye} at {height} x {width} (+{padding}): {worst:e}");
        }
    }
    assert_silent(engine);
}

/// One NaN or infinite value at any place makes all losses NaN on both engines. Without such a value they are finite.
#[test]
fn check_finite() {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    for (height, width, frames) in [(1, 1, 1), (7, 13, 3), (45, 64, 2)] {
        let mut case = Case::new(height, width, 0, 0.0, frames);
        case.planner.storage = Storage::F16;
        let step = case.single(Purpose::Project, PROJECTION, 1.0, Kernel::CheckFinite);
        for engine in [&mut engine as &mut dyn Engine, &mut twin] {
            case.load(engine, Purpose::Project);
            let mut change = vec![65504.0; 2 * frames * height * width];
            let last = change.len() - 1;
            for (at, value) in [
                (0, 1.0),
                (0, f32::NAN),
                (last, -65504.0),
                (last, f32::NEG_INFINITY),
                (last / 2, 65520.0),
                (1, -65519.0),
            ] {
                change.fill(-65504.0);
                change[at] = value;
                engine.write(Buffer::Change, &change).unwrap();
                let found = engine.run(&step).unwrap().iter().all(|l| l.is_nan());
                assert_eq!(found, value.is_nan() || value.abs() >= 65520.0, "{value} at {at}, {}", engine.describe());
            }
        }
    }
    // The kernel requires buffers of halves.
    let case = Case::new(7, 13, 0, 0.0, 1);
    case.load(&mut engine, Purpose::Project);
    let text = engine
        .run(&case.single(Purpose::Project, PROJECTION, 1.0, Kernel::CheckFinite))
        .expect_err("it ran")
        .to_string();
    assert!(text.contains("check_finite") && text.contains("fp32"), "{text}");
    assert_silent(engine);
}

/// The phase reaches thousands of turns, and no turn is lost. The twin computes it in float64.
#[test]
fn transfer_at_every_depth() {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    for depth in DEPTHS {
        let case = Case::new(64, 90, 0, depth, 1);
        let step = case.single(Purpose::View, PROJECTION, 1.0, Kernel::Transfer);
        let worst = compare(&mut engine, &mut twin, &case, Purpose::View, &step);
        assert!(worst < 1e-10, "depth {depth}: {worst:e}");
    }
    // A large display has this number of bins, and the squares of their indices need more than float32.
    for depth in [1.0, 10.0] {
        let case = Case::new(2, 16384, 0, depth, 1);
        let step = case.single(Purpose::View, PROJECTION, 1.0, Kernel::Transfer);
        let worst = compare(&mut engine, &mut twin, &case, Purpose::View, &step);
        assert!(worst < 1e-10, "16384 bins at {depth} m: {worst:e}");
    }
    assert_silent(engine);
}

#[test]
fn a_device_that_is_not_there_is_named_and_help_is_offered() {
    let options = Options { device: Some("no such device".into()), ..Options::default() };
    let Err(error) = Gpu::open(&options) else { panic!("it opened") };
    let text = error.to_string();
    assert!(matches!(error, EngineError::NoDevice { .. }), "{text}");
    assert!(text.contains("no such device") && text.contains("tools/setup.sh"), "{text}");
}

/// Compiled pipelines are stored in the folder from the options, and a second start reads them.
#[test]
fn compiled_pipelines_are_kept_where_they_are_wanted() {
    let temp = tempfile::tempdir().expect("a temporary folder");
    let folder = temp.path().join("cache");
    let run = || {
        let mut engine =
            VulkanEngine::new(&Gpu::open(&Options { cache: Some(folder.clone()), ..watched() }).expect("a device"))
                .expect("an engine");
        let case = Case::new(7, 13, 0, 0.0, 1);
        case.load(&mut engine, Purpose::Project);
        engine.run(&case.step(Purpose::Project, PROJECTION, 1.0, usize::MAX)).expect("a step");
        let (kind, driver) = (engine.gpu().report().kind, engine.gpu().report().driver.clone());
        assert_silent(engine);
        let files = std::fs::read_dir(&folder).expect("a folder").map(|f| f.expect("a file").path());
        // Another file in the folder stores the time of the device's test.
        let files: Vec<_> = files.filter(|f| f.extension().is_some_and(|e| e == "bin")).collect();
        // The software device of newer Mesas gives nothing to store.
        let major = driver.split_once("Mesa ").and_then(|(_, version)| version.split('.').next()?.parse().ok());
        if kind == DeviceKind::Cpu && major.is_some_and(|major: u32| major >= 26) {
            assert!(files.is_empty(), "{files:?}");
            return None;
        }
        assert_eq!(files.len(), 1, "{files:?}");
        Some(std::fs::metadata(&files[0]).and_then(|m| m.modified()).expect("a time"))
    };
    // The second start has nothing to add, so it leaves the file unchanged.
    assert_eq!(run(), run());
}

/// There is no driver, because the loader looks in a folder without one.
#[test]
fn a_missing_driver_is_a_sentence_with_help() {
    const FILES: [&str; 2] = ["VK_ICD_FILENAMES", "VK_DRIVER_FILES"];
    const NOWHERE: &str = "/nonexistent/driver.json";
    if std::env::var(FILES[0]).is_ok_and(|v| v == NOWHERE) {
        let Err(error) = Gpu::open(&Options { allow_cpu: true, ..Options::default() }) else {
            panic!("a device without a driver")
        };
        let text = error.to_string();
        assert!(matches!(error, EngineError::NoDevice { .. }), "{text}");
        assert!(text.contains("tools/setup.sh") && !text.contains('\n'), "{text}");
        return;
    }
    let tests = std::env::current_exe().expect("this test's file");
    let mut child = std::process::Command::new(tests);
    child.args(["--exact", "kernels::a_missing_driver_is_a_sentence_with_help"]).envs(FILES.map(|f| (f, NOWHERE)));
    let output = child.output().expect("the test runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
}

/// A request for too much memory is an error of one sentence, and the engine still works for a smaller one.
#[test]
fn too_much_is_refused_and_less_still_works() {
    let mut engine = vulkan();
    let case = Case::new(16, 24, 0, 0.0, 2);
    let good = case.planner.shape(Purpose::Project);
    let frames = 1 << 40;
    let error = engine.load(&Shape { frames, ..good }, None).expect_err("it loaded");
    let EngineError::OutOfMemory { what, wanted: Some(wanted), .. } = &error else { panic!("{error}") };
    match engine.memory() {
        // The host's memory is checked for all buffers at once. A device refuses the first one, which has the phases.
        Memory::Device => {
            assert!(what.starts_with("phases") && *wanted == (4 * good.pixels() * frames) as u64, "{error}")
        }
        _ => assert!(what.contains(&frames.to_string()), "{error}"),
    }
    case.load(&mut engine, Purpose::Project);
    engine.run(&case.step(Purpose::Project, PROJECTION, 1.0, usize::MAX)).expect("a step");
    assert_silent(engine);
}

#[test]
fn a_step_that_does_not_fit_is_refused() {
    let mut engine = vulkan();
    let case = Case::new(16, 24, 0, 0.0, 2);
    case.load(&mut engine, Purpose::Project);
    let good = case.step(Purpose::Project, PROJECTION, 1.0, usize::MAX);
    let refused = |engine: &mut VulkanEngine, step| {
        let error = engine.run(&step).expect_err("it ran");
        assert!(matches!(error, EngineError::Mismatch { .. }), "{error}");
    };
    let mut step = good.clone();
    step.pupil_passes[1].spans.pop();
    refused(&mut engine, step);
    let mut step = good.clone();
    step.pupil_passes[0].spans[0] = [0, 10_000];
    refused(&mut engine, step);
    let mut step = good.clone();
    step.pupil_passes[0].intensity.frames = 9;
    refused(&mut engine, step);
    let mut step = good.clone();
    step.pupil_passes[2].shot.as_mut().unwrap().taps[0].view = 9;
    refused(&mut engine, step);
    let mut step = good.clone();
    step.list[3].pupil_passes = 0..7;
    refused(&mut engine, step);
    refused(&mut engine, Case::new(16, 26, 0, 0.0, 2).step(Purpose::Project, PROJECTION, 1.0, usize::MAX));
    refused(&mut engine, case.step(Purpose::Adam, INTENSITY, 1.0, usize::MAX));
    assert!(engine.write(Buffer::Phases, &[0.0; 3]).is_err());
    assert!(engine.read(Buffer::Second).is_err());
    assert!(engine.read(Buffer::Window(0)).is_err());
    assert_silent(engine);
}

/// Runs every kernel at the size of the paper's display, and at primes.
#[test]
fn large_sizes() {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    for (height, width) in [(1080, 1920), (211, 307)] {
        let case = Case::new(height, width, 0, 1.0, 1);
        let (projects, adam) = (Purpose::Project, Purpose::Adam);
        let list: Vec<Kernel> =
            case.step(projects, PROJECTION, 0.5, usize::MAX).list.iter().map(|d| d.kernel).collect();
        let all = || {
            let more = [(Kernel::Adam, adam, INTENSITY), (Kernel::Exposure, Purpose::View, PROJECTION)];
            list.iter().map(|k| (*k, projects, PROJECTION)).chain(more)
        };
        for (kernel, purpose, mode) in all() {
            let step = case.single(purpose, mode, 0.5, kernel);
            let worst = compare(&mut engine, &mut twin, &case, purpose, &step);
            assert!(worst < 1e-10, "{} at {height} x {width}: {worst:e}", kernel.name());
        }
        let mut half = case;
        half.planner.storage = Storage::F16;
        for (kernel, purpose, mode) in all() {
            let step = half.single(purpose, mode, 0.5, kernel);
            let worst = compare(&mut engine, &mut twin, &half, purpose, &step);
            assert!(worst < stored_bound(kernel), "{} at {height} x {width}, fp16: {worst:e}", kernel.name());
        }
    }
    assert_silent(engine);
}

/// One patch has a whole large spectrum of several sub-frames. This is the longest possible sum, and it is computed in
/// shares.
#[test]
fn the_light_of_a_large_patch() {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    for storage in Storage::ALL {
        let mut case = Case::new(1200, 1300, 0, 0.0, 6);
        case.planner.storage = storage;
        let (planner, step) = (&case.planner, case.step(Purpose::Project, PROJECTION, 1.0, usize::MAX));
        let mut step = planner.with_equalised_eyebox(step, planner.slm.eyebox(), 1, 0.5);
        step.list.retain(|d| d.kernel == Kernel::Energy);
        let worst = compare(&mut engine, &mut twin, &case, Purpose::Project, &step);
        assert!(worst < 1e-10, "{storage:?}: {worst:e}");
    }
    assert_silent(engine);
}

/// lavapipe takes its vector width from a variable. No other code may depend on this width.
#[test]
fn every_subgroup_size() {
    const WIDTH: &str = "LP_NATIVE_VECTOR_WIDTH";
    if let Some(width) = std::env::var_os(WIDTH) {
        // The loop below runs this. The other tests do the work, and this one checks that the width is in effect.
        let engine = vulkan();
        let device = engine.gpu().report();
        if device.name.contains("llvmpipe") {
            assert_eq!(Ok(device.limits.subgroup * 32), width.to_string_lossy().parse());
        }
        return;
    }
    // The other tests run with this machine's own width.
    let own = (vulkan().gpu().report().limits.subgroup * 32).to_string();
    for width in ["128", "256", "512"].into_iter().filter(|width| *width != own) {
        let tests = std::env::current_exe().expect("this test's file");
        let output = std::process::Command::new(tests)
            .env(WIDTH, width)
            .args(["kernels::", "--skip", "large_sizes"])
            .output()
            .expect("the tests run");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "with vectors of {width} bits:\n{text}");
    }
}
