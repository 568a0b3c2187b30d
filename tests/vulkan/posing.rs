//! The device of `tools/posing.sh` poses as a discrete GPU. These tests fail if its other runs use lavapipe itself.

use eyebox::low_level::engine::vulkan::VulkanEngine;
use eyebox::low_level::engine::{Buffer, Engine, Kernel, Purpose};
use eyebox::low_level::gpu::{DeviceKind, Gpu};
use eyebox::low_level::plan::Comparison;
use eyebox_tests::both::{Case, assert_silent, watched};

fn engine() -> VulkanEngine {
    VulkanEngine::new(&Gpu::open(&watched()).expect("a device")).expect("an engine")
}

#[test]
#[ignore = "tools/posing.sh runs it on its device"]
fn the_device_has_kind_alignment_and_memory_of_a_discrete_gpu() {
    let mut engine = engine();
    let report = engine.gpu().report();
    assert_eq!((report.kind, report.limits.offset_alignment), (DeviceKind::Discrete, 256));
    // The host does not map the device's memory, so each write is a submission.
    let case = Case::new(7, 13, 0, 15e-3, 1);
    case.load(&mut engine, Purpose::View);
    let before = engine.gpu().counts();
    engine.write(Buffer::Phases, &[0.5; 7 * 13]).expect("phases");
    assert_eq!(engine.gpu().counts().since(before).submissions, 1);
    assert_silent(engine);
}

/// A part of a step leaves the image as the device allocated it.
#[test]
#[ignore = "tools/posing.sh runs it on its device"]
fn new_memory_holds_no_numbers() {
    let mut engine = engine();
    let case = Case::new(40, 36, 0, 4e-3, 2);
    let passes = case.pupils.iter().map(|p| case.planner.pupil_pass(p, &Comparison::default())).collect();
    let step = case.planner.view_step(passes);
    case.load(&mut engine, Purpose::View);
    engine.write(Buffer::Phases, &[0.5; 2 * 40 * 36]).expect("phases");
    let passed = step.list.iter().position(|d| d.kernel == Kernel::PassPupil).expect("pupils pass") + 1;
    engine.run_part(&step, 0..passed).expect("a part");
    let image = engine.read(Buffer::Image(0)).expect("an image");
    assert!(!image.is_empty() && image.iter().all(|value| value.is_nan()));
    engine.run_part(&step, passed..step.list.len()).expect("the rest");
    assert!(engine.read(Buffer::Image(0)).expect("an image").iter().all(|value| value.is_finite()));
    assert_silent(engine);
}
