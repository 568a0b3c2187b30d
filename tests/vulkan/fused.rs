//! Fused kernels against the list that they replace, which runs entry by entry on the same device.

use eyebox::low_level::engine::vulkan::VulkanEngine;
use eyebox::low_level::engine::{Buffer, Engine, Kernel, Purpose, Step, Storage};
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox::low_level::optics::DisplayModel;
use eyebox::low_level::plan::ModelTables;
use eyebox_kernels::compare::{AMPLITUDE, INTENSITY, PROJECTION};
use eyebox_tests::both::{Case, Noise, assert_silent, distance, every_fault, watched};
use eyebox_tests::half_roundings;

/// Opens any device, with lists recorded as for a GPU.
fn fusing() -> VulkanEngine {
    let gpu = Gpu::open(&Options { plan_as: Some(DeviceKind::Discrete), ..watched() });
    let mut engine = VulkanEngine::new(&gpu.unwrap_or_else(|e| panic!("{e}"))).unwrap_or_else(|e| panic!("{e}"));
    engine.time_kernels(true);
    engine
}

/// Runs a step from the same random phases and velocity, in parts of the list that end at `cuts`. Returns losses,
/// phases and velocity.
fn run(
    engine: &mut VulkanEngine,
    case: &Case,
    purpose: Purpose,
    step: &Step,
    cuts: &[usize],
) -> (Vec<f64>, [Vec<f32>; 2]) {
    case.load(engine, purpose);
    engine.reset_timings();
    let shape = case.planner.shape(purpose);
    let count = shape.frames * shape.pixels();
    engine.write(Buffer::Phases, &Noise::new(5).between(count, -3.1, 3.1)).unwrap();
    engine.write(Buffer::Momentum, &Noise::new(6).between(count, -0.1, 0.1)).unwrap();
    let mut losses = vec![0.0; step.pupil_passes.len()];
    let mut start = 0;
    for &end in cuts.iter().chain([&step.list.len()]) {
        for (sum, loss) in losses.iter_mut().zip(engine.run_part(step, start..end).unwrap()) {
            *sum += loss;
        }
        start = end;
    }
    (losses, [Buffer::Phases, Buffer::Momentum].map(|buffer| engine.read(buffer).unwrap()))
}

/// Compares the whole step, and the step cut at each of `cuts`, with the step entry by entry.
fn compare(engine: &mut VulkanEngine, case: &Case, purpose: Purpose, step: &Step, cuts: &[usize], what: &str) {
    let singly: Vec<usize> = (1..step.list.len()).collect();
    let (want, list) = run(engine, case, purpose, step, &singly);
    let allowed = match case.planner.storage {
        Storage::F32 => 1e-12,
        // Values that are not stored in between are not rounded. This is eight times, and eight more if a model stores
        // drives and reads them back.
        Storage::F16 => 20.0 * half_roundings(if case.planner.model.is_some() { 16 } else { 8 }),
    };
    for cut in [None].into_iter().chain(cuts.iter().map(Some)) {
        let what = format!("{what}, cut at {cut:?}");
        let (losses, got) = run(engine, case, purpose, step, &cut.copied().into_iter().collect::<Vec<_>>());
        // Columns of an odd width have no pairs.
        if cut.is_none() && case.planner.grid.width.is_multiple_of(2) {
            let ran: Vec<Kernel> = engine.timings().iter().map(|t| t.kernel).collect();
            let mut fused = vec![Kernel::FieldForward, Kernel::Intensity, Kernel::ChangeInverse];
            // No other kernel may be between the results of the pupils and the change of the field.
            if step.list.iter().all(|d| d.kernel != Kernel::EqualiseEyebox) {
                fused.extend([Kernel::Clear, Kernel::DivideByOverlap]);
            }
            assert!(fused.iter().all(|kernel| !ran.contains(kernel)), "{what}: {ran:?}");
        }
        for (got, want) in losses.iter().zip(&want) {
            assert!(*want > 0.0 && (got / want - 1.0).abs() < allowed.sqrt(), "{what}: loss {got}, not {want}");
        }
        for (buffer, (got, want)) in [Buffer::Phases, Buffer::Momentum].into_iter().zip(got.iter().zip(&list)) {
            let far = distance(buffer, got, want);
            assert!(far < allowed, "{what}: {buffer:?} differs by {far:e}");
        }
    }
}

#[test]
fn fused_steps_are_those_of_the_list() {
    let mut engine = fusing();
    for (height, width, padding, frames) in [(44, 64, 0, 3), (40, 36, 4, 2), (64, 64, 0, 8), (45, 60, 0, 1)] {
        let case = Case::new(height, width, padding, 4e-3, frames);
        for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY), (Purpose::Adam, AMPLITUDE)]
        {
            for in_flight in [usize::MAX, 3000] {
                let what = format!("{height} x {width} (+{padding}), {purpose:?}, mode {mode}, {in_flight} in flight");
                let step = case.step(purpose, mode, 0.5, in_flight);
                compare(&mut engine, &case, purpose, &step, &[], &what);
            }
        }
    }
    // The list is cut at each place.
    let case = Case::new(40, 44, 4, 4e-3, 2);
    let step = case.step(Purpose::Project, PROJECTION, 1.0, 3000);
    let cuts: Vec<usize> = (1..step.list.len()).collect();
    compare(&mut engine, &case, Purpose::Project, &step, &cuts, "cut");
    assert_silent(engine);
}

#[test]
fn fused_steps_with_halves_are_those_of_the_list() {
    let mut engine = fusing();
    for (height, width, padding, frames) in [(44, 64, 0, 3), (40, 36, 4, 2), (64, 64, 0, 8)] {
        let mut case = Case::new(height, width, padding, 4e-3, frames);
        (case.planner.storage, case.planner.binary_angles) = (Storage::F16, frames != 2);
        let step = case.step(Purpose::Project, PROJECTION, 0.5, 3000);
        compare(&mut engine, &case, Purpose::Project, &step, &[], &format!("{height} x {width} in halves"));
    }
    assert_silent(engine);
}

/// Lists with more kernels at their ends. These are every term of a display model, windows of the short-time Fourier
/// transform, and an even eyebox.
#[test]
fn other_lists_fused_are_those_of_the_list() {
    let mut engine = fusing();
    for storage in [Storage::F32, Storage::F16] {
        let mut case = Case::new(44, 64, 0, 4e-3, 3);
        (case.planner.storage, case.planner.binary_angles) = (storage, true);
        let (slm, grid) = (case.planner.slm, case.planner.grid);
        case.planner.model = ModelTables::new(every_fault(), 11e-3, 256, slm, grid).map(|model| model.for_steps());
        // Adam's first steps keep only the sign of a gradient, and halves change some signs.
        let modes = [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY)];
        for (purpose, mode) in &modes[..if storage == Storage::F16 { 1 } else { 2 }] {
            let (purpose, mode) = (*purpose, *mode);
            let step = case.step(purpose, mode, 0.5, 3000);
            let after = |kernel| step.list.iter().position(|d| d.kernel == kernel).unwrap() + 1;
            use Kernel::{ChangeInverse, Drive, DriveAdjoint, LagAdjoint, ModulateWave, PhaseGradient};
            let cuts = [Drive, ModulateWave, ChangeInverse, PhaseGradient, LagAdjoint, DriveAdjoint].map(after);
            compare(&mut engine, &case, purpose, &step, &cuts, &format!("every term, {purpose:?}, {storage:?}"));
        }
    }
    let case = Case::new(44, 64, 0, 4e-3, 3);
    let eyebox = 0.8 * case.planner.slm.eyebox();
    for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY)] {
        compare(&mut engine, &case, purpose, &case.stft_step(purpose, mode), &[], &format!("tapered, {purpose:?}"));
        let step = case.planner.with_equalised_eyebox(case.step(purpose, mode, 0.5, 3000), eyebox, 5, 0.4);
        compare(&mut engine, &case, purpose, &step, &[step.list.len() - 1], &format!("even, {purpose:?}"));
    }
    assert_silent(engine);
}

/// Computes the effect of a display model on pixels by tiles that extend over the SLM, wrap around it and do not fit
/// it, with different terms. If crosstalk reaches too far for shared memory, the list runs entry by entry.
#[test]
fn tiles_of_models_are_those_of_the_list() {
    let mut engine = fusing();
    let every = every_fault();
    let [mut lag, mut level, mut crosstalk] = [(); 3].map(|()| DisplayModel::default());
    lag.lag = every.lag;
    (level.level, level.bend) = (every.level, every.bend);
    crosstalk.crosstalk = every.crosstalk;
    for (model, (height, width), padding, frames, fits) in [
        (&lag, (45, 64), 0, 3, true),
        (&level, (33, 40), 0, 2, true),
        (&crosstalk, (45, 38), 4, 1, true),
        (&every, (70, 66), 0, 2, true),
        (&every, (8, 12), 2, 2, true),
        (&every, (96, 96), 0, 1, false),
    ] {
        for storage in [Storage::F32, Storage::F16] {
            let mut case = Case::new(height, width, padding, 4e-3, frames);
            (case.planner.storage, case.planner.binary_angles) = (storage, true);
            let (slm, grid) = (case.planner.slm, case.planner.grid);
            let exact = ModelTables::new(model.clone(), 11e-3, 256, slm, grid);
            case.planner.model = if fits { exact.map(|model| model.for_steps()) } else { exact };
            let step = case.step(Purpose::Project, PROJECTION, 0.5, usize::MAX);
            let what = format!("{height} x {width} (+{padding}), {storage:?}, {model:?}");
            compare(&mut engine, &case, Purpose::Project, &step, &[], &what);
            run(&mut engine, &case, Purpose::Project, &step, &[]);
            let ran = |kernel| engine.timings().iter().any(|t| t.kernel == kernel);
            // Half of the usual shared memory does not fit every tile.
            if engine.gpu().report().limits.shared_memory >= 32_768 {
                assert_eq!([Kernel::CrosstalkRows, Kernel::DriveAdjoint].map(ran), [!fits; 2], "{what}");
            }
        }
    }
    assert_silent(engine);
}

/// An odd width is not fused, whatever the other pupils are. Here their windows have an even width and the same height.
#[test]
fn odd_widths_are_those_of_the_list() {
    let mut engine = fusing();
    for storage in [Storage::F32, Storage::F16] {
        let mut case = Case::new(30, 31, 2, 4e-3, 2);
        case.planner.storage = storage;
        for purpose in [Purpose::Project, Purpose::Adam] {
            let mode = if purpose == Purpose::Adam { INTENSITY } else { PROJECTION };
            let step = case.step(purpose, mode, 0.5, usize::MAX);
            let widths: Vec<_> = step.pupil_passes.iter().map(|p| (p.window.rows, p.window.columns)).collect();
            assert!(widths.contains(&(32, 33)) && widths.iter().any(|(_, w)| w % 2 == 0), "{widths:?}");
            compare(&mut engine, &case, purpose, &step, &[], &format!("32 x 33, {purpose:?}, {storage:?}"));
        }
    }
    assert_silent(engine);
}

/// Rows of a large number of sub-frames do not fit shared memory all at once.
#[test]
fn rows_that_do_not_fit_go_in_two_kernels() {
    let mut engine = fusing();
    let case = Case::new(16, 600, 0, 1e-3, 19);
    let step = case.step(Purpose::Project, PROJECTION, 1.0, usize::MAX);
    compare(&mut engine, &case, Purpose::Project, &step, &[], "600 columns");
    assert_silent(engine);
}
