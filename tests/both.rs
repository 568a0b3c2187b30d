//! Runs the same list of kernels on two engines, with known contents, and returns the distance of their results.

use eyebox::low_level::engine::vulkan::VulkanEngine;
use eyebox::low_level::engine::{Buffer, Dispatch, Engine, Kernel, Purpose, Resource, Shape, Step};
use eyebox::low_level::gpu::{Gpu, Messages, Options};
use eyebox::low_level::optics::{DisplayModel, Iris, Optics, Padding, Pupil, Spread, WindowFactor};
use eyebox::low_level::plan::{Comparison, Moving, Planner, ViewLayout, Viewpoint};
use eyebox::low_level::scene::{Pyramid, ViewGrid};
use std::sync::{Arc, PoisonError};

#[path = "../runtime/compute/gpu/vulkan/test_options.rs"]
mod test_options;
pub use test_options::watched;

/// Opens a Vulkan engine with validation. A software device is enough. Without any device, the test fails.
pub fn vulkan() -> VulkanEngine {
    let mut engine = VulkanEngine::new(&gpu()).unwrap_or_else(|e| panic!("{e}"));
    engine.time_kernels(true);
    engine
}

/// Opens a Vulkan device with validation.
pub fn gpu() -> Gpu {
    Gpu::open(&watched()).unwrap_or_else(|e| panic!("{e}"))
}

/// Fails if the validation layer printed a message, also while the device closes.
pub fn assert_silent(engine: VulkanEngine) {
    let messages: Messages = engine.gpu().messages();
    drop(engine);
    let heard = messages.lock().unwrap_or_else(PoisonError::into_inner);
    assert!(heard.is_empty(), "the validation layer printed:\n{}", heard.join("\n"));
}

/// Random numbers from 0 to 1. The same seed gives the same numbers.
pub struct Noise(u64);

impl Noise {
    /// Starts the numbers of a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    /// Returns the next number.
    pub fn draw(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Returns values between two limits.
    pub fn between(&mut self, count: usize, low: f32, high: f32) -> Vec<f32> {
        (0..count).map(|_| low + (high - low) * self.draw()).collect()
    }
}

/// A display, its views and three pupils. A small pupil is at the eyebox's edge, where its window hangs over and wraps.
/// The views of a large pupil move by less than a pixel. The third pupil is in between.
pub struct Case {
    /// Makes pupil passes and steps.
    pub planner: Planner,
    /// The views of the light field.
    pub pyramid: Arc<Pyramid>,
    /// The small, the large and the medium pupil.
    pub pupils: Vec<Pupil>,
}

impl Case {
    /// Makes a case with `padding` rows and columns of zeros on each side. `depth` is the depth of the first pupil.
    pub fn new(height: usize, width: usize, padding: usize, depth: f64, frames: usize) -> Self {
        let slm = Optics::new(height, width, 8e-6, 520e-9, 0.4).expect("valid optics");
        let mut planner = Planner::new(slm, frames, WindowFactor::Two);
        if padding > 0 {
            planner = planner.with_padding(Padding { rows: padding, columns: padding });
        }
        let (gh, gw) = (planner.grid.height, planner.grid.width);
        let grid = ViewGrid { rows: 3, columns: 3, cell: slm.eyebox() / 3.0 };
        let mut noise = Noise::new((height * 7919 + width) as u64);
        let views: Vec<Vec<f32>> = (0..9).map(|_| noise.between(gh * gw, 0.0, 1.0)).collect();
        let pyramid = Arc::new(Pyramid::new(&views, gh, gw));
        planner.views = Some(ViewLayout::new(grid, &pyramid));
        let half = slm.eyebox() / 2.0;
        let pupil =
            |x: f64, y: f64, diameter: f64, depth| Pupil { x: x * half, y: y * half, diameter: diameter * half, depth };
        let pupils = vec![pupil(-0.7, 0.8, 0.4, depth), pupil(0.1, -0.05, 1.6, -2e-4), pupil(0.3, 0.2, 0.7, 5e-3)];
        Self { planner, pyramid, pupils }
    }

    /// Makes a step of the projection or of Adam over all pupils, with this mode of comparison.
    pub fn step(&self, purpose: Purpose, mode: u32, power: f64, in_flight: usize) -> Step {
        let comparison = Comparison { mode, exposure: 0.8, batch: self.pupils.len(), ..Comparison::default() };
        let pupil_passes: Vec<_> = self.pupils.iter().map(|p| self.planner.pupil_pass(p, &comparison)).collect();
        match purpose {
            Purpose::Adam => self.planner.adam_step(pupil_passes, in_flight, 3, 0.1),
            _ => self.planner.project_step(pupil_passes, in_flight, power, 2.0, 0.5),
        }
    }

    /// Makes a step over three windows of the short-time Fourier transform, with and without a filter.
    pub fn stft_step(&self, purpose: Purpose, mode: u32) -> Step {
        let comparison = Comparison { mode, exposure: 0.8, batch: 3, ..Comparison::default() };
        let filters = [0.9 * self.planner.slm.eyebox(), f64::INFINITY];
        let viewpoint = |view: usize| Viewpoint::Stft { view, samples: 3, filter: filters[view % 2] };
        let pupil_passes = [1, 4, 6].map(|view| self.planner.viewpoint(&viewpoint(view), &comparison)).to_vec();
        match purpose {
            Purpose::Adam => self.planner.adam_step(pupil_passes, usize::MAX, 3, 0.1),
            _ => self.planner.project_step(pupil_passes, usize::MAX, 0.5, 2.0, 0.5),
        }
    }

    /// Makes a step for eyes that move. One pupil drifts past moving content, and one covers only some of the
    /// sub-frames.
    pub fn moving_step(&self, purpose: Purpose, mode: u32, in_flight: usize) -> Step {
        let comparison = Comparison { mode, exposure: 0.8, batch: self.pupils.len(), ..Comparison::default() };
        let frames = self.planner.frames;
        let moving = |(i, pupil): (usize, &Pupil)| {
            let rest = Moving::resting(*pupil, frames);
            let drift = [0.02 * pupil.diameter, -0.05 * pupil.diameter];
            Viewpoint::Moving(match i {
                0 => Moving { eye: [3.3, -1.7], content: [0.5, 2.0], at: 0.25, drift, ..rest },
                1 => Moving { first: frames - 1, count: frames.div_ceil(2), ..rest },
                _ => rest,
            })
        };
        let looks = self.pupils.iter().enumerate().map(moving);
        let pupil_passes: Vec<_> = looks.map(|look| self.planner.viewpoint(&look, &comparison)).collect();
        match purpose {
            Purpose::Adam => self.planner.adam_step(pupil_passes, in_flight, 3, 0.1),
            _ => self.planner.project_step(pupil_passes, in_flight, 0.5, 2.0, 0.5),
        }
    }

    /// Makes a step with this kernel only, over all pupil passes if the kernel has pupil passes.
    pub fn single(&self, purpose: Purpose, mode: u32, power: f64, kernel: Kernel) -> Step {
        let mut step = self.step(purpose, mode, power, usize::MAX);
        if kernel == Kernel::Taper {
            step = self.stft_step(purpose, mode);
        } else if matches!(kernel, Kernel::Motion | Kernel::MotionBack) {
            step = self.moving_step(purpose, mode, usize::MAX);
        } else if matches!(kernel, Kernel::Energy | Kernel::EqualiseEyebox) {
            step = self.planner.with_equalised_eyebox(step, 0.8 * self.planner.slm.eyebox(), 5, 0.4);
        }
        let pupil_passes = step
            .list
            .iter()
            .find(|d| d.kernel == kernel)
            .map_or(0..step.pupil_passes.len(), |d| d.pupil_passes.clone());
        step.list = vec![Dispatch { kernel, pupil_passes }];
        step
    }

    /// Loads the case into an engine.
    pub fn load(&self, engine: &mut dyn Engine, purpose: Purpose) {
        engine.load(&self.planner.shape(purpose), Some(Arc::clone(&self.pyramid))).unwrap_or_else(|e| panic!("{e}"));
    }
}

/// Returns all buffers of a shape and of the pupil passes in slots from 0 on, with their numbers of float32 values.
pub fn buffers(shape: &Shape, step: &Step) -> Vec<(Buffer, usize)> {
    let of_shape = Resource::OF_SHAPE.into_iter().map(|resource| (resource, 0, shape.extent(resource)));
    let pupil_passes = step.list.iter().map(|d| d.pupil_passes.clone()).find(|l| !l.is_empty()).unwrap_or(0..0);
    let slots = step.pupil_passes[pupil_passes].iter().enumerate();
    let of_slots = slots.flat_map(|(slot, pupil_pass)| {
        Resource::OF_SLOT.map(|resource| (resource, slot, pupil_pass.extent(resource, shape)))
    });
    let held = of_shape.chain(of_slots).filter(|(.., extent)| extent.floats() > 0);
    held.filter_map(|(resource, slot, extent)| Some((resource.buffer(slot)?, extent.floats()))).collect()
}

/// Returns plausible contents of a buffer, such as phases within a turn, counts of pupils or intensities of at least 0.
pub fn contents(buffer: Buffer, count: usize, noise: &mut Noise) -> Vec<f32> {
    match buffer {
        Buffer::Phases | Buffer::Shown => noise.between(count, -3.1, 3.1),
        Buffer::Levels => {
            let mut levels = noise.between(count, -3.1, 3.1);
            levels[..11].sort_by(f32::total_cmp);
            levels
        }
        Buffer::Hits => noise.between(count, 0.0, 5.0).into_iter().map(f32::floor).collect(),
        Buffer::Energy | Buffer::Second | Buffer::Image(_) | Buffer::Target(_) | Buffer::Accumulator(_) => {
            noise.between(count, 0.0, 1.5)
        }
        _ => noise.between(count, -1.0, 1.0),
    }
}

/// Returns the error power over the signal power. Phases are compared on the circle.
pub fn distance(buffer: Buffer, got: &[f32], want: &[f32]) -> f64 {
    assert_eq!(got.len(), want.len(), "{buffer:?}");
    let (mut error, mut power) = (0.0, 1e-30);
    for (g, w) in got.iter().zip(want) {
        let (g, w) = (f64::from(*g), f64::from(*w));
        error += if buffer == Buffer::Phases { 2.0 - 2.0 * (g - w).cos() } else { (g - w).powi(2) };
        power += if buffer == Buffer::Phases { 1.0 } else { w * w };
    }
    assert!(error.is_finite(), "{buffer:?} holds a value that is not finite");
    error / power
}

/// Runs the step on `engine` and on `twin` from the same random buffers and compares every buffer and every loss.
/// Returns the largest error power over signal power.
pub fn compare(engine: &mut dyn Engine, twin: &mut dyn Engine, case: &Case, purpose: Purpose, step: &Step) -> f64 {
    let shape = case.planner.shape(purpose);
    let mut noise = Noise::new(step.list.len() as u64 + step.list[0].kernel as u64);
    case.load(engine, purpose);
    case.load(twin, purpose);
    let all = buffers(&shape, step);
    for &(buffer, count) in &all {
        let mut data = contents(buffer, count, &mut noise);
        // An inverse transform expects zeros outside the columns in use.
        blank(
            &shape,
            step,
            buffer,
            &[Kernel::ChangeInverse, Kernel::SubpixelsInverse, Kernel::WindowInverse],
            &mut data,
        );
        engine.write(buffer, &data).unwrap_or_else(|e| panic!("{buffer:?}: {e}"));
        twin.write(buffer, &data).unwrap_or_else(|e| panic!("{buffer:?}: {e}"));
    }
    let got = engine.run(step).unwrap_or_else(|e| panic!("{e}"));
    let want = twin.run(step).unwrap_or_else(|e| panic!("{e}"));
    let mut worst: f64 = 0.0;
    for (got, want) in got.iter().zip(&want) {
        let off = ((got - want) / want.abs().max(1e-30)).powi(2);
        worst = worst.max(if want == got { 0.0 } else { off });
    }
    for (buffer, _) in all {
        let mut got = engine.read(buffer).unwrap_or_else(|e| panic!("{buffer:?}: {e}"));
        let mut want = twin.read(buffer).unwrap_or_else(|e| panic!("{buffer:?}: {e}"));
        // A forward transform leaves undefined values outside the columns in use.
        for data in [&mut got, &mut want] {
            blank(&shape, step, buffer, &[Kernel::FieldForward, Kernel::SubpixelsForward, Kernel::WindowForward], data);
        }
        worst = worst.max(distance(buffer, &got, &want));
    }
    worst
}

/// Zeroes a complex buffer outside the columns in use, if the step has one of these transforms of the buffer.
fn blank(shape: &Shape, step: &Step, buffer: Buffer, transforms: &[Kernel], data: &mut [f32]) {
    let (width, columns, kernels) = match buffer {
        Buffer::Field => {
            (shape.place.grid_width as usize, step.columns, [Kernel::FieldForward, Kernel::SubpixelsForward])
        }
        Buffer::Change => {
            (shape.place.grid_width as usize, step.columns, [Kernel::ChangeInverse, Kernel::SubpixelsInverse])
        }
        // The transform of columns reads the results of the transform of rows here.
        Buffer::Subpixels => (shape.place.grid_width as usize, step.columns, [Kernel::SubpixelsForward; 2]),
        Buffer::Window(slot) => {
            let pupil_passes = step.list.iter().map(|d| d.pupil_passes.clone()).find(|l| !l.is_empty()).unwrap_or(0..0);
            let Some(pupil_pass) = step.pupil_passes[pupil_passes].get(slot) else { return };
            (pupil_pass.window.columns, pupil_pass.columns, [Kernel::WindowForward, Kernel::WindowInverse])
        }
        _ => return,
    };
    if !step.list.iter().any(|d| transforms.contains(&d.kernel) && kernels.contains(&d.kernel)) {
        return;
    }
    for (i, value) in data.chunks_exact_mut(2).enumerate() {
        if (i % width + width - columns.first % width) % width >= columns.count {
            value.fill(0.0);
        }
    }
}

/// Returns a display model in which every term has an effect.
pub fn every_fault() -> DisplayModel {
    let mut model = DisplayModel::default();
    let spread = |q, sigma| Spread { q, sigma };
    model.level = [[0.95, 1.0, 1.05], [1.0, 1.04, 0.98], [1.1, 1.0, 0.9]];
    model.bend = [0.12, -0.06];
    model.lag = 0.15;
    model.crosstalk = Some([spread(1.2, 2.03), spread(1.4, 1.6), spread(1.1, 2.2), spread(1.3, 1.9)]);
    model.fill = 0.9;
    model.source = [0.1, -0.05, -0.3, 0.08, -0.2];
    model.undiffracted = vec![[0.15, 0.1, 0.4, -0.3, 0.2], [-0.05, 0.1, -1.3, 2.0, 0.1]];
    model.wavefront = [(4, 0.15), (5, -0.1), (7, 0.05), (12, 0.03)].into();
    model.iris = Iris { x: 0.2e-3, y: -0.3e-3, scale: 1.02 };
    model
}
