//! Tests the cost of motion and the windows of a stream (OPTICS 15).

use super::{Flow, Motion, Problem, PupilRange, RefineSettings, Refiner, Sampler, Sequence, Settings, Solution, solve};
use crate::engine::{Buffer, Engine, cpu::CpuEngine};
use crate::evaluate;
use crate::optics::{Color, Display, Padding, Pupil, PupilDistribution, WindowFactor};
use crate::plan::{Moving, Purpose, Viewpoint};
use crate::scene::{self, Request};
use std::sync::Arc;

const SIZE: usize = 128;

fn problem() -> Problem {
    let display = Display { height: SIZE, width: SIZE, ..Display::preset("small").unwrap() };
    let field = scene::load("builtin:still-life", &Request::new(&display, &[Color::Green])).unwrap();
    Problem::new(&field, Color::Green, &display, Padding::default()).unwrap()
}

fn settings(frames: usize, motion: Motion) -> Settings {
    let depth = [-5e-4, 5e-4];
    Settings { frames, motion, steps: 30, diameter: [3.5e-3, 4.5e-3], depth, ..Settings::default() }
}

fn solved(problem: &Problem, settings: &Settings) -> Solution {
    solve(problem, settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap()
}

/// Mean PSNR over random pupils in dB. Each one moves as `look` makes it.
fn mean_db(problem: &Problem, solution: &Solution, look: impl Fn(Pupil) -> Moving) -> f64 {
    let frames = solution.phases.len() / (SIZE * SIZE);
    let planner = problem.planner(frames, WindowFactor::Two);
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid))).unwrap();
    engine.write(Buffer::Phases, &solution.phases).unwrap();
    let range = PupilRange::over(problem.eyebox, [-5e-4, 5e-4]);
    let mut sampler = Sampler::new(range, Sequence::Sobol, 0x6c6f_6f6b);
    let eyes: Vec<Viewpoint> = (0..12).map(|_| Viewpoint::Moving(look(sampler.draw()))).collect();
    let sums = evaluate::sums(&mut engine, &planner, &eyes).unwrap();
    sums.iter().map(|s| s.psnr(solution.exposure)).sum::<f64>() / sums.len() as f64
}

/// PSNR in dB of an eye at a known position after some steps for it and for this motion, by its own movement.
fn refined_db(of: &(Problem, Solution), motion: Motion, look: impl Fn(Pupil) -> Moving) -> f64 {
    let (problem, solution) = of;
    let steering = RefineSettings { pupils: 4, ..RefineSettings::default() };
    let mut refiner =
        Refiner::new(problem.clone(), &solution.phases, solution.exposure, steering, Box::new(CpuEngine::new()))
            .unwrap();
    let eye = Pupil::from_mm([3.0, -2.0, 4.0, 0.2]);
    refiner.aim(PupilDistribution::around(&eye, 2e-4)).unwrap();
    refiner.moves(motion).unwrap();
    for _ in 0..24 {
        refiner.step().unwrap();
    }
    let places = [[3.0, -2.0], [3.2, -1.9], [2.8, -2.2]];
    let eyes = places.map(|[x, y]| Viewpoint::Moving(look(Pupil::from_mm([x, y, 4.0, 0.2]))));
    let sums = refiner.look_through(&eyes).unwrap();
    sums.iter().map(|s| s.psnr(solution.exposure)).sum::<f64>() / sums.len() as f64
}

/// Content moves by ten pixels per set. An eye that follows it sees it nearly as well as static content. An eye that
/// rests sees the target image integrated over the motion. Without motion compensation the following eye sees blur.
#[test]
fn what_moves_is_seen_as_well_as_what_stands_still() {
    let problem = problem();
    let solution = solved(&problem, &settings(8, Motion::default()));
    let of = (problem, solution);
    let (content, still) = ([10.0, 0.0], Motion::default());
    let moves = |eye: [f64; 2]| Motion { content, eye: Some(eye), ..still };
    let rest = |pupil| Moving::resting(pupil, 8);
    let follows = |pupil| Moving { eye: content, content, ..rest(pupil) };
    let stays = |pupil| Moving { content, ..rest(pupil) };
    let at_rest = refined_db(&of, still, rest);
    let [followed, stayed] = [refined_db(&of, moves(content), follows), refined_db(&of, moves([0.0; 2]), stays)];
    let either = Motion { content, ..still };
    let [follows_either, stays_either] = [refined_db(&of, either, follows), refined_db(&of, either, stays)];
    let smeared = refined_db(&of, still, follows);
    let all = format!(
        "still {at_rest:.2} dB; followed {followed:.2}, stayed {stayed:.2}; not known which: {follows_either:.2}, \
         {stays_either:.2}; followed without moments {smeared:.2}"
    );
    println!("{all}");
    assert!(followed > at_rest - 1.0 && stayed > at_rest - 1.0, "{all}");
    assert!(smeared < followed - 1.5, "{all}");
}

/// A stream of sixteen sub-frames is solved over its windows of eight, with as many pupils per sub-frame. Every window
/// is a good set. A window of half of each of two separate sets is worse.
#[test]
fn every_window_of_a_stream_is_a_good_set() {
    let problem = problem();
    let window = |first: usize| move |pupil| Moving { first, count: 8, ..Moving::resting(pupil, 16) };
    let of =
        |solution: &Solution| (0..16).map(|first| mean_db(&problem, solution, window(first))).collect::<Vec<f64>>();
    let usual = |frames, motion| Settings { diameter: [2e-3, 18e-3], ..settings(frames, motion) };
    let windows = Motion { window: Some(8), ..Motion::default() };
    let stream = of(&solved(&problem, &Settings { pupils: 32, ..usual(16, windows) }));
    let mut apart = solved(&problem, &usual(8, Motion::default()));
    apart.phases.extend(solved(&problem, &Settings { seed: 77, ..usual(8, Motion::default()) }).phases);
    let apart = of(&apart);
    let least = |all: &[f64]| all.iter().copied().fold(f64::INFINITY, f64::min);
    let most = |all: &[f64]| all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let all = format!(
        "windows {:.2} to {:.2} dB, of two separate sets {:.2} to {:.2}",
        least(&stream),
        most(&stream),
        least(&apart),
        most(&apart)
    );
    println!("{all}");
    assert!(most(&stream) - least(&stream) < 0.3 && least(&stream) > least(&apart) + 0.8, "{all}");
}
