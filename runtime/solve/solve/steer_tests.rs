//! Tests of refinement for the tracked pupil.

use super::{Flow, Problem, RefineSettings, Refiner, Settings, Strategy, solve};
use crate::engine::cpu::CpuEngine;
use crate::optics::{Color, Display, Padding, Pupil, PupilDistribution};
use crate::plan::Storage;
use crate::scene::{self, Request};
use std::time::{Duration, Instant};

/// A hologram of the still life for the whole eyebox, with its exposure.
fn solved() -> (Problem, Vec<f32>, f64) {
    let display = Display { height: 96, width: 112, ..Display::preset("small").unwrap() };
    let field = scene::load("builtin:still-life", &Request::new(&display, &[Color::Green])).unwrap();
    let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
    let settings = Settings { steps: 24, diameter: [2e-3, 18e-3], depth: [-5e-4, 5e-4], ..Settings::default() };
    let solution = solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
    (problem, solution.phases, solution.exposure)
}

const AIM: PupilDistribution = PupilDistribution {
    centre: [4e-3, -2e-3],
    spread: 3e-4,
    diameter: [3.5e-3, 4.5e-3],
    focus: [2e-4, 2e-4],
    elsewhere: 0.0,
};

fn refiner(of: &(Problem, Vec<f32>, f64), steering: RefineSettings) -> Refiner {
    let mut refiner =
        Refiner::new(of.0.clone(), &of.1, of.2, steering, Box::new(CpuEngine::new())).expect("a sound refinement");
    refiner.aim(AIM).unwrap();
    refiner
}

fn pupils(centers: &[[f64; 2]]) -> Vec<Pupil> {
    centers.iter().map(|&[x, y]| Pupil { x: x * 1e-3, y: y * 1e-3, diameter: 4e-3, depth: 2e-4 }).collect()
}

fn mean(refiner: &mut Refiner, pupils: &[Pupil]) -> f64 {
    let exposure = refiner.exposure();
    let sums = refiner.look(pupils).unwrap();
    sums.iter().map(|s| s.psnr(exposure)).sum::<f64>() / sums.len() as f64
}

/// OPTICS 6d. On a display this small the gain is 2.6 dB after eight steps (3.5 dB at 256 x 256) and 1.6 dB with Adam.
/// The loss elsewhere is very small.
#[test]
fn the_eye_sees_better_and_the_eyebox_hardly_worse() {
    let whole = solved();
    let there = pupils(&[[4.0, -2.0], [4.3, -1.8], [3.7, -2.4]]);
    let elsewhere = pupils(&[[-6.0, 5.0], [0.0, 0.0], [-4.0, -7.0], [6.0, 6.0]]);
    for (strategy, least) in [(RefineSettings::default().strategy, 2.0), (Strategy::Adam { rate: 0.05 }, 1.2)] {
        let mut refiner = refiner(&whole, RefineSettings { strategy, pupils: 4, ..RefineSettings::default() });
        let before = (mean(&mut refiner, &there), mean(&mut refiner, &elsewhere));
        for _ in 0..8 {
            assert!(refiner.step().unwrap().is_finite());
        }
        let after = (mean(&mut refiner, &there), mean(&mut refiner, &elsewhere));
        assert!(after.0 > before.0 + least, "{strategy:?}: {before:?} before, {after:?} after");
        assert!(after.1 > before.1 - 1.0, "{strategy:?}: {before:?} before, {after:?} after");
    }
}

/// If every drawn pupil is the same, stored target images equal new ones.
#[test]
fn photographs_that_are_kept_change_nothing() {
    let whole = solved();
    let run = |repeats| {
        let steering = RefineSettings { repeats, elsewhere: 0.0, ..RefineSettings::default() };
        let mut refiner = refiner(&whole, steering);
        refiner.aim(PupilDistribution { spread: 0.0, diameter: [4e-3; 2], ..AIM }).unwrap();
        (0..5).for_each(|_| assert!(refiner.step().unwrap().is_finite()));
        refiner.phases().unwrap()
    };
    assert!(run(1) == run(3));
    // A simulation in between uses the slots, which are then filled again.
    let steering = RefineSettings { repeats: 3, elsewhere: 0.0, ..RefineSettings::default() };
    let mut refiner = refiner(&whole, steering);
    refiner.aim(PupilDistribution { spread: 0.0, diameter: [4e-3; 2], ..AIM }).unwrap();
    for _ in 0..5 {
        refiner.step().unwrap();
        refiner.look(&pupils(&[[-6.0, 5.0]])).unwrap();
    }
    assert!(refiner.phases().unwrap() == run(1));
}

#[test]
fn time_is_kept_and_phases_begin_again() {
    let whole = solved();
    let mut refiner = refiner(&whole, RefineSettings::default());
    refiner.step().unwrap();
    assert_eq!(refiner.refine_until(Instant::now(), 100).unwrap(), 0, "a step takes longer than no time");
    assert_eq!(refiner.refine_until(Instant::now() + Duration::from_secs(60), 2).unwrap(), 2);
    refiner.restart(&whole.1).unwrap();
    assert!(refiner.phases().unwrap() == whole.1);
    refiner.step().unwrap();
    assert!(refiner.phases().unwrap() != whole.1);
    refiner.begin_again().unwrap();
    assert!(refiner.phases().unwrap() == whole.1);
}

#[test]
fn what_cannot_be_is_refused() {
    let (problem, phases, exposure) = solved();
    let new = |phases: &[f32], exposure, steering| {
        Refiner::new(problem.clone(), phases, exposure, steering, Box::new(CpuEngine::new())).map(drop)
    };
    let fine = RefineSettings::default();
    assert!(new(&phases, exposure, fine).is_ok());
    assert!(new(&phases[1..], exposure, fine).is_err() && new(&[], exposure, fine).is_err());
    assert!(new(&vec![f32::NAN; phases.len()], exposure, fine).is_err());
    assert!(new(&phases, 0.0, fine).is_err() && new(&phases, f64::NAN, fine).is_err());
    assert!(new(&phases, exposure, RefineSettings { pupils: 0, ..fine }).is_err());
    assert!(new(&phases, exposure, RefineSettings { elsewhere: f64::INFINITY, ..fine }).is_err());
}

/// With phases of 16 bits and velocities in halves the image equals the one of float32, after few steps and after many
/// small ones.
#[test]
fn binary_angles_cost_nothing_that_is_seen() {
    let whole = solved();
    let there = pupils(&[[4.0, -2.0], [4.3, -1.8], [3.7, -2.4]]);
    let [mut full, mut short] = [Storage::F32, Storage::F16].map(|storage| {
        refiner(&whole, RefineSettings { storage: Some(storage), elsewhere: 0.0, ..RefineSettings::default() })
    });
    for _ in 0..24 {
        full.step().unwrap();
        short.step().unwrap();
    }
    let [full, short] = [&mut full, &mut short].map(|refiner| {
        let phases = refiner.phases().unwrap();
        (mean(refiner, &there), phases)
    });
    assert!((full.0 - short.0).abs() < 0.01, "{} dB, {} with binary angles", full.0, short.0);
    let unit = std::f32::consts::TAU / 65536.0;
    let whole_units = |phases: &[f32]| phases.iter().all(|phase| (phase / unit - (phase / unit).round()).abs() < 0.02);
    assert!(whole_units(&short.1) && !whole_units(&full.1));
}
