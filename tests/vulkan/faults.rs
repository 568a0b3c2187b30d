//! Faults and limits of devices under the solver and the encoder. Each gives an error or the same bytes.

use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::engine::vulkan::{LesserDevice, VulkanEncoder, VulkanEngine};
use eyebox::low_level::engine::{
    Buffer, Engine, EngineError, Kernel, ModelParts, Purpose, Shape, Step, Storage, Timing,
};
use eyebox::low_level::gpu::PixelOrder;
use eyebox::low_level::optics::{Color, Display, Padding, Pupil};
use eyebox::low_level::plan::Comparison;
use eyebox::low_level::scene::{self, Pyramid, Request};
use eyebox::low_level::solve::{Flow, Problem, Settings, SolveError, solve};
use eyebox_kernels::{modulate, pixels};
use eyebox_tests::both::{gpu, vulkan};
use std::sync::{Arc, PoisonError};

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

/// The driver loses the device during a solve. Every later call returns an error with the names of its kernels, and the
/// engine closes.
#[test]
fn a_lost_device_is_an_error_everywhere() {
    let display = Display { height: 24, width: 30, ..Display::load("paper").unwrap() };
    let field = scene::load("builtin:plane", &Request { views: 3, ..Request::new(&display, &[Color::Green]) }).unwrap();
    let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
    let settings = Settings { steps: 5, frames: 2, pupils: 2, efficiency: Some(0.5), ..Settings::default() };
    let mut engine = Losing { engine: vulkan(), steps_left: 2 };
    let messages = engine.engine.gpu().messages();
    let mut steps = 0;
    let error = solve(&problem, &settings, &mut engine, &mut |p| {
        steps = p.step;
        Flow::Continue
    })
    .unwrap_err();
    assert!(matches!(error, SolveError::Engine(EngineError::DeviceLost { .. })) && steps == 2, "{error} ({steps})");
    // Each later call returns the same error with its own operation.
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

/// A device with a small storage range and without synchronization2 encodes the same bytes.
#[test]
fn a_smaller_device_encodes_the_same() {
    let display = Display { height: 9, width: 30, ..Display::preset("planes24").unwrap() };
    let encoder = Encoder::new(&display, &[Color::Red], 48).unwrap();
    let phases: Vec<f32> = (0..48 * 270).map(|i| (i * 37 % 1001) as f32 * 0.02 - 10.0).collect();
    let mut want = encoder.encode(&PhaseSet::trusted(&[&phases])).unwrap();
    let lesser = LesserDevice { staged: true, storage_range: Some(5 * 1280 + 100), old_barriers: true };
    let mut device = VulkanEncoder::on_lesser(&gpu(), encoder.plan(), &lesser).unwrap();
    let mut got = encoder.frames();
    for _ in 0..2 {
        device.encode(&[&phases], got.bytes_mut()).unwrap();
        assert!(got == want);
    }
    // Wrong sizes are refused, and nothing is written.
    assert!(device.encode(&[&phases[1..]], want.bytes_mut()).is_err() && got == want);
    assert!(device.encode(&[&phases, &phases], want.bytes_mut()).is_err());
    assert!(device.download(&mut want.bytes_mut()[1..]).is_err());
    let messages = device.gpu().messages();
    drop(device);
    assert_eq!(*messages.lock().unwrap_or_else(PoisonError::into_inner), Vec::<String>::new());
    let lesser = LesserDevice { storage_range: Some(1000), ..LesserDevice::default() };
    let error = VulkanEncoder::on_lesser(&gpu(), encoder.plan(), &lesser).err().expect("too small");
    assert!(matches!(&error, EngineError::Unsuitable { reason, .. } if reason.contains("1080")), "{error}");
}

/// The encoder allocates nothing for a set, staged or in place.
#[test]
fn encoding_on_a_device_allocates_nothing() {
    for (preset, in_place) in [("planes24", true), ("planes24", false), ("grey8", true), ("grey8", false)] {
        let display = Display { height: 9, width: 30, ..Display::preset(preset).unwrap() };
        let encoder = Encoder::new(&display, &[Color::Red], 24).unwrap();
        let phases: Vec<f32> = (0..24 * 270).map(|i| (i * 37 % 1001) as f32 * 0.02 - 10.0).collect();
        let lesser = LesserDevice { staged: !in_place, ..LesserDevice::default() };
        let mut device = VulkanEncoder::on_lesser(&gpu(), encoder.plan(), &lesser).unwrap();
        let mut got = encoder.frames();
        // One thread, so the counter sees all allocations.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let counted = pool.install(|| {
            (0..2).for_each(|_| device.encode(&[&phases], got.bytes_mut()).unwrap());
            allocation_counter::measure(|| (0..9).for_each(|_| device.encode(&[&phases], got.bytes_mut()).unwrap()))
        });
        assert_eq!(counted.count_total, 0, "{preset}, in place: {in_place}");
    }
}

/// An engine and an encoder on one device make the same video frames and pixels as the CPU and read nothing back.
#[test]
fn phases_become_pixels_on_the_device() {
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
            model: ModelParts::default(),
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
                top: 0,
                left: 0,
                rows: want.height as u32,
                columns: want.width as u32,
                fill: 0,
            };
            for i in 0..want.count() {
                let mut want_pixels = vec![0; 4 * 270];
                pixels::pixels(&args, want.frame(i), &mut want_pixels);
                assert!(pictures.pixels(&gpu, i).unwrap() == want_pixels, "{preset}, frame {i}");
            }
        }
        // The encoder refuses pictures that are still read and phases on another device.
        let held = Arc::clone(&pictures.block);
        assert!(device.draw(&mut pictures).is_err());
        drop(held);
        let mut other = VulkanEngine::new(&eyebox_tests::both::gpu()).unwrap();
        other.load(&shape, None).unwrap();
        assert!(device.encode_on_device(&[other.phases_on_device().unwrap()]).is_err());
        assert_eq!(engine.read(Buffer::Phases).unwrap().len() * 4, 24 * 270 * 4);
        assert!(gpu.counts().phases_read_back >= 24 * 270 * 4);
        let messages = gpu.messages();
        drop((engine, device, pictures, gpu));
        assert_eq!(*messages.lock().unwrap_or_else(PoisonError::into_inner), Vec::<String>::new());
    }
}
