//! The device without the engine: a kernel runs, is timed, and the validation layer hears what is wrong.

use crate::gpu::test_options::watched;
use crate::gpu::{Commands, Gpu};
use eyebox_kernels::{Complex32, ZERO, modulate};
use eyebox_spirv as spirv;
use std::sync::{Arc, PoisonError};

/// A software device will do, and must: tests are not skipped where there is none.
fn open() -> Commands {
    Commands::new(&gpu()).unwrap_or_else(|e| panic!("{e}"))
}

fn gpu() -> Gpu {
    Gpu::open(&watched()).unwrap_or_else(|e| panic!("{e}"))
}

/// Closes the device and returns what the validation layer said from first to last.
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

/// A kernel reads what the one before it writes, with nothing between them: the layer must say so, else its silence
/// means nothing.
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

/// A device whose kernels see only small ranges, and that has the old barriers only, gives the same result: frames and
/// views come in pieces.
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
    // Two frames of the field, three of phases, and less than all views of any level.
    engine.pretend_range(2 * 8 * 40 * 64 + 512);
    engine.pretend_old();
    let got = run(&mut engine);
    // Nothing is made when the sizes have been seen.
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
    assert!(
        matches!(&too_much, EngineError::OutOfMemory { what, wanted: Some(w), .. } if what == "field" && *w == 1 << 46),
        "{too_much}"
    );
    assert!(too_much.to_string().contains("67108864 MiB"), "{too_much}");
    assert_eq!(close(gpu), Vec::<String>::new());
}

/// The driver loses the device in the middle of a solve: an error that names what ran, from every way in, and the
/// engine can be closed.
#[test]
fn a_lost_device_is_an_error_everywhere() {
    use super::super::{Buffer, Engine, EngineError, Kernel, Step};
    use super::engine::VulkanEngine;
    use crate::optics::{Color, Display, Padding, Pupil};
    use crate::plan::{Comparison, Purpose, Shape, Timing};
    use crate::scene::{self, Pyramid, Request};
    use crate::solve::{Flow, Problem, Settings, SolveError, solve};

    /// Loses its device before a step.
    struct Losing {
        engine: VulkanEngine,
        steps_left: usize,
    }
    impl Engine for Losing {
        fn describe(&self) -> String {
            self.engine.describe()
        }
        fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError> {
            self.engine.load(shape, views)
        }
        fn take_views(&mut self, views: Arc<Pyramid>) -> Result<(), EngineError> {
            self.engine.take_views(views)
        }
        fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError> {
            self.engine.write(buffer, data)
        }
        fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError> {
            self.engine.read(buffer)
        }
        fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError> {
            self.engine.keep(buffer)
        }
        fn kept(&mut self) -> Result<Vec<f32>, EngineError> {
            self.engine.kept()
        }
        fn restore(&mut self) -> Result<(), EngineError> {
            self.engine.restore()
        }
        fn clear_moments(&mut self) -> Result<(), EngineError> {
            self.engine.clear_moments()
        }
        fn run_part(&mut self, step: &Step, part: std::ops::Range<usize>) -> Result<Vec<f64>, EngineError> {
            if part.start == 0 && step.list.iter().any(|d| d.kernel == Kernel::Project) {
                match self.steps_left.checked_sub(1) {
                    Some(left) => self.steps_left = left,
                    None => self.engine.pretend_lost(),
                }
            }
            self.engine.run_part(step, part)
        }
        fn timings(&self) -> Vec<Timing> {
            self.engine.timings()
        }
        fn reset_timings(&mut self) {
            self.engine.reset_timings();
        }
    }

    let display = Display { height: 24, width: 30, ..Display::load("paper").unwrap() };
    let field = scene::load("builtin:plane", &Request { views: 3, ..Request::new(&display, &[Color::Green]) }).unwrap();
    let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
    let settings = Settings { steps: 5, frames: 2, pupils: 2, efficiency: Some(0.5), ..Settings::default() };
    let mut engine = Losing { engine: VulkanEngine::new(&gpu()).unwrap(), steps_left: 2 };
    let messages = engine.engine.gpu().messages();
    let mut steps = 0;
    let error = solve(&problem, &settings, &mut engine, &mut |p| {
        steps = p.step;
        Flow::Continue
    })
    .unwrap_err();
    assert!(matches!(error, SolveError::Engine(EngineError::DeviceLost { .. })) && steps == 2, "{error} ({steps})");
    // Whatever is tried next says so too, and what it was.
    let lost = |result: Result<(), EngineError>| match result {
        Err(EngineError::DeviceLost { during, .. }) => during,
        other => panic!("{other:?}"),
    };
    let download = lost(engine.read(Buffer::Phases).map(drop));
    let upload = lost(engine.write(Buffer::Phases, &[0.0; 2 * 24 * 30]));
    let planner = problem.planner(2, settings.window);
    let pupil_pass = planner.pupil_pass(&Pupil::from_mm([0.0, 0.0, 5.0, 0.0]), &Comparison::default());
    let step = planner.view_step(vec![pupil_pass]);
    let kernels = lost(engine.run_part(&step, 0..2).map(drop));
    assert!(kernels.starts_with("modulate") && kernels.ends_with("field_forward"), "{kernels}");
    let clearing = lost(engine.load(&planner.shape(Purpose::View), None));
    assert!(upload != download && clearing != upload && clearing != download, "{upload}, {download}, {clearing}");
    drop(engine);
    assert_eq!(*messages.lock().unwrap(), Vec::<String>::new());
}

/// A device that never ends what it was given is given up: what lives on it is neither waited for nor destroyed.
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
    engine.pretend_stuck();
    for _ in 0..2 {
        let error = engine.write(Buffer::Phases, &[0.0; 64]).and_then(|()| engine.read(Buffer::Phases)).unwrap_err();
        assert!(matches!(error, EngineError::DeviceLost { .. }), "{error}");
    }
    assert!(engine.gpu().is_lost());
}

/// Closing waits for what was submitted, but not for ever: a device that does not answer is left as it is.
#[test]
fn closing_does_not_wait_for_ever_for_a_device_that_does_not_answer() {
    unsafe extern "system" fn nothing(
        _: ash::vk::Queue,
        _: u32,
        _: *const ash::vk::SubmitInfo<'_>,
        _: ash::vk::Fence,
    ) -> ash::vk::Result {
        ash::vk::Result::SUCCESS
    }
    let mut commands = open();
    (commands.recorder.queue_submit, commands.recorder.patience_ns) = (nothing, 1_000_000);
    let shared = commands.shared.clone();
    commands.recorder.begin(0).unwrap();
    commands.recorder.send("a test").unwrap();
    drop(commands);
    assert!(shared.device.is_stuck() && shared.is_lost());
}

/// A device whose kernels see only a few sub-frames at once, and that has the old barriers only, encodes the same bytes.
#[test]
fn a_smaller_device_encodes_the_same() {
    use super::encode::VulkanEncoder;
    use crate::encode::{Encoder, PhaseSet};
    use crate::engine::EngineError;
    use crate::optics::{Color, Display};
    let display = Display { height: 9, width: 30, ..Display::preset("planes24").unwrap() };
    let encoder = Encoder::new(&display, &[Color::Red], 48).unwrap();
    let phases: Vec<f32> = (0..48 * 270).map(|i| (i * 37 % 1001) as f32 * 0.02 - 10.0).collect();
    let mut want = encoder.encode(&PhaseSet::trusted(&[&phases])).unwrap();
    let mut gpu = open();
    gpu.limits.storage_range = 5 * 1280 + 100;
    gpu.recorder.modern = None;
    gpu.in_place = false;
    let mut device = VulkanEncoder::on(gpu, encoder.plan()).unwrap();
    let mut got = encoder.frames();
    for _ in 0..2 {
        device.encode(&[&phases], got.bytes_mut()).unwrap();
        assert!(got == want);
    }
    // What does not fit is refused, and nothing is written.
    assert!(device.encode(&[&phases[1..]], want.bytes_mut()).is_err() && got == want);
    assert!(device.encode(&[&phases, &phases], want.bytes_mut()).is_err());
    assert!(device.download(&mut want.bytes_mut()[1..]).is_err());
    let messages = device.gpu().messages();
    drop(device);
    assert_eq!(*messages.lock().unwrap_or_else(PoisonError::into_inner), Vec::<String>::new());
    let mut gpu = open();
    gpu.limits.storage_range = 1000;
    let error = VulkanEncoder::on(gpu, encoder.plan()).err().expect("too small");
    assert!(matches!(&error, EngineError::Unsuitable { reason, .. } if reason.contains("1080")), "{error}");
}

/// Nothing is allocated for a set, whether its transfers are staged or in place.
#[test]
fn encoding_on_a_device_allocates_nothing() {
    use super::encode::VulkanEncoder;
    use crate::encode::Encoder;
    use crate::optics::{Color, Display};
    for (preset, in_place) in [("planes24", true), ("planes24", false), ("grey8", true), ("grey8", false)] {
        let display = Display { height: 9, width: 30, ..Display::preset(preset).unwrap() };
        let encoder = Encoder::new(&display, &[Color::Red], 24).unwrap();
        let phases: Vec<f32> = (0..24 * 270).map(|i| (i * 37 % 1001) as f32 * 0.02 - 10.0).collect();
        let mut gpu = open();
        gpu.in_place = in_place;
        let mut device = VulkanEncoder::on(gpu, encoder.plan()).unwrap();
        let mut got = encoder.frames();
        // One thread, so that all that is done is counted.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let counted = pool.install(|| {
            (0..2).for_each(|_| device.encode(&[&phases], got.bytes_mut()).unwrap());
            allocation_counter::measure(|| (0..9).for_each(|_| device.encode(&[&phases], got.bytes_mut()).unwrap()))
        });
        assert_eq!(counted.count_total, 0, "{preset}, in place: {in_place}");
    }
}

/// An engine and an encoder share a device: phases become video frames, and pixels, with nothing read back, and the bytes
/// are those of the CPU.
#[test]
fn phases_become_pixels_on_the_device() {
    use super::super::{Buffer, Engine, Purpose, Shape, Storage};
    use super::encode::VulkanEncoder;
    use super::engine::VulkanEngine;
    use crate::encode::{Encoder, PhaseSet};
    use crate::gpu::PixelOrder;
    use crate::optics::{Color, Display};
    use eyebox_kernels::{modulate, pixels};
    for (preset, order, angles) in [
        ("grey8", PixelOrder::Bgra, false),
        ("planes24", PixelOrder::Rgba, false),
        ("grey8", PixelOrder::Rgba, true),
        ("planes24", PixelOrder::Bgra, true),
    ] {
        let display = Display { height: 9, width: 30, ..Display::preset(preset).unwrap() };
        let encoder = Encoder::new(&display, &[Color::Red], 24).unwrap();
        let gpu = gpu();
        let mut engine = VulkanEngine::new(&gpu).unwrap();
        let place = modulate::Args { height: 9, width: 30, grid_height: 9, grid_width: 30, top: 0, left: 0 };
        let shape = Shape {
            frames: 24,
            place,
            purpose: if angles { Purpose::Project } else { Purpose::View },
            quantised: false,
            storage: if angles { Storage::F16 } else { Storage::F32 },
            binary_angles: angles,
            model: crate::plan::ModelParts::default(),
        };
        engine.load(&shape, None).unwrap();
        let mut device = VulkanEncoder::new(&gpu, encoder.plan()).unwrap();
        let mut pictures = device.pictures(order).unwrap();
        for round in 0..2 {
            let phases: Vec<f32> = (0..24 * 270).map(|i| (i * (37 + round) % 1001) as f32 * 0.02 - 10.0).collect();
            engine.write(Buffer::Phases, &phases).unwrap();
            let phases = if angles { engine.read(Buffer::Phases).unwrap() } else { phases };
            let before = gpu.counts();
            device.encode_on_device(&[engine.phases_on_device().unwrap()]).unwrap();
            device.draw(&mut pictures).unwrap();
            let after = gpu.counts();
            assert_eq!((after.read_back, after.uploaded), (before.read_back, before.uploaded));
            assert_eq!(after.submissions, before.submissions + 2);
            let want = encoder.encode(&PhaseSet::trusted(&[&phases])).unwrap();
            let mut got = encoder.frames();
            device.download(got.bytes_mut()).unwrap();
            assert!(got == want, "{preset}");
            let args = pixels::Args {
                height: want.height as u32,
                width: want.width as u32,
                row: (want.width * want.channels) as u32,
                channels: want.channels as u32,
                blue_first: u32::from(order == PixelOrder::Bgra),
            };
            let mut commands = Commands::new(&gpu).unwrap();
            for i in 0..want.count() {
                let (mut want_pixels, mut got_pixels) = (vec![0; 4 * 270], vec![0; 4 * 270]);
                pixels::pixels(&args, want.frame(i), &mut want_pixels);
                let piece = (i as u64 * pictures.step, 0, 4 * 270);
                commands.download(&pictures.block, &mut got_pixels, [piece]).unwrap();
                assert!(got_pixels == want_pixels, "{preset}, frame {i}");
            }
        }
        // What is still read is not filled, and what is on another device is not taken.
        let held = Arc::clone(&pictures.block);
        assert!(device.draw(&mut pictures).is_err());
        drop(held);
        let mut other = VulkanEngine::new(&self::gpu()).unwrap();
        other.load(&shape, None).unwrap();
        assert!(device.encode_on_device(&[other.phases_on_device().unwrap()]).is_err());
        assert_eq!(engine.read(Buffer::Phases).unwrap().len() * 4, 24 * 270 * 4);
        assert!(gpu.counts().phases_read_back >= 24 * 270 * 4);
        let messages = gpu.messages();
        drop((engine, device, pictures, gpu));
        assert_eq!(*messages.lock().unwrap_or_else(PoisonError::into_inner), Vec::<String>::new());
    }
}

/// Binary angles and halves beside them come back as they were given, are kept and restored, of an odd number of pixels as well.
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
