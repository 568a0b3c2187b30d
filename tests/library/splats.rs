//! The built-in scene of splats is the still life, also for the holograms that are solved from it.

use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::optics::{Color, Display, Padding, Pupil};
use eyebox::low_level::scene::{self, Request};
use eyebox::low_level::solve::{Flow, Problem, RefineSettings, Refiner, Settings, Solution, solve};

/// A hologram of the splats is within 1 dB of a hologram of the light field, by the target images of the light field.
#[test]
fn a_hologram_of_the_built_in_splats_shows_the_still_life() {
    let display = Display { height: 96, width: 96, ..Display::preset("small").expect("a preset") };
    let [light_field, splats] = ["builtin:still-life", "builtin:still-life-splats"].map(|source| {
        let field = scene::load(source, &Request::new(&display, &[Color::Green])).expect("a scene");
        let [far, near] = field.depth.expect("its depths");
        (Problem::new(&field, Color::Green, &display, Padding::default()).expect("a problem"), [far, near])
    });
    let (problem, depth) = &light_field;
    let settings = Settings { steps: 60, depth: *depth, ..Settings::default() };
    let solved = |problem: &Problem| {
        solve(problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).expect("a hologram")
    };
    let places = [[-3e-3, -2e-3], [0.0, 0.0], [2e-3, 3e-3], [4e-3, -1e-3]];
    let pupils: Vec<Pupil> = places
        .into_iter()
        .zip([-0.5, 0.0, 0.5, 1.0])
        .map(|([x, y], share)| Pupil { x, y, diameter: 4e-3, depth: share * depth[1] })
        .collect();
    let seen = |solution: &Solution| {
        let engine = Box::new(CpuEngine::new());
        let steering = RefineSettings::default();
        let mut refiner =
            Refiner::new(problem.clone(), &solution.phases, solution.exposure, steering, engine).expect("a refinement");
        let looks = refiner.look(&pupils).expect("images");
        looks.iter().map(|look| look.psnr(solution.exposure)).sum::<f64>() / looks.len() as f64
    };
    let [own, of_splats] = [problem, &splats.0].map(|problem| seen(&solved(problem)));
    println!("{own:.2} dB of the light field, {of_splats:.2} dB of the splats");
    assert!(own > 15.0 && of_splats > own - 1.0, "{own:.2} dB of the light field, {of_splats:.2} dB of the splats");
}
