//! Tests steps whose intensities come from outside.

use super::step::{Update, take, take_seen};
use super::{Problem, random_phases};
use crate::engine::{self, Buffer, Choice, Engine, EngineError};
use crate::optics::{Color, Display, Pupil, WindowFactor};
use crate::plan::{Purpose, Step, Viewpoint};
use crate::scene::LightField;
use std::sync::Arc;

const SIZE: [usize; 2] = [24, 32];

fn problem() -> Problem {
    let [height, width] = SIZE;
    let display = Display { height, width, ..Display::preset("small").expect("a preset") };
    let view = |v: usize| (0..height * width).map(|i| ((i * 7 + v * 3) % 11) as f32 / 11.0).collect();
    let field = LightField {
        name: "grain".into(),
        grid: [1, 2],
        height,
        width,
        colors: vec![Color::Green],
        planes: vec![vec![view(0), view(1)]],
        view_pitch: None,
        disparity: None,
        depth: None,
        made: None,
    };
    Problem::new(&field, Color::Green, &display, Default::default()).expect("a problem")
}

/// Returns the phases of an engine after one step.
fn stepped(mut engine: Box<dyn Engine>, go: impl Fn(&mut dyn Engine, &Step) -> Result<f64, EngineError>) -> Vec<f32> {
    let problem = problem();
    let planner = problem.planner(2, WindowFactor::Two);
    engine.load(&planner.shape(Purpose::Project), Some(Arc::clone(&problem.pyramid))).expect("buffers");
    engine.write(Buffer::Phases, &random_phases(2 * SIZE[0] * SIZE[1], 3)).expect("phases");
    let update = Update::Projection { gain: 1.0, momentum: 0.0, overlap_power: 0.5 };
    let pupils = [[1.0, -2.0, 5.0, 0.0], [-3.0, 1.0, 9.0, 1.0]].map(|p| Viewpoint::Pupil(Pupil::from_mm(p)));
    let step = update.step(&planner, update.pupil_passes(&planner, &pupils, 0.4), usize::MAX);
    assert!(go(engine.as_mut(), &step).expect("a step").is_finite());
    engine.read(Buffer::Phases).expect("phases")
}

fn cpu() -> Box<dyn Engine> {
    engine::open(Choice::Cpu).expect("the CPU")
}

fn difference(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| eyebox_kernels::trig::wrap(a - b).abs()).fold(0.0, f32::max)
}

/// The callback receives the intensity of the model and the fields that make it. Its answer decides the step.
#[test]
fn what_is_seen_decides_the_step() {
    let plain = stepped(cpu(), |engine, step| take(engine, step, std::slice::from_ref(&(0..step.list.len()))));
    let own = stepped(cpu(), |engine, step| {
        take_seen(engine, step, |slot, image, fields| -> Result<Vec<f32>, EngineError> {
            let args = step.pupil_passes[slot].intensity;
            for (i, value) in image.iter().enumerate() {
                let fields = fields.chunks_exact(2 * image.len()).map(|f| [f[2 * i], f[2 * i + 1]]);
                let sum: f32 = fields.map(|[re, im]| re * re + im * im).sum();
                assert!((value - args.gain * sum).abs() < 1e-5 * (1.0 + value), "{value}");
            }
            Ok(image.to_vec())
        })
    });
    assert_eq!(own, plain);
    let brighter = stepped(cpu(), |engine, step| {
        take_seen(engine, step, |_, image, _| Ok::<_, EngineError>(image.iter().map(|v| 2.0 * v).collect()))
    });
    assert!(difference(&brighter, &plain) > 0.01);
}

#[cfg(feature = "vulkan")]
#[test]
fn both_engines_take_what_is_seen() {
    let go = |engine: Box<dyn Engine>| {
        stepped(engine, |engine, step| {
            let seen = |slot: usize, image: &[f32], _: &[f32]| {
                Ok::<_, EngineError>(
                    image.iter().enumerate().map(|(i, v)| v * (1.0 + 0.1 * (i % (3 + slot)) as f32)).collect(),
                )
            };
            take_seen(engine, step, seen)
        })
    };
    let Ok(vulkan) = engine::open(Choice::Vulkan) else {
        return eprintln!("no Vulkan device: nothing was compared");
    };
    let off = difference(&go(vulkan), &go(cpu()));
    assert!(off < 1e-3, "{off} rad");
}
