//! Steps in flight. The device checks the losses, and the host receives them one step later.

use eyebox::low_level::engine::vulkan::VulkanEngine;
use eyebox::low_level::engine::{Buffer, Engine, EngineError, Step, Storage};
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox::low_level::optics::{Optics, Pupil, WindowFactor};
use eyebox::low_level::plan::{Comparison, Planner, Purpose, ViewLayout};
use eyebox::low_level::scene::{Pyramid, ViewGrid};
use eyebox_tests::both::{Noise, assert_silent, vulkan, watched};
use std::slice;
use std::sync::Arc;

struct Case {
    planner: Planner,
    pyramid: Arc<Pyramid>,
}

impl Case {
    fn new(storage: Storage) -> Self {
        let slm = Optics::new(40, 64, 8e-6, 520e-9, 0.4).unwrap();
        let mut planner = Planner { storage, ..Planner::new(slm, 3, WindowFactor::Two) };
        let grid = ViewGrid { rows: 3, columns: 3, cell: slm.eyebox() / 3.0 };
        let views: Vec<Vec<f32>> =
            (0..9).map(|v| (0..40 * 64).map(|i| ((i * 37 + v * 101) % 211) as f32 / 211.0).collect()).collect();
        let pyramid = Arc::new(Pyramid::new(&views, 40, 64));
        planner.views = Some(ViewLayout::new(grid, &pyramid));
        Self { planner, pyramid }
    }

    /// Returns a step over two pupils. The second has this exposure.
    fn step(&self, exposure: f64, adam: bool) -> Step {
        let pass = |x: f64, exposure: f64| {
            let pupil = Pupil { x, y: -2e-3, diameter: 8e-3, depth: 3e-3 };
            self.planner.pupil_pass(&pupil, &Comparison { exposure, ..Comparison::default() })
        };
        let passes = vec![pass(1e-3, 1.0), pass(-1e-3, exposure)];
        match adam {
            true => self.planner.adam_step(passes, usize::MAX, 1, 0.1),
            false => self.planner.project_step(passes, usize::MAX, 0.5, 2.0, 0.5),
        }
    }

    fn load(&self, engine: &mut dyn Engine, adam: bool) -> Vec<f32> {
        let purpose = if adam { Purpose::Adam } else { Purpose::Project };
        engine.load(&self.planner.shape(purpose), Some(Arc::clone(&self.pyramid))).unwrap();
        let phases = Noise::new(5).between(3 * 40 * 64, -3.1, 3.1);
        engine.write(Buffer::Phases, &phases).unwrap();
        phases
    }
}

fn bits(values: Vec<f32>) -> Vec<u32> {
    values.into_iter().map(f32::to_bits).collect()
}

/// A loss of NaN leaves phases and moments unchanged, bit for bit, and so does a step that began before the host read
/// this loss. A later step changes them again.
#[test]
fn a_step_with_a_loss_that_is_no_number_is_not_taken() {
    let as_planned = [DeviceKind::Cpu, DeviceKind::Discrete].map(|kind| Options { plan_as: Some(kind), ..watched() });
    for options in as_planned {
        not_taken(VulkanEngine::new(&Gpu::open(&options).unwrap()).unwrap());
    }
}

fn not_taken(mut engine: VulkanEngine) {
    for (storage, adam) in [(Storage::F32, false), (Storage::F16, false), (Storage::F32, true)] {
        let case = Case::new(storage);
        let [good, bad] = [1.0, f64::NAN].map(|exposure| case.step(exposure, adam));
        let all = 0..good.list.len();
        let parts = slice::from_ref(&all);
        case.load(&mut engine, adam);
        engine.run(&good).unwrap();
        let state = |engine: &mut dyn Engine| {
            [Buffer::Phases, Buffer::Momentum].map(|buffer| bits(engine.read(buffer).unwrap()))
        };
        let before = state(&mut engine);
        let begun = [&bad, &good].map(|step| engine.begin_step(step, parts).unwrap());
        let losses = begun.map(|begun| engine.end_step(begun).unwrap().losses);
        assert!(losses.iter().flatten().any(|loss| loss.is_nan()), "{losses:?}");
        assert!(losses[1].iter().all(|loss| loss.is_nan()), "the step after it was not taken either: {losses:?}");
        assert!(state(&mut engine) == before, "{storage:?}, Adam: {adam}");
        let begun = engine.begin_step(&good, parts).unwrap();
        assert!(engine.end_step(begun).unwrap().losses.iter().all(|loss| loss.is_finite()));
        assert!(state(&mut engine) != before);
    }
    assert_silent(engine);
}

/// Steps that follow each other without waiting equal steps that are waited for, and give the same losses.
#[test]
fn steps_in_flight_are_the_steps_that_are_waited_for() {
    let case = Case::new(Storage::F32);
    let steps: Vec<Step> = [1.0, 0.7, 1.3, 0.9].map(|exposure| case.step(exposure, false)).into();
    let mut engine = vulkan();
    case.load(&mut engine, false);
    let want: Vec<Vec<f64>> = steps.iter().map(|step| engine.run(step).unwrap()).collect();
    let phases = bits(engine.read(Buffer::Phases).unwrap());
    case.load(&mut engine, false);
    let (mut got, mut under_way) = (Vec::new(), None);
    for step in &steps {
        // The cut is in the middle. The parts are recorded one after the other.
        let parts = [0..4, 4..step.list.len()];
        let begun = engine.begin_step(step, &parts).unwrap();
        got.extend(under_way.replace(begun).map(|begun| engine.end_step(begun).unwrap().losses));
    }
    got.extend(under_way.map(|begun| engine.end_step(begun).unwrap().losses));
    assert_eq!(got, want);
    assert!(bits(engine.read(Buffer::Phases).unwrap()) == phases);
    assert_silent(engine);
}

/// The losses of a step are available until two more steps begin.
#[test]
fn losses_of_long_ago_are_refused() {
    let case = Case::new(Storage::F32);
    let step = case.step(1.0, false);
    let gpu = Gpu::open(&Options { record_only: true, ..watched() }).unwrap();
    let mut engine = VulkanEngine::new(&gpu).unwrap();
    case.load(&mut engine, false);
    let all = 0..step.list.len();
    let begun = [0, 1, 2].map(|_| engine.begin_step(&step, slice::from_ref(&all)).unwrap());
    let ended = begun.map(|begun| engine.end_step(begun));
    assert!(matches!(ended[0], Err(EngineError::Mismatch { .. })) && ended[1].is_ok() && ended[2].is_ok());
}

/// A step that is only prepared reads its own losses, and not also the losses of an earlier preparation.
#[test]
fn what_is_prepared_reads_no_losses_twice() {
    let case = Case::new(Storage::F32);
    let step = case.step(1.0, false);
    let mut engine = vulkan();
    case.load(&mut engine, false);
    let read = |engine: &mut VulkanEngine| {
        let before = engine.gpu().counts();
        engine.prepare(&mut std::iter::once(step.clone()), None).unwrap();
        engine.gpu().counts().since(before).losses_read_back
    };
    let [first, .., last] = [(); 3].map(|()| read(&mut engine));
    assert!(first > 0);
    assert_eq!(first, last);
    assert_silent(engine);
}
