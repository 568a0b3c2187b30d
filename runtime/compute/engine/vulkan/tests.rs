//! Tests the device without the engine. A kernel runs and is timed, and the validation layer reports errors.

use crate::gpu::test_options::watched;
use crate::gpu::{Commands, Gpu};
use eyebox_kernels::{Complex32, ZERO, modulate};
use eyebox_spirv as spirv;
use std::sync::PoisonError;

/// Opens a device. Tests are not skipped without one, and a software device is enough.
fn open() -> Commands {
    Commands::new(&gpu()).unwrap_or_else(|e| panic!("{e}"))
}

fn gpu() -> Gpu {
    Gpu::open(&watched()).unwrap_or_else(|e| panic!("{e}"))
}

/// Closes the device and returns all messages of the validation layer.
fn close(gpu: Commands) -> Vec<String> {
    let messages = gpu.shared.messages();
    drop(gpu);
    messages.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

#[test]
fn a_kernel_runs_is_timed_and_leaves_no_message() {
    let mut gpu = open();
    let place = modulate::Args { height: 5, width: 7, grid_height: 8, grid_width: 70, top: 2, left: 60 };
    let phases: Vec<f32> = (0..35).map(|i| 0.7 * i as f32 - 9.0).collect();
    let mut want = vec![ZERO; 8 * 70];
    modulate::modulate(&place, 0.5, &phases, &mut want);
    let from = gpu.filled(bytemuck::cast_slice(&phases), "phases").unwrap();
    let to = gpu.block(8 * want.len() as u64, "field").unwrap();
    let pipeline = gpu.pipeline(&spirv::MODULATE, 2, &[]).unwrap();
    let push = [5u32, 7, 8, 70, 2, 60, 35, 560, 0.5f32.to_bits()];
    gpu.recorder.begin(1).unwrap();
    gpu.recorder.dispatch(pipeline, &[from.all(), to.all()], bytemuck::cast_slice(&push), [2, 3, 1]).unwrap();
    gpu.recorder.mark(7);
    gpu.recorder.submit("modulate").unwrap();
    let times = std::mem::take(&mut gpu.recorder.times);
    assert_eq!(times.len(), 1);
    assert!(times[0].label == 7 && times[0].seconds > 0.0 && times[0].seconds < 60.0, "{times:?}");
    let mut got = vec![ZERO; want.len()];
    let bytes = 8 * got.len() as u64;
    gpu.download(&to, bytemuck::cast_slice_mut(&mut got), [(0, 0, bytes)]).unwrap();
    let error: f32 = got.iter().zip(&want).map(|(a, b): (&Complex32, &Complex32)| (a - b).norm_sqr()).sum();
    assert!(error < 1e-10 * 35.0, "error power {error}");
    drop((from, to));
    assert_eq!(close(gpu), Vec::<String>::new());
}

/// A kernel reads the output of the one before it without a barrier. The layer must report that, otherwise its
/// silence means nothing.
#[test]
fn a_hazard_is_heard() {
    let mut gpu = open();
    let from = gpu.filled(&[0; 512], "phases").unwrap();
    let to = gpu.block(512, "field").unwrap();
    let pipeline = gpu.pipeline(&spirv::MODULATE, 2, &[]).unwrap();
    let push = [8u32, 8, 8, 8, 0, 0, 64, 64, 1f32.to_bits()];
    gpu.recorder.begin(0).unwrap();
    gpu.recorder.dispatch(pipeline, &[from.all(), to.all()], bytemuck::cast_slice(&push), [1, 8, 1]).unwrap();
    gpu.recorder.dispatch(pipeline, &[to.all(), from.all()], bytemuck::cast_slice(&push), [1, 8, 1]).unwrap();
    gpu.recorder.submit("a hazard").unwrap();
    drop((from, to));
    let heard = close(gpu);
    assert!(heard.iter().any(|m| m.contains("SYNC-HAZARD-READ-AFTER-WRITE")), "{heard:?}");
}

/// A kernel reads and writes beyond the bound ranges. GPU-assisted validation must report that, otherwise its silence
/// means nothing.
#[test]
#[ignore = "tools/nightly.sh runs it under GPU-assisted validation"]
fn an_access_beyond_a_range_is_heard() {
    let mut gpu = open();
    let (from, to) = (gpu.filled(&[0; 512], "phases").unwrap(), gpu.block(512, "field").unwrap());
    let pipeline = gpu.pipeline(&spirv::MODULATE, 2, &[]).unwrap();
    let push = [8u32, 8, 8, 8, 0, 0, 64, 64, 1f32.to_bits()];
    gpu.recorder.shows_half = true;
    gpu.recorder.begin(0).unwrap();
    gpu.recorder.dispatch(pipeline, &[from.all(), to.all()], bytemuck::cast_slice(&push), [1, 8, 1]).unwrap();
    gpu.recorder.submit("an access").unwrap();
    drop((from, to));
    let heard = close(gpu);
    assert!(heard.iter().any(|m| m.contains("out of bounds")), "{heard:?}");
}

/// A device whose kernels bind only small ranges, and that has only the old barriers, gives the same result. Frames
/// and views come in pieces.
#[test]
fn a_smaller_device_gives_the_same() {
    use super::super::cpu::CpuEngine;
    use super::super::{Buffer, Dispatch, Engine, EngineError, Kernel, Purpose};
    use super::engine::VulkanEngine;
    use crate::optics::{Optics, Pupil, WindowFactor};
    use crate::plan::{Comparison, Planner, ViewLayout};
    use crate::scene::{Pyramid, ViewGrid};

    let slm = Optics::new(40, 64, 8e-6, 520e-9, 0.4).unwrap();
    let mut planner = Planner::new(slm, 5, WindowFactor::Two);
    let grid = ViewGrid { rows: 3, columns: 3, cell: slm.eyebox() / 3.0 };
    let views: Vec<Vec<f32>> =
        (0..9).map(|v| (0..40 * 64).map(|i| ((i * 37 + v * 101) % 211) as f32 / 211.0).collect()).collect();
    let pyramid = std::sync::Arc::new(Pyramid::new(&views, 40, 64));
    planner.views = Some(ViewLayout::new(grid, &pyramid));
    let pupil = Pupil { x: 1e-3, y: -2e-3, diameter: 20e-3, depth: 3e-3 };
    let mut step =
        planner.project_step(vec![planner.pupil_pass(&pupil, &Comparison::default()); 2], usize::MAX, 0.5, 2.0, 0.5);
    let transforms = [Kernel::FieldForward, Kernel::WindowForward, Kernel::WindowInverse, Kernel::ChangeInverse];
    step.list.retain(|d: &Dispatch| !transforms.contains(&d.kernel));

    let shape = planner.shape(Purpose::Project);
    let run = |engine: &mut dyn Engine| {
        engine.load(&shape, Some(std::sync::Arc::clone(&pyramid))).unwrap();
        engine.write(Buffer::Phases, &(0..5 * 40 * 64).map(|i| (i % 71) as f32 * 0.08).collect::<Vec<_>>()).unwrap();
        let losses = engine.run(&step).unwrap();
        (losses, engine.read(Buffer::Phases).unwrap(), engine.read(Buffer::Target(1)).unwrap())
    };
    let mut engine = VulkanEngine::new(&gpu()).unwrap();
    // This holds two frames of the field, three of phases, and fewer than all views of any level.
    engine.pretend_range(2 * 8 * 40 * 64 + 512);
    engine.pretend_old();
    let got = run(&mut engine);
    // Once the sizes have occurred, nothing is allocated.
    let held = engine.held();
    engine.run(&step).unwrap();
    assert_eq!(engine.held(), held);
    let want = run(&mut CpuEngine::new());
    for (got, want) in [(&got.1, &want.1), (&got.2, &want.2)] {
        let error: f32 = got.iter().zip(want).map(|(a, b)| 2.0 - 2.0 * (a - b).cos()).sum();
        assert!(error < 1e-9 * got.len() as f32, "{error}");
    }
    assert!((got.0[1] / want.0[1] - 1.0).abs() < 1e-5);
    // One frame that is too large is refused by name.
    engine.pretend_range(4096);
    let refused = engine.load(&shape, None).unwrap_err();
    assert!(matches!(&refused, EngineError::Unsuitable { reason, .. } if reason.contains("4096")), "{refused}");
    let messages = engine.gpu().messages();
    drop(engine);
    assert_eq!(*messages.lock().unwrap(), Vec::<String>::new());
}

#[test]
fn what_went_wrong_is_told_apart() {
    use super::super::EngineError;
    use ash::vk::Result as Code;
    let gpu = open();
    let error = |code| gpu.device.error("vkQueueSubmit", "transfer to adam", code);
    assert!(
        matches!(error(Code::ERROR_DEVICE_LOST), EngineError::DeviceLost { during, .. } if during == "transfer to adam")
    );
    assert!(matches!(error(Code::ERROR_OUT_OF_DEVICE_MEMORY), EngineError::OutOfMemory { .. }));
    assert!(
        matches!(error(Code::ERROR_OUT_OF_HOST_MEMORY), EngineError::OutOfMemory { device, .. } if device == "host")
    );
    let unknown = error(Code::ERROR_UNKNOWN);
    assert!(
        matches!(&unknown, EngineError::Vulkan { call: "vkQueueSubmit", result, .. } if result == "ERROR_UNKNOWN"),
        "{unknown}"
    );
    let too_much = gpu.block(1 << 46, "field").err().unwrap();
    let limit = (gpu.limits.allocation >> 20).to_string();
    assert!(
        matches!(&too_much, EngineError::OutOfMemory { what, wanted: Some(w), .. }
            if what.starts_with("field ") && what.contains(&limit) && *w == 1 << 46),
        "{too_much}"
    );
    assert!(too_much.to_string().contains("67108864 MiB"), "{too_much}");
    assert_eq!(close(gpu), Vec::<String>::new());
}

/// A device that never ends its work is given up. Objects on it are neither waited for nor destroyed.
#[test]
fn a_device_that_does_not_answer_is_lost() {
    use crate::engine::vulkan::VulkanEngine;
    use crate::engine::{Buffer, Engine, EngineError};
    use crate::optics::{Color, Display, WindowFactor};
    use crate::plan::{Planner, Purpose};
    let display = Display { height: 8, width: 8, ..Display::preset("small").unwrap() };
    let planner = Planner::new(display.optics(Color::Green).unwrap(), 1, WindowFactor::Full);
    let mut engine = VulkanEngine::new(&gpu()).unwrap();
    engine.load(&planner.shape(Purpose::View), None).unwrap();
    super::pretend::pretend_stuck(&mut engine.gpu);
    for _ in 0..2 {
        let error = engine.write(Buffer::Phases, &[0.0; 64]).and_then(|()| engine.read(Buffer::Phases)).unwrap_err();
        assert!(matches!(error, EngineError::DeviceLost { .. }), "{error}");
    }
    assert!(engine.gpu().is_lost());
}

/// A pipeline's first submission may take longer, because some devices compile it only then.
#[test]
fn only_the_first_use_of_a_pipeline_may_take_longer() {
    use crate::gpu::Patience;
    let mut gpu = open();
    let device = std::sync::Arc::clone(&gpu.device);
    gpu.recorder.patience = Patience { usual_ns: 60_000_000_001, first_use_ns: 60_000_000_002 };
    let (from, to) = (gpu.filled(&[0; 512], "phases").unwrap(), gpu.block(512, "field").unwrap());
    let pipelines = [&[], &[1u32][..]].map(|constants| gpu.pipeline(&spirv::MODULATE, 2, constants).unwrap());
    let push = [8u32, 8, 8, 8, 0, 0, 64, 64, 1f32.to_bits()];
    for (pipeline, is_sent, is_first) in
        [(0, false, true), (0, true, true), (0, true, false), (1, true, true), (0, true, false), (1, true, false)]
    {
        gpu.recorder.begin(0).unwrap();
        let buffers = [from.all(), to.all()];
        gpu.recorder.dispatch(pipelines[pipeline], &buffers, bytemuck::cast_slice(&push), [1, 8, 1]).unwrap();
        if is_sent {
            let submission = gpu.recorder.send("a test").unwrap();
            assert_eq!(gpu.recorder.patience_ns(), 60_000_000_001 + u64::from(is_first), "pipeline {pipeline}");
            let of_device = device.patience().ns(is_first);
            assert_eq!(device.patience_ns(), of_device, "pipeline {pipeline}");
            assert_eq!(device.first_uses.load(std::sync::atomic::Ordering::Relaxed), usize::from(is_first));
            gpu.recorder.wait_for(submission, "a test").unwrap();
        }
    }
    drop((from, to));
    assert_eq!(close(gpu), Vec::<String>::new());
}

/// Closing waits for submissions, but not forever. A device that does not answer is left unchanged.
#[test]
fn closing_does_not_wait_for_ever_for_a_device_that_does_not_answer() {
    let mut commands = open();
    super::pretend::pretend_stuck(&mut commands);
    let shared = commands.shared.clone();
    commands.recorder.begin(0).unwrap();
    commands.recorder.send("a test").unwrap();
    drop(commands);
    assert!(shared.device.is_stuck() && shared.is_lost());
}

/// Binary angles and halves with them are read back as written, kept and restored, also with an odd number of pixels.
#[test]
fn binary_angles_come_back() {
    use super::super::cpu::CpuEngine;
    use super::super::{Buffer, Engine, Purpose, Shape, Storage};
    use super::engine::VulkanEngine;
    use eyebox_kernels::modulate;
    let mut device = VulkanEngine::new(&gpu()).unwrap();
    let mut host = CpuEngine::new();
    for (height, width) in [(3, 5), (4, 6), (9, 15)] {
        let place = modulate::Args { height, width, grid_height: height, grid_width: width, top: 0, left: 0 };
        let (storage, model) = (Storage::F16, crate::plan::ModelParts::default());
        let purpose = Purpose::Project;
        let shape = Shape { frames: 3, place, purpose, quantised: false, storage, binary_angles: true, model };
        let count = 3 * shape.pixels();
        let phases: Vec<f32> = (0..count).map(|i| (i as f32 * 0.37) % 9.0 - 4.0).collect();
        let velocities: Vec<f32> = (0..count).map(|i| i as f32 * 1e-4 - 3e-3).collect();
        let mut all = Vec::new();
        for engine in [&mut device as &mut dyn Engine, &mut host] {
            engine.load(&shape, None).unwrap();
            engine.write(Buffer::Phases, &phases).unwrap();
            engine.write(Buffer::Momentum, &velocities).unwrap();
            let had = [Buffer::Phases, Buffer::Momentum].map(|buffer| engine.read(buffer).unwrap());
            engine.keep(Buffer::Phases).unwrap();
            engine.write(Buffer::Phases, &vec![0.0; count]).unwrap();
            assert_eq!(engine.kept().unwrap(), had[0]);
            engine.restore().unwrap();
            assert_eq!(engine.read(Buffer::Phases).unwrap(), had[0]);
            assert_eq!(engine.read(Buffer::Momentum).unwrap(), vec![0.0; count]);
            engine.write(Buffer::Phases, &had[0]).unwrap();
            assert_eq!(engine.read(Buffer::Phases).unwrap(), had[0]);
            all.push(had);
        }
        assert_eq!(all[0], all[1]);
        let unit = std::f32::consts::TAU / 65536.0;
        let off = |(a, b): (&f32, &f32)| eyebox_kernels::trig::wrap(a - b).abs();
        assert!(phases.iter().zip(&all[0][0]).map(off).all(|off| off < 0.51 * unit));
        assert!(velocities.iter().zip(&all[0][1]).all(|(a, b)| (a - b).abs() <= a.abs() / 2048.0 + 3e-8));
    }
}
