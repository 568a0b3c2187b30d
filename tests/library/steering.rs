//! Refinement for the tracked pupil gives the same phases on both engines if pupils and steps are the same.

use eyebox::low_level::engine::Engine;
use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::optics::{Color, Display, Padding, PupilDistribution, WindowFactor};
use eyebox::low_level::scene::{self, Request};
use eyebox::low_level::solve::{Flow, Problem, RefineSettings, Refiner, Settings, Strategy, solve};
use eyebox_tests::both::vulkan;

const STEPS: usize = 4;

fn problem(color: Color) -> Problem {
    let display = Display { height: 60, width: 72, ..Display::preset("small").expect("a preset") };
    let field = scene::load("builtin:still-life", &Request::new(&display, &[color])).expect("a scene");
    Problem::new(&field, color, &display, Padding::default()).expect("a problem")
}

/// Returns the result of a few steps from these phases, before and after a movement of the eye.
fn refined(
    problem: &Problem,
    phases: &[f32],
    exposure: f64,
    steering: RefineSettings,
    engine: Box<dyn Engine>,
) -> Vec<f32> {
    let mut refiner = Refiner::new(problem.clone(), phases, exposure, steering, engine).expect("a refinement");
    let aim = |x: f64| PupilDistribution {
        centre: [x, -1e-3],
        spread: 2e-4,
        diameter: [3e-3, 5e-3],
        focus: [0.0, 2e-4],
        elsewhere: 0.1,
    };
    for x in [1e-3, 4e-3] {
        refiner.aim(aim(x)).expect("an aim");
        for _ in 0..STEPS {
            assert!(refiner.step().expect("a step").is_finite());
        }
    }
    refiner.phases().expect("the phases")
}

#[test]
fn both_engines_refine_every_colour_alike() {
    let projection = RefineSettings::default();
    let adam = RefineSettings { strategy: Strategy::Adam { rate: 0.05 }, ..projection };
    let kept = RefineSettings { repeats: 2, window: WindowFactor::One, ..projection };
    for (color, steering) in [
        (Color::Red, projection),
        (Color::Green, projection),
        (Color::Blue, projection),
        (Color::Green, adam),
        (Color::Green, kept),
    ] {
        let problem = problem(color);
        let settings = Settings { steps: 6, frames: 3, ..Settings::default() };
        let whole = solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).expect("a hologram");
        let run = |engine| refined(&problem, &whole.phases, whole.exposure, steering, engine);
        let device = vulkan();
        let heard = device.gpu().messages();
        let (got, want) = (run(Box::new(device)), run(Box::new(CpuEngine::new())));
        assert!(want != whole.phases, "the steps changed no phase");
        // Phases are angles, so the power of the difference of the fields is compared. Each step amplifies the rounding
        // of the last step a little at points where a field is nearly zero.
        let power: f64 = got.iter().zip(&want).map(|(a, b)| 2.0 - 2.0 * f64::from(a - b).cos()).sum();
        let ratio = power / want.len() as f64;
        assert!(ratio < 1e-8, "{color} {:?}: error power {ratio:e} of the field's", steering.strategy);
        let messages = heard.lock().expect("the messages").clone();
        assert!(messages.is_empty(), "{messages:?}");
    }
}
