//! Both engines run the same lists of whole steps, and one may hand over to the other at any point.

use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::engine::vulkan::VulkanEngine;
use eyebox::low_level::engine::{At, Buffer, Engine, EngineError, Handover, Kernel, Purpose, Step, Storage};
use eyebox::low_level::evaluate::{self, Sums};
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox::low_level::plan::{Comparison, Viewpoint};
use eyebox::low_level::solve::Validator;
use eyebox_kernels::compare::{AMPLITUDE, INTENSITY, PROJECTION};
use eyebox_tests::both::{Case, Noise, assert_silent, distance, vulkan, watched};
use eyebox_tests::half_roundings;

/// Runs `steps` from the same random phases, and returns the losses and the phases.
pub(crate) fn solve(
    engine: &mut dyn Engine,
    case: &Case,
    purpose: Purpose,
    steps: &[Step],
) -> (Vec<Vec<f64>>, Vec<f32>) {
    case.load(engine, purpose);
    let shape = case.planner.shape(purpose);
    let phases = Noise::new(5).between(shape.frames * shape.pixels(), -3.1, 3.1);
    engine.write(Buffer::Phases, &phases).unwrap();
    let losses = steps.iter().map(|s| engine.run(s).unwrap_or_else(|e| panic!("{e}"))).collect();
    (losses, engine.read(Buffer::Phases).unwrap())
}

/// Returns a few steps, with the pupil passes in one group and in several.
pub(crate) fn steps(case: &Case, purpose: Purpose, mode: u32) -> Vec<Step> {
    [usize::MAX, 1, 3000].map(|in_flight| case.step(purpose, mode, 0.5, in_flight)).to_vec()
}

pub(crate) fn assert_close(got: &(Vec<Vec<f64>>, Vec<f32>), want: &(Vec<Vec<f64>>, Vec<f32>), what: &str) {
    for (got, want) in got.0.iter().flatten().zip(want.0.iter().flatten()) {
        assert!(*want > 0.0 && (got / want - 1.0).abs() < 1e-4, "{what}: loss {got}, not {want}");
    }
    // Each step amplifies the rounding of the last step a little at points where a field is nearly zero.
    let far = distance(Buffer::Phases, &got.1, &want.1);
    assert!(far < 1e-8, "{what}: phases differ by {far:e}");
}

/// Checks that both engines show the same image through each pupil of the case, from the same random phases.
pub(crate) fn assert_same_views(engine: &mut dyn Engine, case: &Case) {
    let mut twin = CpuEngine::new();
    let passes = case.pupils.iter().map(|p| case.planner.pupil_pass(p, &Comparison::default())).collect();
    let step = case.planner.view_step(passes);
    let shape = case.planner.shape(Purpose::View);
    let phases = Noise::new(3).between(shape.frames * shape.pixels(), -3.1, 3.1);
    for engine in [&mut *engine as &mut dyn Engine, &mut twin] {
        case.load(engine, Purpose::View);
        engine.write(Buffer::Phases, &phases).unwrap();
        engine.run(&step).unwrap();
    }
    for slot in 0..case.pupils.len() {
        let (got, want) = (engine.read(Buffer::Image(slot)).unwrap(), twin.read(Buffer::Image(slot)).unwrap());
        let far = distance(Buffer::Image(slot), &got, &want);
        assert!(far < 1e-10 && want.iter().sum::<f32>() > 0.0, "pupil {slot}: {far:e}");
    }
}

#[test]
fn both_engines_take_the_same_steps() {
    let mut engine = vulkan();
    for (height, width, padding, frames) in [(45, 64, 0, 3), (40, 36, 5, 2), (64, 64, 0, 8), (97, 61, 0, 1)] {
        let case = Case::new(height, width, padding, 4e-3, frames);
        for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY), (Purpose::Adam, AMPLITUDE)]
        {
            let steps = steps(&case, purpose, mode);
            let got = solve(&mut engine, &case, purpose, &steps);
            let want = solve(&mut CpuEngine::new(), &case, purpose, &steps);
            assert_close(&got, &want, &format!("{height} x {width}, {purpose:?}, mode {mode}"));
            // The same list on the same engine gives the same bits.
            assert_eq!(got, solve(&mut engine, &case, purpose, &steps));
        }
    }
    assert_silent(engine);
}

/// The pupils are eyes that move, windows of a stream, and an eye at rest.
#[test]
fn both_engines_take_the_same_steps_for_eyes_that_move() {
    let mut engine = vulkan();
    for (height, width, padding, frames) in [(45, 64, 0, 4), (40, 36, 5, 3)] {
        let case = Case::new(height, width, padding, 4e-3, frames);
        for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY)] {
            let steps = [usize::MAX, 1, 3000].map(|in_flight| case.moving_step(purpose, mode, in_flight));
            let got = solve(&mut engine, &case, purpose, &steps);
            let want = solve(&mut CpuEngine::new(), &case, purpose, &steps);
            assert_close(&got, &want, &format!("{height} x {width}, {purpose:?}, mode {mode}"));
        }
    }
    assert_silent(engine);
}

/// Any device runs the steps both by kernel and with the fused kernels of a GPU.
#[test]
fn both_engines_show_the_same_views_and_photographs() {
    let singly = [
        "modulate",
        "field_forward",
        "transfer",
        "photograph",
        "resample",
        "pass_pupil",
        "window_inverse",
        "intensity",
    ];
    let fused = ["modulate", "transfer", "photograph", "resample", "pass_pupil"];
    for (plan_as, ran) in [(DeviceKind::Cpu, &singly[..]), (DeviceKind::Discrete, &fused[..])] {
        let engine = VulkanEngine::new(&Gpu::open(&Options { plan_as: Some(plan_as), ..watched() }).unwrap()).unwrap();
        show_views_and_photographs(engine, ran);
    }
}

fn show_views_and_photographs(mut engine: VulkanEngine, ran: &[&str]) {
    engine.time_kernels(true);
    let case = Case::new(54, 70, 0, 4e-3, 4);
    let pupil_passes: Vec<_> = case.pupils.iter().map(|p| case.planner.pupil_pass(p, &Comparison::default())).collect();
    let (view, photograph) = (case.planner.view_step(pupil_passes.clone()), case.planner.photograph_step(pupil_passes));
    let mut twin = CpuEngine::new();
    let phases = Noise::new(3).between(4 * 54 * 70, -3.1, 3.1);
    for engine in [&mut engine as &mut dyn Engine, &mut twin] {
        case.load(engine, Purpose::View);
        engine.write(Buffer::Phases, &phases).unwrap();
    }
    for (step, buffer) in [(&view, Buffer::Image as fn(usize) -> Buffer), (&photograph, Buffer::Target)] {
        engine.run(step).unwrap();
        twin.run(step).unwrap();
        for slot in 0..case.pupils.len() {
            let (got, want) = (engine.read(buffer(slot)).unwrap(), twin.read(buffer(slot)).unwrap());
            let far = distance(buffer(slot), &got, &want);
            assert!(far < 1e-10 && want.iter().sum::<f32>() > 0.0, "{:?}: {far:e}", buffer(slot));
        }
    }
    let names: Vec<&str> = engine.timings().iter().map(|t| t.kernel.name()).collect();
    assert_eq!(names, ran);
    assert!(engine.timings().iter().all(|t| t.calls == 1 && t.seconds > 0.0), "{:?}", engine.timings());
    assert_silent(engine);
}

/// Slices of a wrong length are refused, and a refused read leaves its memory unchanged.
#[test]
fn buffers_are_written_and_read_whole_or_not_at_all() {
    let mut engine = vulkan();
    let case = Case::new(24, 20, 0, 4e-3, 2);
    let count = 2 * 24 * 20;
    let phases = Noise::new(8).between(count, -3.1, 3.1);
    for engine in [&mut engine as &mut dyn Engine, &mut CpuEngine::new()] {
        case.load(engine, Purpose::Project);
        engine.write(Buffer::Phases, &phases).unwrap();
        for wrong in [count - 1, count + 1, 0] {
            let refused = |error: EngineError| match error {
                EngineError::Mismatch { reason } => {
                    let has = |number: usize| reason.split([' ', ',']).any(|word| word == number.to_string());
                    assert!(reason.contains("Phases") && has(count) && has(wrong), "{reason}");
                }
                other => panic!("{other}"),
            };
            let (few, mut into) = (vec![1.0; wrong], vec![1.0; wrong]);
            refused(engine.write(Buffer::Phases, &few).unwrap_err());
            refused(engine.read_into(Buffer::Phases, &mut into).unwrap_err());
            assert_eq!(into, few, "the memory is unchanged");
        }
        assert!(engine.write(Buffer::Field, &[1.0; 3]).is_err(), "half a complex value");
        let mut back = vec![0.0; count];
        engine.read_into(Buffer::Phases, &mut back).unwrap();
        assert_eq!((&back, engine.read(Buffer::Phases).unwrap()), (&phases, phases.clone()));
    }
    assert_silent(engine);
}

/// The methods use viewpoints other than pupils, or request more than an image.
#[test]
fn both_engines_take_the_steps_of_every_method() {
    let mut engine = vulkan();
    for (height, width, padding, frames) in [(45, 64, 0, 3), (40, 36, 5, 2)] {
        let case = Case::new(height, width, padding, 4e-3, frames);
        for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY)] {
            let even = case.planner.with_equalised_eyebox(case.step(purpose, mode, 0.5, 3000), 0.02, 9, 0.5);
            for (what, step) in [("stft", case.stft_step(purpose, mode)), ("even", even)] {
                let steps = vec![step; 3];
                let got = solve(&mut engine, &case, purpose, &steps);
                let want = solve(&mut CpuEngine::new(), &case, purpose, &steps);
                assert_close(&got, &want, &format!("{what}, {height} x {width}, {purpose:?}"));
            }
        }
    }
    assert_silent(engine);
}

/// Bound for fields stored as halves. A field is rounded about twenty times on its way to the retina and back. The
/// device sometimes rounds between passes where the twin does not, so the requested change differs by this much. A
/// change moves phases by the gain, which is 2 here, and is itself at most about 1 in units of the phases. This gives
/// four times the power, for each of three steps.
const STEPS_APART: f64 = 20.0 * 4.0 * 3.0;

fn assert_near(got: &(Vec<Vec<f64>>, Vec<f32>), want: &(Vec<Vec<f64>>, Vec<f32>), amplified: f64, what: &str) {
    for (got, want) in got.0.iter().flatten().zip(want.0.iter().flatten()) {
        // A loss is a mean over pixels whose rounding errors average, so its error is much smaller than the error of a
        // pixel.
        assert!(*want > 0.0 && (got / want - 1.0).abs() < 2e-3, "{what}: loss {got}, not {want}");
    }
    let far = distance(Buffer::Phases, &got.1, &want.1);
    assert!(far < amplified * half_roundings(1), "{what}: phases differ by {far:e}");
}

/// With halves both engines take the same steps, and these are near the steps of float32.
#[test]
fn both_engines_take_the_same_steps_with_halves() {
    let mut engine = vulkan();
    for (height, width, padding, frames) in [(45, 64, 0, 3), (40, 36, 5, 2), (64, 64, 0, 8), (97, 61, 0, 1)] {
        let plain = Case::new(height, width, padding, 4e-3, frames);
        let mut case = Case::new(height, width, padding, 4e-3, frames);
        case.planner.storage = Storage::F16;
        for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY), (Purpose::Adam, AMPLITUDE)]
        {
            let what = format!("{height} x {width}, {purpose:?}, mode {mode}");
            let steps = steps(&case, purpose, mode);
            let got = solve(&mut engine, &case, purpose, &steps);
            let want = solve(&mut CpuEngine::new(), &case, purpose, &steps);
            // Adam divides by the size of the gradient. If this is small, rounding errors determine its direction.
            let amplified = if purpose == Purpose::Adam { 10.0 } else { 1.0 } * STEPS_APART;
            assert_near(&got, &want, amplified, &what);
            assert_eq!(got, solve(&mut engine, &case, purpose, &steps));
            let full = solve(&mut CpuEngine::new(), &plain, purpose, &self::steps(&plain, purpose, mode));
            assert_near(&want, &full, amplified, &format!("{what}, against float32"));
            assert_ne!(want, full, "{what}: nothing was rounded");
        }
        for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY)] {
            let step = |case: &Case| {
                let even = case.planner.with_equalised_eyebox(case.step(purpose, mode, 0.5, 3000), 0.02, 9, 0.5);
                vec![even, case.stft_step(purpose, mode)]
            };
            let got = solve(&mut engine, &case, purpose, &step(&case));
            let want = solve(&mut CpuEngine::new(), &case, purpose, &step(&case));
            let full = solve(&mut CpuEngine::new(), &plain, purpose, &step(&plain));
            let amplified = if purpose == Purpose::Adam { 10.0 } else { 1.0 } * STEPS_APART;
            assert_near(&got, &want, amplified, &format!("methods, {height} x {width}, {purpose:?}"));
            assert_near(&want, &full, amplified, &format!("methods, {height} x {width}, {purpose:?}, against float32"));
        }
    }
    // Halves have the same meaning on both engines at any point of a handover.
    let mut case = Case::new(30, 44, 0, 4e-3, 2);
    case.planner.storage = Storage::F16;
    let steps = [case.step(Purpose::Project, PROJECTION, 0.5, usize::MAX)];
    let want = solve(&mut CpuEngine::new(), &case, Purpose::Project, &steps);
    for kernel in [Kernel::PassPupil, Kernel::ApplyFactor, Kernel::PupilAdjoint, Kernel::CheckFinite, Kernel::Project] {
        let mut handover = Handover::new(Box::new(CpuEngine::new()), Box::new(vulkan()), At::Kernel(kernel));
        let got = solve(&mut handover, &case, Purpose::Project, &steps);
        assert_near(&got, &want, STEPS_APART, &format!("from {} on", kernel.name()));
    }
    assert_silent(engine);
}

/// The result is the same for each point at which one engine hands over to the other.
#[test]
fn handing_over_changes_nothing() {
    let case = Case::new(30, 44, 0, 4e-3, 2);
    let purpose = Purpose::Project;
    let steps: Vec<Step> = [usize::MAX, 1].map(|in_flight| case.step(purpose, PROJECTION, 0.5, in_flight)).to_vec();
    let want = solve(&mut CpuEngine::new(), &case, purpose, &steps);
    let longest = steps.iter().map(|s| s.list.len()).max().unwrap();
    for index in 0..=longest {
        let mut handover = Handover::new(Box::new(CpuEngine::new()), Box::new(vulkan()), At::Index(index));
        assert_close(&solve(&mut handover, &case, purpose, &steps), &want, &format!("at {index}"));
    }
    let mut back = Handover::new(Box::new(vulkan()), Box::new(CpuEngine::new()), At::Kernel(Kernel::ApplyFactor));
    assert_close(&solve(&mut back, &case, purpose, &steps), &want, "back at apply_factor");
    let described = back.describe();
    assert!(described.split_once("apply_factor").is_some_and(|(_, then)| then.contains("CPU")), "{described}");
    // Both engines ran their parts.
    let names = |e: &dyn Engine| e.timings().iter().map(|t| t.kernel).collect::<Vec<_>>();
    assert!(names(&back).contains(&Kernel::Modulate) && names(&back).contains(&Kernel::Project));
}

/// A validation score equals the score of the images, with or without padding, and only sums leave the engine.
#[test]
fn sums_say_what_images_say() {
    let mut engine = vulkan();
    for (height, width, padding) in [(45, 64, 0), (40, 37, 5), (1, 30, 0), (130, 131, 2)] {
        let case = Case::new(height, width, padding, 4e-3, 3);
        let phases = Noise::new(9).between(3 * height * width, -3.1, 3.1);
        for engine in [&mut engine as &mut dyn Engine, &mut CpuEngine::new()] {
            case.load(engine, Purpose::View);
            engine.write(Buffer::Phases, &phases).unwrap();
            let pool = |images: Vec<Vec<f32>>| -> Vec<Vec<f32>> {
                images.iter().map(|i| evaluate::pool2(i, height, width)).collect()
            };
            let images = pool(evaluate::views(engine, &case.planner, &case.pupils).unwrap());
            let targets = pool(evaluate::photographs(engine, &case.planner, &case.pupils).unwrap());
            let pairs = || images.iter().zip(&targets);
            let exposure = evaluate::fit_exposure(pairs().map(|(i, t)| (&i[..], &t[..]))).unwrap();
            let viewpoints: Vec<_> = case.pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect();
            let sums = evaluate::sums(engine, &case.planner, &viewpoints).unwrap();
            for ((image, target), sums) in pairs().zip(&sums) {
                let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
                let exact: [f64; 3] = [dot(image, target), dot(image, image), dot(target, target)];
                for (got, exact) in [sums.with_target, sums.with_itself, sums.of_target].into_iter().zip(exact) {
                    // A few of the 48 bits are lost on the way. (A small pupil before a single row passes nothing, so
                    // its sums are zero.)
                    let near = (got - exact).abs() <= 1e-12 * exact;
                    assert!(near, "{height} x {width} (+{padding}): {got}, not {exact}");
                }
                let seen: Vec<f32> = image.iter().map(|i| i * exposure as f32).collect();
                let want = evaluate::psnr(&seen, target).unwrap();
                assert!((sums.psnr(exposure) - want).abs() < 1e-3, "{} dB, not {want}", sums.psnr(exposure));
            }
            let fitted = Sums::fit_exposure(&sums).unwrap();
            assert!((fitted / exposure - 1.0).abs() < 1e-12, "{fitted}, not {exposure}");
            // The validator computes its score from the sums.
            let validator = Validator::new(engine, &case.planner, viewpoints).unwrap();
            let score = validator.score(engine, &case.planner).unwrap();
            assert_eq!((score.exposure, score.psnr), (fitted, sums.iter().map(|s| s.psnr(fitted)).collect()));
        }
    }
    assert_silent(engine);
}
